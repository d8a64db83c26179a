// The page of a lens: what is turned, and what every lens draws of it.

import { Asker, fetched } from "./asker.js";
import { cameraSpecs, control, ofDistance } from "./controls.js";
import { partLetters } from "./letters.js";

const at = (id) => document.getElementById(id);
const CAMERA = ["focal_length_mm", "f_number", "focus_distance_mm"];
const OBJECT = ["object_distance_mm", "x", "y"];
// Tiles of the field lie at these shares of the way to the frame's edges.
const SPAN = { x: 0.9 / 0.4, y: 0.9 / (1 / 3) };
const NUDGE = 0.05;
const DRAWINGS = {
  point: "the point", field: "the field", through: "through focus and aperture", figures: "the curves",
};

const turned = { camera: {}, object: {}, knobs: {} };
const controls = {};
const columns = [];
let version = 0;

const message = () => ({ ...turned.camera, ...turned.object, knobs: turned.knobs });
const clamp = (value) => Math.min(Math.max(value, -1), 1);
const short = (value, digits = 3) => String(+Number(value).toPrecision(digits));
const metres = (mm) => (mm === "inf" ? "∞" : short(mm / 1000));
const wide = (found) => `${short(found.width_px)} px (${short(found.width_mm)} mm)`;
const percent = (share) => `${short(100 * share, 2)} %`;

function element(name, text, className = "") {
  const found = document.createElement(name);
  found.textContent = text;
  found.className = className;
  return found;
}

/** What one lens shows. */
class Column {
  constructor(place, lens) {
    this.root = at("column").content.cloneNode(true).firstElementChild;
    this.place = place;
    this.find("h2").textContent = [lens.lens, lens.serial].filter(Boolean).join(", ");
    this.wanted = {}; // the version of each drawing that is not there yet
    this.askers = Object.keys(DRAWINGS).map(
      (name) => new Asker(
        name,
        async (answer, asked) => {
          if (asked !== this.wanted[name] && name !== "point") return;
          this[name](await answer.json());
          this.say(null);
          this.root.dataset[name] = asked;
          this.came(name, asked);
        },
        (error, asked) => {
          if (asked === this.wanted[name]) this.say(error);
          this.came(name, asked);
        },
      ),
    );
    this.drag();
  }

  find(selector) {
    return this.root.querySelector(selector);
  }

  say(error) {
    const line = this.find(".alert");
    line.hidden = !error;
    line.textContent = error ? error.message : "";
  }

  /** A drawing is there, or cannot be. */
  came(name, asked) {
    if (this.wanted[name] === asked) delete this.wanted[name];
    this.sayWhatIsDrawn();
  }

  sayWhatIsDrawn() {
    const names = Object.keys(DRAWINGS).filter((name) => name in this.wanted);
    this.find(".working").textContent = names.length
      ? `Computing ${names.map((name) => DRAWINGS[name]).join(", ")} …` : "";
  }

  want(what) {
    for (const name of what) this.wanted[name] = version;
    this.sayWhatIsDrawn();
    for (const asker of this.askers) {
      if (what.includes(asker.name)) asker.want(version, { ...message(), lens: this.place, one_scale: true });
    }
  }

  move(x, y) {
    const handle = this.find(".handle");
    handle.style.left = `${50 + (100 * x) / SPAN.x}%`;
    handle.style.top = `${50 + (100 * y) / SPAN.y}%`;
  }

  drag() {
    const field = this.find(".field");
    const moved = (event) => {
      if (!field.hasPointerCapture(event.pointerId)) return;
      const box = field.getBoundingClientRect();
      setPoint(
        clamp(SPAN.x * ((event.clientX - box.left) / box.width - 0.5)),
        clamp(SPAN.y * ((event.clientY - box.top) / box.height - 0.5)),
      );
    };
    field.addEventListener("pointerdown", (event) => {
      field.setPointerCapture(event.pointerId);
      moved(event);
      this.find(".handle").focus();
      event.preventDefault();
    });
    field.addEventListener("pointermove", moved);
    this.find(".handle").addEventListener("keydown", (event) => {
      const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
      if (!step) return;
      event.preventDefault();
      setPoint(clamp(pointOf("x") + NUDGE * step[0]), clamp(pointOf("y") + NUDGE * step[1]));
    });
  }

  field(found) {
    this.find(".field img").src = found.picture;
    const known = found.errors
      ? ` Their shape is known to ${percent(found.errors[1][1])} in the middle, ${percent(Math.max(...found.errors.flat()))} at worst (1σ).`
      : " The preset does not say how well they are known.";
    this.find(".pair figcaption").textContent =
      `A point of green light; each tile ${wide(found)} wide, against its own peak.${known} ` +
      found.notes.join(". ");
  }

  point(found) {
    this.find(".spot").src = found.picture;
    const deviation = this.find(".deviation");
    deviation.hidden = !found.deviation;
    if (found.deviation) deviation.src = found.deviation;
    const known = found.error === null ? "" : ` Beside it the standard deviation, on the same scale; its shape is known to ${percent(found.error)} (1σ).`;
    this.find(".pair figure:last-child figcaption").textContent =
      `At ${found.x_mm}, ${found.y_mm} mm from the middle, ${wide(found)} wide.${known}`;
  }

