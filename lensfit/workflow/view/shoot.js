// The page of a shoot: photographs as they arrive, the shoot file, the calibration.

import { ask, fetched } from "./asker.js";

const at = (id) => document.getElementById(id);
const LOOK_MS = 700; // between looks at what goes on
const TITLES = { lens: "Lens", camera: "Camera", target: "Chart", take: "Photograph" };
const open = new Set(["lens", "camera"]);

let shownForm = "";
let formsShown = 0;
let shownChecks = "";
let shownPlan = "";

function element(name, text = "", className = "") {
  const found = document.createElement(name);
  found.textContent = text;
  if (className) found.className = className;
  return found;
}

function say(line, text) {
  line.hidden = !text;
  line.textContent = text || "";
}

async function look(name) {
  const answer = await fetched(name);
  const found = await answer.json();
  if (!answer.ok) throw new Error(found.error);
  return found;
}

// Photographs

function photograph(one) {
  const item = element("li", "", `photograph ${one.level}`);
  item.dataset.name = one.name;
  const head = element("div", "", "head");
  head.append(element("strong", one.name), element("span", one.failed ? "unreadable" : one.level, "level"));
  item.append(head);
  if (one.picture) {
    const button = element("button", "", "thumb");
    button.type = "button";
    button.setAttribute("aria-label", `${one.name}, larger`);
    const picture = document.createElement("img");
    picture.alt = `What was found on ${one.name}`;
    picture.src = one.picture;
    button.append(picture);
    button.addEventListener("click", () => enlarge(picture));
    item.append(button);
  }
  const said = document.createElement("dl");
  for (const [name, text] of one.lines) said.append(element("dt", name), element("dd", text));
  const problems = document.createElement("ul");
  for (const problem of one.problems) problems.append(element("li", `${problem.text}; ${problem.remedy}`, problem.level));
  if (one.failed) problems.append(element("li", one.failed, "bad"));
  item.append(said, problems);
  return item;
}

function enlarge(picture) {
  const large = at("large").querySelector("img");
  large.src = picture.src;
  large.alt = picture.alt;
  at("large").showModal();
}

function showChecks(found) {
  at("folder").textContent = found.folder;
  say(at("checking"), found.checking ? `Looking at ${found.checking} …` : "");
  say(at("watch-error"), found.failed);
  const now = JSON.stringify(found.photographs);
  if (now !== shownChecks) {
    shownChecks = now;
    at("photographs").replaceChildren(...found.photographs.map(photograph).reverse());
  }
  const plan = found.next ? `${found.next}.` : "";
  if (plan !== shownPlan) {
    shownPlan = plan;
    at("next").textContent = plan;
  }
}

/** Hand a photograph over; a sentence where it was not taken. */
async function refusal(file) {
  try {
    const answer = await fetch(`api/photograph?name=${encodeURIComponent(file.name)}`, {
      method: "POST",
      headers: { "content-type": "application/octet-stream" },
      body: file,
    });
    if (answer.ok) return null;
    return await answer.json().then((said) => said.error, () => `${file.name}: ${answer.statusText}`);
  } catch {
    return `${file.name}: the process took no more of it; it has ended, or the file is larger than 1 GiB`;
  }
}

async function upload(files) {
  const failed = [];
  for (const [place, file] of [...files].entries()) {
    at("upload").textContent = `Writing ${file.name} (${place + 1} of ${files.length}) …`;
    const said = await refusal(file);
    if (said) failed.push(said);
  }
  const written = `${files.length - failed.length} written`;
  at("upload").textContent = failed.length ? `${written}. Not written: ${failed.join("; ")}` : written;
}

// Shoot file

