// The page: what is turned, the pictures of it, and what is said beside them.

import { Asker, ask, fetched } from "./asker.js";
import { chosen, colours } from "./colours.js";
import { cameraSpecs, control } from "./controls.js";

const at = (id) => document.getElementById(id);
const REST_MS = 400; // without a change before the whole picture is asked for
const WATCH_MS = 1000; // between looks at what the files state
const CAMERA = ["focal_length_mm", "f_number", "focus_distance_mm"];

const turned = { camera: {}, knobs: {} };
const controls = {};
let lens = null;
let version = 0;
let shown = -1;
let resting = 0;
let startsAsked = 0;
let startShown = 0; // the newest answer that was
let kept = null; // another state, which the wipe shows in place of the plate

const frame = () => +at("frame").value;
const stops = () => +at("exposure").value;
const shownAs = () => ({ exposure_stops: stops(), view: chosen() });
const message = () => ({
  frame: frame(), ...turned.camera, knobs: turned.knobs,
  ...(at("defocus").checked === lens.defocus ? {} : { defocus: at("defocus").checked }),
});

/** Options of the command as the fields of this page that do the same. */
const FIELDS = {
  "--f-number": "f_number", "--focus-distance-mm": "focus_distance_mm", "--focal-length-mm": "focal_length_mm",
};

/** A sentence for this page, and the fields that it asks for. */
function inFields(sentence) {
  const needed = [];
  const text = sentence.replace(/--[a-z][a-z-]*/g, (option) => {
    if (option === "--no-defocus") return "the box “Depth of field”";
    const one = controls[FIELDS[option]];
    if (!one) return option;
    needed.push(one.row);
    return `the field “${one.row.querySelector("label").textContent}”`;
  });
  const others = /--[a-z]/.test(text) ? ". Options are given when lensfit view is started" : "";
  return { text: text + others, needed };
}

function say(error) {
  const { text, needed } = inFields(error ? error.message : "");
  at("error").hidden = !error;
  at("error").textContent = text;
  for (const row of document.querySelectorAll(".needed")) row.classList.remove("needed");
  for (const row of needed) row.classList.add("needed");
}

async function show(image, answer) {
  const address = URL.createObjectURL(await answer.blob());
  const before = image.src;
  image.src = address;
  await image.decode();
  if (before.startsWith("blob:")) URL.revokeObjectURL(before);
}

/** What is seen while there is no picture of the state. */
const shownMeanwhile = () =>
  (at("stage").classList.contains("unmade") ? "the plate is shown as it is" : "the one before is shown");

const failed = (error, asked) => {
  if (asked === version) {
    say(error);
    at("status").textContent = `No picture of this state; ${shownMeanwhile()}`;
  }
};

const QUALITIES = { proxy: "Proxy", finer: "Finer proxy", full: "Full quality" };

/** Asks for pictures of one quality; the first is shown while the lens is being turned,
 *  the others only of the state that is left. */
const pictures = (quality) => new Asker(
  "render",
  async (answer, asked, seconds) => {
    const first = quality === lens.qualities[0];
    if (first ? asked < shown : asked !== version) return;
    shown = asked;
    await show(at("made"), answer);
    at("stage").classList.remove("unmade");
    say(null);
    at("status").textContent = `${QUALITIES[quality]}, ${seconds.toFixed(2)} s`;
    at("stage").dataset.shown = quality;
    if (quality === "full") planned.want(asked, message());
    else if (asked === version) rest(quality);
  },
  failed,
);
const askers = Object.fromEntries(Object.keys(QUALITIES).map((name) => [name, pictures(name)]));
const planned = new Asker("plan", async (answer) => showPlan(await answer.json()), () => {});

function want(quality) {
  askers[quality].want(version, { ...message(), ...shownAs(), quality });
}

/** After a picture of one quality, the next better one. */
function rest(quality) {
  clearTimeout(resting);
  const next = lens.qualities[lens.qualities.indexOf(quality) + 1];
  resting = setTimeout(() => {
    if (quality) at("status").textContent += `; ${QUALITIES[next].toLowerCase()} follows`;
    want(next);
  }, REST_MS);
}

function changed() {
  version += 1;
  clearTimeout(resting);
  for (const one of Object.values(askers)) one.forget();
  at("saved").textContent = "";
  at("status").textContent = `Making the picture; ${shownMeanwhile()} …`;
  if (lens.qualities.length > 1) want(lens.qualities[0]);
  else rest();
  showCommand();
}

async function showCommand() {
  const asked = version;
  try {
    const { command } = await (await ask("command", message())).json();
    if (asked === version) at("command").value = command;
  } catch {
    at("command").value = ""; // the picture's error says why
  }
}

