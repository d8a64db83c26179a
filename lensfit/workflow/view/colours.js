// How pictures are shown: sRGB, or a display and a view of an OpenColorIO config.

import { ask } from "./asker.js";

const at = (id) => document.getElementById(id);
const PARTS = ["display", "view", "space"];

let offered = null; // by the config that is chosen

function fill(select, names, texts = names) {
  select.replaceChildren(...names.map((name, place) => new Option(texts[place], name)));
  select.disabled = names.length === 0;
}

/** What a message says of it; null for sRGB. */
export function chosen() {
  if (!offered) return null;
  const parts = PARTS.map((id) => [id, at(id).value]).filter(([, value]) => value);
  return { config: at("config").value, ...Object.fromEntries(parts) };
}

/** Fill the choices of a config; false if another was chosen meanwhile. */
async function offer() {
  const config = at("config").value;
  let [found, fault] = [null, ""];
  try {
    if (config) found = await (await ask("view", { config })).json();
  } catch (error) {
    fault = `${error.message}. Shown in sRGB`;
  }
  if (config !== at("config").value) return false;
  offered = found;
  if (!found) at("config").value = "";
  at("view-fault").textContent = fault;
  fill(at("display"), Object.keys(found?.displays ?? {}));
  fill(at("view"), found?.displays[at("display").value] ?? []);
  fill(at("space"), found?.spaces ?? []);
  return true;
}

/** Offer what there is; `changed` is called when something else is chosen. */
export async function colours({ configs, config }, changed) {
  at("colours").hidden = configs.length === 0;
  fill(at("config"), ["", ...configs], ["sRGB", ...configs]);
  at("config").value = config ?? "";
  at("config").addEventListener("change", async () => {
    if (await offer()) changed();
  });
  at("display").addEventListener("change", () => {
    fill(at("view"), offered.displays[at("display").value]);
    changed();
  });
  at("view").addEventListener("change", changed);
  at("space").addEventListener("change", changed);
  await offer();
}