function field(table, one, unconfirmed) {
  const row = element("div", "", "field-row");
  const name = `${table.table}${table.place ?? ""}-${one.key}`;
  const label = element("label", one.label);
  const input = document.createElement(one.choices.length ? "select" : "input");
  if (one.choices.length) {
    const known = one.needed ? one.choices : ["", ...one.choices];
    for (const choice of known) input.append(new Option(choice || "–", choice));
  } else {
    input.type = "text";
    input.placeholder = one.beneath;
    input.defaultValue = one.value; // of the file
  }
  input.value = one.value;
  label.htmlFor = input.id = `f-${name}`;
  input.required = one.needed;
  const error = element("small", "", "alert");
  error.id = `e-${name}`;
  error.hidden = true;
  input.setAttribute("aria-describedby", error.id);
  const send = () => setField(table, one, input, error);
  input.addEventListener("change", send);
  row.append(label, input);
  if (unconfirmed) {
    row.classList.add("unconfirmed");
    const confirm = element("button", "✓");
    confirm.type = "button";
    confirm.setAttribute("aria-label", `Confirm ${one.label}`);
    confirm.title = "Drafted: confirm it, or change it";
    confirm.addEventListener("click", send);
    row.append(confirm);
  }
  row.append(error);
  return row;
}

const placeText = (table) => (table.place === null ? `${table.table}.` : `[[${table.table}]] ${table.place + 1}, `);

/** What counts while another value stands in a field. */
const keptText = (one) => (one.value ? `The file keeps ${one.value}` : "The file states none");

/** Whether a field of the form holds what was not sent yet. */
function isTyping() {
  const input = document.activeElement;
  return at("form").contains(input) && input.type === "text" && input.value !== input.defaultValue;
}

function showForm(form) {
  shownForm = JSON.stringify(form);
  formsShown += 1;
  at("path").textContent = form.path;
  at("out").textContent = form.out;
  at("start").disabled = !form.is_there || Boolean(form.fault);
  at("target").disabled = !form.is_there;
  say(at("fault"), form.is_there ? form.fault?.error : "There is no shoot file yet: it is drafted from the photographs.");
  at("notes").replaceChildren(...form.notes.map((note) => element("li", note)));
  const active = document.activeElement?.id;
  at("form").replaceChildren(...form.tables.map((table) => {
    const key = `${table.table}${table.place ?? ""}`;
    const details = document.createElement("details");
    details.open = open.has(key) || (form.fault?.table === table.table && form.fault?.place === table.place);
    details.addEventListener("toggle", () => (details.open ? open.add(key) : open.delete(key)));
    const number = table.place === null ? "" : ` ${table.place + 1}`;
    details.append(element("summary", `${TITLES[table.table]}${number}: ${table.named || "–"}`));
    for (const one of table.fields) {
      details.append(field(table, one, form.unconfirmed.includes(placeText(table) + one.key)));
    }
    if (table.place !== null) {
      const remove = element("button", "Take it out of the file");
      remove.type = "button";
      remove.addEventListener("click", () => change("remove", { table: table.table, place: table.place, named: table.named }));
      details.append(remove);
    }
    return details;
  }));
  if (form.fault) beside(form.fault);
  if (active) document.getElementById(active)?.focus({ preventScroll: true });
}

/** A sentence beside the field that it is about; above the form where there is none. */
function beside(fault) {
  const line = document.getElementById(`e-${fault.table}${fault.place ?? ""}-${fault.key}`);
  say(line || at("fault"), fault.error);
  if (line) {
    line.closest("details").open = true;
    line.parentElement.querySelector("input, select").setAttribute("aria-invalid", "true");
  }
}

async function setField(table, one, input, line) {
  try {
    await sendField(table, one, input, line);
  } catch (error) {
    say(line, error.message);
  }
}

async function sendField(table, one, input, line) {
  const answer = await fetched("field", {
    method: "POST",
    headers: { "content-type": "application/json" },
    body: JSON.stringify({ table: table.table, place: table.place, key: one.key, typed: input.value, named: table.named }),
  });
  const found = await answer.json();
  if (answer.ok) {
    showForm(found);
    return;
  }
  if (answer.status === 409) {
    await showAnew(found.error);
    return;
  }
  say(line, `${found.error}. ${keptText(one)}`);
  input.setAttribute("aria-invalid", "true");
}