/** What the wipe uncovers: the plate, or the state that was kept. */
async function showPlate() {
  const asked = frame();
  const state = kept;
  const wanted = { frame: asked, ...shownAs() };
  try {
    const answer = state
      ? await ask("render", { ...state, ...wanted, quality: "full" })
      : await ask("plate", wanted);
    if (asked === frame() && state === kept) {
      await show(at("plate"), answer);
      at("stage").dataset.beside = state ? "kept" : "plate";
    }
  } catch (error) {
    say(error);
  }
}

function showPlan(plan) {
  const rows = plan.stages.map((stage) => {
    const row = document.createElement("tr");
    row.className = stage.runs ? "" : "left";
    const cells = [
      stage.runs ? stage.stage : `${stage.stage}: left out`,
      stage.reason,
      stage.error ? stage.error.toExponential(0) : "–",
      stage.seconds ? stage.seconds.toFixed(2) : "–",
    ];
    row.append(...cells.map((text, index) => {
      const cell = document.createElement("td");
      cell.textContent = text;
      if (index > 1) cell.className = "n";
      return cell;
    }));
    return row;
  });
  at("plan").hidden = false;
  at("plan").tBodies[0].replaceChildren(...rows);
  at("totals").textContent =
    `Error ${plan.expected_error.toExponential(1)} of ${plan.tolerance} accepted, ` +
    `${plan.expected_seconds.toFixed(2)} s a frame, ${plan.expected_gib} GiB`;
  at("notes").replaceChildren(...plan.notes.map((note) => {
    const item = document.createElement("li");
    item.textContent = note;
    return item;
  }));
}

function turn(name, value) {
  const group = CAMERA.includes(name) ? turned.camera : turned.knobs;
  if (value === undefined) delete group[name];
  else group[name] = value;
  if (name === "focus_distance_mm" && value === undefined) at("mark").hidden = true;
  changed();
}

async function focusAt(x, y) {
  try {
    const answer = await ask("focus", { ...message(), x, y });
    const found = (await answer.json()).focus_distance_mm;
    at("mark").hidden = false;
    at("mark").style.left = `${(100 * x) / lens.width}%`;
    at("mark").style.top = `${(100 * y) / lens.height}%`;
    at("at-x").value = Math.floor(x);
    at("at-y").value = Math.floor(y);
    controls.focus_distance_mm.set(found);
    say(null);
  } catch (error) {
    say(error);
  }
}

/** Keep what is turned, to wipe between it and what is turned next. */
function keep() {
  const { frame: _, ...state } = message();
  kept = kept ? null : structuredClone(state);
  at("keep").setAttribute("aria-pressed", Boolean(kept));
  at("keep").textContent = kept ? "Forget the kept state" : "Keep this state to compare";
  at("wipe-to").textContent = kept ? "Wipe to the kept state" : "Wipe to the plate";
  if (kept && at("wipe").value === "0") {
    at("wipe").value = 50;
    at("wipe").dispatchEvent(new Event("input"));
  }
  showPlate();
}

function reset() {
  turned.camera = {};
  turned.knobs = {};
  at("defocus").checked = lens.defocus;
  at("mark").hidden = true;
  for (const one of Object.values(controls)) one.show(undefined);
  changed();
}

/** Value of a quantity before anything is turned. */
const startOf = ({ camera, knobs }, name) =>
  (name in camera ? camera[name] : knobs[name] ?? lens.neutral[name]);

const isSame = (one, other) =>
  one === other || Math.abs(one - other) <= 1e-6 * Math.abs(one);

/** What the files state now: fields that are not turned show it, and the picture is made
 *  of it. A kept state stays what it was. */
function beginFrom(found) {
  const names = Object.keys(controls).filter(
    (name) => startOf(found, name) !== startOf(lens, name));
  if (!names.length && found.error === lens.error) return false;
  for (const name of names) {
    const before = startOf(lens, name);
    const state = kept && (CAMERA.includes(name) ? kept : kept.knobs);
    if (state && !(name in state) && before !== null) state[name] = before;
    controls[name].begin(startOf(found, name));
  }
  Object.assign(lens, found);
  return true;
}

/** Ask what the files state; true where it is not what was shown. */
async function askStart() {
  startsAsked += 1;
  const [asked, of] = [startsAsked, frame()];
  const found = await (await ask("start", { frame: of })).json();
  if (asked < startShown || of !== frame()) return false;
  startShown = asked;
  return beginFrom(found);
}

async function watch() {
  try {
    if (!document.hidden && (await askStart())) changed();
  } catch (error) {
    say(error);
  }
  setTimeout(watch, WATCH_MS);
}

/** What was saved is turned no more, where the files' word now counts. */
async function saved() {
  await askStart();
  for (const group of [turned.camera, turned.knobs]) {
    for (const [name, value] of Object.entries(group)) {
      if (!isSame(value, startOf(lens, name))) continue;
      delete group[name];
      controls[name].show(undefined);
    }
  }
  changed();
}

function savedText({ path, changed, notes }, isTurned) {
  const already = isTurned ? `what is turned stands in ${path} already` : "no field is turned";
  return [changed ? `Saved to ${path}` : `Nothing was changed: ${already}`, ...notes].join(". ");
}

