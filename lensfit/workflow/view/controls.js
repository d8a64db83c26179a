// Controls of the camera and of knobs: a number, a slider where one helps, a way back.

const short = (value) =>
  value === null || value === undefined ? "" : value === "inf" ? "inf" : String(+(+value).toPrecision(5));

const MM = { mm: 1, cm: 10, m: 1000, in: 25.4, ft: 304.8 };
const INFINITE = ["inf", "infinity", "∞"];

/** A distance in millimetres of a text with or without a unit, "inf", or NaN. */
function distance(text) {
  if (INFINITE.includes(text.toLowerCase())) return "inf";
  const [, number, unit] = text.match(/^(\d+\.?\d*|\.\d+)\s*(mm|cm|m|in|ft)?$/i) || [];
  return number === undefined ? NaN : +(number * MM[(unit || "mm").toLowerCase()]).toPrecision(12);
}

/** What a range allows, in words. */
function allowed({ least, most, whole, example }) {
  if (example) return `write ${example}`;
  const kind = whole ? "a whole number" : "a number";
  const low = least === null || least === undefined ? "" : ` from ${short(least)}`;
  const high = most === null || most === undefined ? "" : ` to ${short(most)}`;
  return `give ${kind}${low}${high}`;
}

/** What was typed: its value (undefined for none), or a sentence on why it is none. */
function read(spec, number) {
  const text = number.value.trim();
  if (text === "" && !number.validity.badInput) return { value: undefined };
  const value = text === "" ? NaN : spec.read ? spec.read(text) : Number(text);
  const refused = (why) => ({ fault: `${why}; ${allowed(spec)}. The picture stays as it was` });
  if (Number.isNaN(value)) return refused(text === "" ? "This is no number" : `“${text}” is no ${spec.kind || "number"}`);
  if (value === "inf") return { value };
  if (spec.whole && !Number.isInteger(value)) return refused(`${text} is not whole`);
  if (spec.least !== null && value < spec.least) return refused(`${text} is too small`);
  if (spec.most !== null && value > spec.most) return refused(`${text} is too large`);
  return { value };
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
  const show = (value) => {
    current = value;
    blame("");
    const shown = value === undefined ? spec.start : value;
    number.value = short(shown);
    if (slider && shown !== null && shown !== undefined) slider.value = to(shown);
    if (slider) slider.setAttribute("aria-valuetext", short(shown) || "as measured");
    row.classList.toggle("turned", value !== undefined);
  };
  slider?.addEventListener("input", () => {
    const value = from(+slider.value);
    show(value);
    changed(spec.name, value);
  });
  number.addEventListener("change", () => {
    const { value, fault } = read(spec, number);
    if (fault) {
      blame(fault);
      row.classList.add("turned"); // so that the way back is there
    } else set(value);
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
    spec.start = value;
    if (wrong.hidden) show(current);
  };
  /** Why what is typed does not count, with the field's name; null where it does. */
  const fault = () => (wrong.hidden ? null : `${spec.label}: ${wrong.textContent}`);
  return { row, set, show, rest, begin, fault, number };
}

/** A field that holds a distance. */
export const ofDistance = {
  text_field: true, read: distance, kind: "distance", least: 0.001, most: 1e9,
  example: "millimetres, 1.5 m, 5 ft or inf",
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