async function change(name, message = {}) {
  try {
    const { left_out: leftOut = [], ...form } = await (await ask(name, message)).json();
    showForm(form);
    say(at("left-out"), leftOut.length && `Left out, as no chart of the file was found: ${leftOut.join(", ")}`);
  } catch (error) {
    if (error.status === 409) await showAnew(error.message);
    else say(at("fault"), error.message);
  }
}

/** The form follows the file, but not under a hand that types. */
async function watchForm() {
  try {
    const before = formsShown;
    const form = await look("shoot");
    const isNews = formsShown === before && JSON.stringify(form) !== shownForm;
    if (isNews && !isTyping()) showForm(form);
  } catch (error) {
    say(at("fault"), error.message);
  }
  setTimeout(watchForm, LOOK_MS);
}

/** The file was changed elsewhere: the form as it is now, and a sentence above it. */
async function showAnew(sentence) {
  try {
    showForm(await look("shoot"));
    say(at("fault"), sentence);
  } catch (error) {
    say(at("fault"), error.message);
  }
  at("fault").scrollIntoView({ block: "nearest" });
}

// Calibration

const seconds = (s) => (s < 90 ? `${Math.ceil(s)} s` : `${Math.round(s / 60)} min`);

/** What a calibration is at: its stage that is not done, or what follows the last one. */
function working(stages) {
  const now = stages.find((one) => !one.total || one.done < one.total);
  if (now) return `Calibrating: ${now.stage} …`;
  return stages.length ? `Calibrating: after ${stages.at(-1).stage} …` : "Calibrating: reading the photographs …";
}

function showRun(run) {
  const running = run.state === "running";
  at("start").hidden = running;
  at("cancel").hidden = !running;
  at("effort").disabled = running;
  at("calibration").dataset.state = run.state;
  at("report").hidden = run.state !== "done";
  const failed = run.failed?.length ? ` Not used: ${run.failed.join("; ")}.` : "";
  at("outcome").textContent = {
    idle: "", running: working(run.stages), cancelled: "Cancelled; earlier results are as they were.",
    failed: run.error, done: `${run.headline}${failed}`,
  }[run.state];
  at("outcome").className = run.state === "failed" ? "alert" : "";
  at("stages").replaceChildren(...run.stages.map((one) => {
    const item = document.createElement("li");
    const bar = document.createElement("progress");
    bar.max = one.total || 1;
    bar.value = one.done;
    bar.setAttribute("aria-label", one.stage);
    const steps = one.total ? `${one.done} of ${one.total}, ` : "";
    const round = one.round > 1 ? `round ${one.round}, ` : "";
    item.append(element("span", one.stage), bar, element("span", `${steps}${round}${seconds(one.seconds)}`));
    return item;
  }));
}

async function act(name, message = {}) {
  try {
    showRun(await (await ask(name, message)).json());
  } catch (error) {
    at("outcome").className = "alert";
    at("outcome").textContent = error.message;
  }
}

// Everything

function listen() {
  at("files").addEventListener("change", () => upload(at("files").files));
  const drop = document.querySelector(".taken");
  drop.addEventListener("dragover", (event) => {
    event.preventDefault();
    at("drop").classList.add("over");
  });
  drop.addEventListener("dragleave", () => at("drop").classList.remove("over"));
  drop.addEventListener("drop", (event) => {
    event.preventDefault();
    at("drop").classList.remove("over");
    upload(event.dataTransfer.files);
  });
  at("draft").addEventListener("click", () => change("draft"));
  at("target").addEventListener("click", () => change("target"));
  at("start").addEventListener("click", () => act("calibrate", { effort: at("effort").value }));
  at("cancel").addEventListener("click", () => act("cancel"));
  at("form").addEventListener("submit", (event) => event.preventDefault());
  at("close").addEventListener("click", () => at("large").close());
}

async function watch() {
  try {
    showChecks(await look("checks"));
    showRun(await look("calibration"));
  } catch (error) {
    say(at("watch-error"), error.message);
  }
  setTimeout(watch, LOOK_MS);
}

listen();
watchForm();
watch();
