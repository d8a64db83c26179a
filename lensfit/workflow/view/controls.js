// Controls of the camera and of knobs: a number, a slider where one helps, a way back.

import { ask } from "./asker.js";

const short = (value) =>
  value === null || value === undefined ? "" : value === "inf" ? "inf" : String(+(+value).toPrecision(5));

/** Millimetres of a length as people write it, or "inf"; the process reads it. */
async function distance(typed) {
  return (await (await ask("length", { typed })).json()).mm;
}

/** What a range allows, in words. */
function allowed({ kind, least, most, whole }) {
  const low = least === null || least === undefined ? "" : ` from ${short(least)}`;
  const high = most === null || most === undefined ? "" : ` to ${short(most)}`;
  return `give a ${whole ? "whole number" : kind || "number"}${low}${high}`;
}

/** Why a value does not count; undefined where it does. */
function refusal(spec, text, value) {
  const refused = (why) => `${why}; ${allowed(spec)}`;
  if (value === "inf") return undefined;
  if (Number.isNaN(value)) return refused(text === "" ? "This is no number" : `“${text}” is no number`);
  if (spec.whole && !Number.isInteger(value)) return refused(`${text} is not whole`);
  if (spec.least !== null && value < spec.least) return refused(`${text} is too small`);
  if (spec.most !== null && value > spec.most) return refused(`${text} is too large`);
  return undefined;
}

/** A control; `spec.to` and `spec.from` map a value to the slider's place and back. */
export function control(spec, changed) {
  const row = document.createElement("div");
  row.className = "knob";
  const label = document.createElement("label");
  const number = document.createElement("input");
  const back = document.createElement("button");
  label.textContent = spec.label;
  label.htmlFor = number.id = `k-${spec.name}`;
  number.type = spec.text_field ? "text" : "number";
  number.step = spec.whole ? 1 : "any";
  if (spec.least !== null && spec.least !== undefined) number.min = spec.least;
  if (spec.most !== null && spec.most !== undefined) number.max = spec.most;
  number.placeholder = spec.placeholder || "measured";
  back.type = "button";
  back.textContent = "↺";
  back.setAttribute("aria-label", `Reset ${spec.label}`);
  back.title = "Reset";
  row.append(label, number, back);
  let slider = null;
  const to = spec.to || Number;
  const from = spec.from || Number;
  if (spec.slider) {
    slider = document.createElement("input");
    slider.type = "range";
    [slider.min, slider.max] = spec.slider;
    slider.step = spec.step || (spec.whole ? 1 : (spec.slider[1] - spec.slider[0]) / 200);
    slider.setAttribute("aria-label", spec.label);
    row.append(slider);
  }
  const wrong = document.createElement("small");
  wrong.className = "alert";
  wrong.id = `e-${spec.name}`;
  wrong.setAttribute("role", "alert");
  number.setAttribute("aria-describedby", wrong.id);
  row.append(wrong);
  const blame = (sentence) => {
    wrong.textContent = sentence;
    wrong.hidden = !sentence;
    number.setAttribute("aria-invalid", Boolean(sentence));
  };
  if (spec.text) {
    const text = document.createElement("small");
    text.textContent = spec.text;
    text.id = `t-${spec.name}`;
    number.setAttribute("aria-describedby", `${wrong.id} ${text.id}`);
    row.append(text);
  }
  let current; // undefined where the lens and the plate have their way
  let shownText = "";
  let reading = null; // of what was typed, by the process
  const show = (value) => {
    current = value;
    reading = null;
    blame("");
    const shown = value === undefined ? spec.start : value;
    number.value = shownText = short(shown);
    if (slider && shown !== null && shown !== undefined) slider.value = to(shown);
    if (slider) slider.setAttribute("aria-valuetext", short(shown) || "as measured");
    row.classList.toggle("turned", value !== undefined);
  };
  slider?.addEventListener("input", () => {
    const value = from(+slider.value);
    show(value);
    changed(spec.name, value);
  });
  const refuse = (sentence) => {
    const inUse = short(current === undefined ? spec.start : current) || number.placeholder;
    blame(`${sentence}. In use: ${inUse}`);
    row.classList.add("turned"); // so that the way back is there
  };
  const take = (text, value) => {
    const why = refusal(spec, text, value);
    if (why) refuse(why);
    else set(value);
  };
  number.addEventListener("change", () => {
    const text = number.value.trim();
    reading = null;
    if (text === "" && !number.validity.badInput) set(undefined);
    else if (!spec.read) take(text, text === "" ? NaN : Number(text));
    else {
      // An answer counts unless something else was typed or shown meanwhile.
      const mine = spec.read(text).then(
        (value) => reading === mine && take(text, value),
        (error) => reading === mine && refuse(error.message));
      reading = mine;
    }
  });
  const set = (value) => {
    show(value);
    changed(spec.name, value);
  };
  back.addEventListener("click", () => set(undefined));
  show(undefined);
  /** Where the slider rests while there is no value. */
  const rest = (value) => {
    if (slider && value !== null) slider.value = to(value);
  };
  /** Another value of the lens and the plate, where nothing is turned. */
  const begin = (value) => {
    const isUntouched = wrong.hidden && !reading && number.value === shownText;
    spec.start = value;
    if (isUntouched) show(current);
  };
  /** Once what is typed was read. */
  const settled = () => reading;
  /** Why what is typed does not count, with the field's name; null where it does. */
  const fault = () => (wrong.hidden ? null : `${spec.label}: ${wrong.textContent}`);
  return { row, set, show, rest, begin, settled, fault, number };
}

/** A field that holds a distance. */
export const ofDistance = {
  text_field: true, read: distance, kind: "distance in mm", least: 0.001, most: 1e9,
};

/** The controls of the camera, from what the lens and the plate say. */
export function cameraSpecs(lens) {
  const { camera, ranges } = lens;
  // A stop wider than was measured, where a note says what the picture is made of.
  const widest = Math.log2(Math.min(ranges.widest_f_number || 1, +camera.f_number || 99)) - 0.5;
  const near = Math.min(ranges.nearest_focus_mm, +camera.focus_distance_mm || 1e9);
  const specs = [
    {
      name: "f_number", label: "f-number", start: camera.f_number, least: 0.1, most: 512,
      slider: [widest, 5], step: 1 / 12, to: (n) => Math.log2(n),
      from: (place) => +(2 ** place).toPrecision(3),
    },
    {
      name: "focus_distance_mm", label: "Focus distance (mm)", start: camera.focus_distance_mm,
      ...ofDistance, text: "Slider from infinity to near, evenly in dioptres",
      slider: [0, 1000 / near], step: 1000 / near / 400,
      to: (mm) => (mm === "inf" ? 0 : 1000 / mm),
      from: (dioptres) => (dioptres <= 0 ? "inf" : +(1000 / dioptres).toPrecision(5)),
    },
  ];
  const [shortest, longest] = ranges.focal_length_mm;
  if (longest > shortest) {
    specs.unshift({
      name: "focal_length_mm", label: "Focal length (mm)", start: camera.focal_length_mm,
      least: shortest, most: longest, slider: [shortest, longest],
    });
  }
  return specs;
}