/** Whether every field counts; else it is said which does not, and the cursor goes there. */
async function isSound() {
  await Promise.all(Object.values(controls).map((one) => one.settled()));
  const wrong = Object.values(controls).find((one) => one.fault());
  if (!wrong) return true;
  at("saved").textContent = `Not saved: ${wrong.fault()}`;
  const details = wrong.row.closest("details");
  if (details) details.open = true;
  wrong.number.focus();
  return false;
}

async function save() {
  if (!(await isSound())) return;
  const isTurned = Object.keys({ ...turned.camera, ...turned.knobs }).length > 0;
  try {
    const found = await (await ask("save", message())).json();
    await saved();
    at("saved").textContent = savedText(found, isTurned);
  } catch (error) {
    at("saved").textContent = `Not saved: ${error.message}`;
  }
}

async function edit() {
  if (!(await isSound())) return;
  try {
    const said = { ...message(), who: at("who").value, why: at("why").value };
    const found = await (await ask("edit", said)).json();
    at("saved").textContent = `Saved as ${found.version}`;
  } catch (error) {
    at("saved").textContent = `Not saved: ${error.message}`;
  }
}

async function copy() {
  at("command").select();
  try {
    await navigator.clipboard.writeText(at("command").value);
    at("saved").textContent = "Copied";
  } catch {
    at("saved").textContent = "Selected: copy it with the keyboard";
  }
}

function build() {
  const knobs = lens.groups.flatMap((group) => group.knobs);
  lens.neutral = Object.fromEntries(knobs.map((knob) => [knob.name, knob.neutral]));
  for (const spec of cameraSpecs(lens)) {
    controls[spec.name] = control(spec, turn);
    at("camera").append(controls[spec.name].row);
  }
  for (const group of lens.groups) {
    const details = document.createElement("details");
    const summary = document.createElement("summary");
    summary.textContent = group.name;
    details.append(summary);
    for (const knob of group.knobs) {
      controls[knob.name] = control({ ...knob, start: startOf(lens, knob.name) }, turn);
      details.append(controls[knob.name].row);
    }
    at("groups").append(details);
  }
}

function listen() {
  at("wipe").addEventListener("input", () =>
    at("stage").style.setProperty("--wipe", `${at("wipe").value}%`));
  at("exposure").addEventListener("input", () => {
    at("stops").textContent = at("exposure").value;
    changed();
    showPlate();
  });
  at("frame").addEventListener("input", () => {
    at("name").textContent = lens.frames[frame()];
    changed();
    showPlate();
    askStart().then((other) => other && changed(), say);
  });
  at("stage").addEventListener("click", (event) => {
    const box = at("made").getBoundingClientRect();
    const share = (value, low, size) => Math.min(Math.max((value - low) / size, 0), 0.999999);
    focusAt(
      share(event.clientX, box.left, box.width) * lens.width,
      share(event.clientY, box.top, box.height) * lens.height,
    );
  });
  at("defocus").addEventListener("change", changed);
  at("focus").addEventListener("click", () => focusAt(+at("at-x").value + 0.5, +at("at-y").value + 0.5));
  at("zoom").addEventListener("click", () => {
    const on = at("scroll").classList.toggle("pixels");
    at("zoom").setAttribute("aria-pressed", on);
  });
  at("controls").addEventListener("submit", (event) => event.preventDefault());
  at("keep").addEventListener("click", keep);
  at("reset").addEventListener("click", reset);
  at("save").addEventListener("click", save);
  at("copy").addEventListener("click", copy);
  at("edit").addEventListener("click", edit);
}

async function start() {
  const answer = await fetched("lens");
  lens = await answer.json();
  if (!answer.ok) throw new Error(lens.error);
  document.title = `${lens.lens}: lensfit view`;
  at("lens").textContent = lens.lens;
  at("verdict").textContent = lens.verdict ? lens.verdict.headline : "";
  at("shelf").hidden = !lens.shelved;
  at("shelved").textContent = lens.shelved || "";
  at("save").title = `Writes ${lens.settings}`;
  at("at-x").max = lens.width - 1;
  at("at-y").max = lens.height - 1;
  const aspect = (lens.width * lens.pixel_aspect) / lens.height;
  at("stage").style.aspectRatio = aspect;
  at("stage").style.setProperty("--aspect", aspect);
  at("stage").style.setProperty("--width", `${lens.width * lens.pixel_aspect}px`);
  if (lens.frames.length > 1) {
    at("scrub").hidden = false;
    at("frame").max = lens.frames.length - 1;
  }
  at("name").textContent = lens.frames[0];
  at("defocus").checked = lens.defocus;
  build();
  listen();
  await colours(lens, () => { changed(); showPlate(); });
  if (lens.error) say(new Error(lens.error));
  showPlate();
  changed();
  watch();
}

start().catch((error) => {
  say(error);
  at("status").textContent = "";
});