  through(found) {
    const grid = this.find(".through .grid");
    grid.style.setProperty("--rows", found.f_numbers.length);
    grid.replaceChildren(
      this.find(".through img"),
      ...found.f_numbers.map((stop) => element("span", `f/${short(stop, 2)}`, "stop")),
      ...found.distances_mm.map((mm, place) => {
        const label = element("span", metres(mm), "far");
        label.style.gridColumn = place + 2;
        return label;
      }),
    );
    this.find(".through img").src = found.picture;
    this.find(".through figcaption").textContent =
      `The point at distances from the sensor (across, in metres) and f-numbers (down); tiles ${wide(found)} wide.`;
  }

  figures(found) {
    this.find(".drawn").replaceChildren(...found.map((one) => {
      const figure = document.createElement("figure");
      const svg = new DOMParser().parseFromString(one.svg, "text/html").body.firstElementChild;
      figure.dataset.figure = one.key;
      figure.append(element("h3", one.title), svg, element("figcaption", one.caption));
      return figure;
    }));
    this.root.querySelectorAll(".drawn svg").forEach(partLetters);
  }
}

const pointOf = (axis) => turned.object[axis] ?? 0;

function changed(what = Object.keys(DRAWINGS)) {
  version += 1;
  for (const column of columns) {
    column.move(pointOf("x"), pointOf("y"));
    column.want(what);
  }
}

function setPoint(x, y) {
  Object.assign(turned.object, { x: +x.toFixed(3), y: +y.toFixed(3) });
  controls.x.show(turned.object.x);
  controls.y.show(turned.object.y);
  changed(["point", "through"]);
}

function turn(name, value) {
  const group = CAMERA.includes(name) ? turned.camera : OBJECT.includes(name) ? turned.object : turned.knobs;
  if (value === undefined) delete group[name];
  else group[name] = value;
  if (name === "x" || name === "y") changed(["point", "through"]);
  else if (name === "object_distance_mm") changed(["point", "field", "through"]);
  else changed();
}

function objectSpecs(lens) {
  const near = lens.ranges.nearest_focus_mm / 2;
  const share = { least: -1, most: 1, slider: [-1, 1], step: 0.01, start: 0 };
  return [
    {
      name: "object_distance_mm", label: "Distance (mm)", start: null, ...ofDistance, placeholder: "in focus",
      text: "From the sensor; slider from infinity to near, evenly in dioptres",
      slider: [0, 1000 / near], step: 1000 / near / 400,
      to: (mm) => (mm === "inf" ? 0 : 1000 / mm),
      from: (dioptres) => (dioptres <= 0 ? "inf" : +(1000 / dioptres).toPrecision(5)),
    },
    { name: "x", label: "Across: −1 left, 1 right", ...share },
    { name: "y", label: "Down: −1 top, 1 bottom", ...share },
  ];
}

function add(spec, parent) {
  controls[spec.name] = control(spec, turn);
  parent.append(controls[spec.name].row);
}

function build(found) {
  const [first] = found.lenses;
  for (const spec of cameraSpecs(first)) add(spec, at("camera"));
  for (const spec of objectSpecs(first)) add(spec, at("object"));
  controls.object_distance_mm.rest(first.camera.focus_distance_mm);
  for (const group of found.groups) {
    const details = document.createElement("details");
    details.append(element("summary", group.name));
    for (const knob of group.knobs) {
      const start = knob.name in first.knobs ? first.knobs[knob.name] : knob.neutral;
      add({ ...knob, start }, details);
    }
    at("groups").append(details);
  }
  at("reset").addEventListener("click", () => {
    Object.assign(turned, { camera: {}, object: {}, knobs: {} });
    for (const one of Object.values(controls)) one.show(undefined);
    changed();
  });
  at("controls").addEventListener("submit", (event) => event.preventDefault());
}

function buildDots(dots) {
  if (!dots.length) return;
  at("photographs").hidden = false;
  at("dots").append(...dots.map((one, place) => {
    const state = [
      one.f_number && `f/${one.f_number}`,
      one.focus_distance_mm && `focus ${metres(one.focus_distance_mm)} m`,
      one.target_distance_mm && `chart at ${metres(one.target_distance_mm)} m`,
    ].filter(Boolean).join(", ");
    const option = element("option", `${one.image}: ${state}; misfit ${percent(one.misfit)} of ${one.dots} dots`);
    option.value = place;
    return option;
  }));
  const show = () => (at("dots-picture").src = `api/dots/${at("dots").value}`);
  at("dots").addEventListener("change", show);
  show();
}

async function start() {
  const answer = await fetched("lens");
  const found = await answer.json();
  if (!answer.ok) throw new Error(found.error);
  const names = found.lenses.map((one) => one.lens).join(" beside ");
  document.title = `${names}: lensfit view`;
  at("title").textContent = names;
  at("verdict").textContent = found.lenses.length > 1 ? "" : found.lenses[0].verdict || "";
  at("report").hidden = !found.report;
  at("columns").dataset.count = found.lenses.length;
  found.lenses.forEach((lens, place) => {
    columns.push(new Column(place, lens));
    at("columns").append(columns[place].root);
  });
  at("status").hidden = true;
  build(found);
  buildDots(found.dots);
  changed();
}

start().catch((error) => {
  at("status").hidden = true;
  at("error").hidden = false;
  at("error").textContent = error.message;
});
