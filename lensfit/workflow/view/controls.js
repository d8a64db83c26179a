// Controls of the camera and of knobs: a number, a slider where one helps, a way back.

const short = (value) =>
  value === null || value === undefined ? "" : value === "inf" ? "inf" : String(+(+value).toPrecision(5));

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
  if (spec.text) {
    const text = document.createElement("small");
    text.textContent = spec.text;
    text.id = `t-${spec.name}`;
    number.setAttribute("aria-describedby", text.id);
    row.append(text);
  }
  let current; // undefined where the lens and the plate have their way
  const show = (value) => {
    current = value;
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
    const text = number.value.trim();
    if (text === "" || !number.checkValidity()) {
      if (text === "") set(undefined);
      return;
    }
    set(text === "inf" ? "inf" : +text);
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
    show(current);
  };
  return { row, set, show, rest, begin };
}

/** The controls of the camera, from what the lens and the plate say. */
export function cameraSpecs(lens) {
  const { camera, ranges } = lens;
  const widest = Math.log2(Math.min(ranges.widest_f_number || 1, +camera.f_number || 99));
  const near = Math.min(ranges.nearest_focus_mm, +camera.focus_distance_mm || 1e9);
  const specs = [
    {
      name: "f_number", label: "f-number", start: camera.f_number, least: 0.1, most: 512,
      slider: [widest, 5], step: 1 / 12, to: (n) => Math.log2(n),
      from: (place) => +(2 ** place).toPrecision(3),
    },
    {
      name: "focus_distance_mm", label: "Focus distance (mm)", start: camera.focus_distance_mm,
      text_field: true, text: "Slider from infinity to near, evenly in dioptres",
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
