// Letters of a drawn figure, which are larger here than in a report: none lies on another.

const GAP = 6; // units of the view box
const boxOf = (one) => one.getBBox();

/** Move the name of the upright axis out to the left of the axis' numbers. */
function clearOfNumbers(svg) {
  const low = svg.viewBox.baseVal.x;
  const numbers = [...svg.querySelectorAll("text.tick")].filter((one) => one.getAttribute("text-anchor") === "end");
  const name = svg.querySelector("text.axis[transform]");
  if (!name || !numbers.length) return low;
  const left = Math.min(...numbers.map((one) => boxOf(one).x)) - GAP;
  const box = boxOf(name); // before it is turned about its own place
  const middle = +name.getAttribute("x");
  const base = +name.getAttribute("y");
  const right = middle + (box.y + box.height - base);
  const away = Math.max(right - left, 0);
  name.setAttribute("transform", `translate(${-away} 0) ${name.getAttribute("transform")}`);
  return Math.min(low, middle + (box.y - base) - away - GAP / 2);
}

/** Move names of curves apart, in their order from the top; those at the foot go up. */
function spread(svg) {
  const tags = [...svg.querySelectorAll("text.tag")].sort((one, other) => one.getAttribute("y") - other.getAttribute("y"));
  if (!tags.length) return;
  const { y: top, height: high } = svg.viewBox.baseVal;
  const { height } = boxOf(tags[0]);
  const places = tags.map((one) => +one.getAttribute("y"));
  for (let k = 1; k < places.length; k += 1) places[k] = Math.max(places[k], places[k - 1] + height);
  let most = top + high - GAP;
  for (let k = places.length - 1; k >= 0; k -= 1) {
    places[k] = Math.min(places[k], most);
    most = places[k] - height;
  }
  tags.forEach((one, k) => one.setAttribute("y", places[k]));
}

/** Numbers at both ends of a colour scale: the second begins where the first has ended. */
function partEnds(svg) {
  const ends = [...svg.querySelectorAll("text.small")].sort((one, other) => boxOf(one).x - boxOf(other).x);
  for (let k = 1; k < ends.length; k += 1) {
    const before = boxOf(ends[k - 1]);
    const over = before.x + before.width + GAP - boxOf(ends[k]).x;
    if (over > 0 && ends[k].getAttribute("y") === ends[k - 1].getAttribute("y")) {
      ends[k].setAttribute("x", +ends[k].getAttribute("x") + over);
    }
  }
  svg.append(...ends); // above the curves
}

/** Part the letters of a figure that is on the page, and widen its box to hold them. */
export function partLetters(svg) {
  const { y, width, height, x } = svg.viewBox.baseVal;
  spread(svg);
  partEnds(svg);
  const left = clearOfNumbers(svg);
  const ends = [...svg.querySelectorAll("text.tag")].map((one) => boxOf(one).x + boxOf(one).width + GAP / 2);
  const right = Math.max(x + width, ...ends);
  svg.setAttribute("viewBox", `${left} ${y} ${right - left} ${height}`);
}
