"""The report's figures as inline SVG: strokes, diagrams with two axes, the image frame.

Hand-made rather than plotted by a library: the strokes take their colours from the
page's style sheet, so that one file serves light, dark and paper, and the same report
always gives the same bytes. Coordinates are the user units of the view box, x right,
y down.

`Axes` maps data to view-box units with y up, `Frame` maps sensor millimetres or image
pixels with y down, both to the same width, so that figures line up on the page. Ticks
fall on 1, 2 or 5 times a power of ten.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float, Shaped

from lensfit.report.markup import Markup, number, tag
from lensfit.report.plain_numbers import round_up

WIDTH = 560.0
HEIGHT = 350.0


@final
@dataclass(frozen=True)
class Figure:
    """A picture, what it is called, and what the reader should see in it."""

    key: str
    title: str
    svg: Markup
    caption: str


def drawing(label: str, *children: Markup, height: float = HEIGHT) -> Markup:
    """One SVG picture with a spoken label."""
    box = f"0 0 {WIDTH:g} {height:g}"
    return tag("svg", *children, viewBox=box, role="img", aria_label=label)


def path(
    x: Float[np.ndarray, " points"], y: Float[np.ndarray, " points"], class_: str
) -> Markup:
    """A line through points in view-box units, broken where a coordinate is NaN."""
    return tag("path", d=_path_data(x, y), class_=class_)


def words(
    x: float, y: float, text: str, class_: str, anchor: str, turn: str | None = None
) -> Markup:
    """A line of text at view-box units."""
    at = {"x": f"{x:.1f}", "y": f"{y:.1f}", "text_anchor": anchor}
    return tag("text", text, class_=class_, transform=turn, **at)


def _path_data(x: np.ndarray, y: np.ndarray) -> str:
    pieces, pen_down = [], False
    for px, py in zip(x.tolist(), y.tolist(), strict=True):
        if not (math.isfinite(px) and math.isfinite(py)):
            pen_down = False
            continue
        pieces.append(f"{'L' if pen_down else 'M'}{px:.1f} {py:.1f}")
        pen_down = True
    return "".join(pieces)


LEFT, RIGHT, TOP, BOTTOM = 62.0, 22.0, 18.0, 48.0
_LINE_HEIGHT = 15.0
_ROOM_FOR_LETTERS = 34
"""Under a diagram, at the size of small figures."""


def ticks(low: float, high: float, count: int = 5) -> Float[np.ndarray, " ticks"]:
    """Round values (1, 2 or 5 times a power of ten) within [low, high]."""
    # Half a step short in the logarithm: about `count` ticks, rather than at most.
    step = round_up((high - low) / max(count, 1) / 1.5)
    first = math.ceil(low / step - 1e-9)
    last = math.floor(high / step + 1e-9)
    return np.arange(first, last + 1) * step


def tick_text(value: float) -> str:
    """A tick's number, without noise digits."""
    text = f"{value + 0.0:.6g}"
    return number(value, digits=1) if "e" in text else text.replace("-", "−")


@final
@dataclass(frozen=True)
class Axes:
    """A diagram's ranges, and where they lie in the view box.

    Attributes
    ----------
    x_range, y_range : data at the left and right, at the bottom and the top.
    """

    x_range: tuple[float, float]
    y_range: tuple[float, float]

    def place(
        self, x: Shaped[np.ndarray, " points"], y: Shaped[np.ndarray, " points"]
    ) -> tuple[Float[np.ndarray, " points"], Float[np.ndarray, " points"]]:
        """View-box units of data."""
        (x0, x1), (y0, y1) = self.x_range, self.y_range
        across = (np.asarray(x, float) - x0) / (x1 - x0)
        up = (np.asarray(y, float) - y0) / (y1 - y0)
        return (
            LEFT + across * (WIDTH - LEFT - RIGHT),
            HEIGHT - BOTTOM - up * (HEIGHT - TOP - BOTTOM),
        )

    def line(self, x: np.ndarray, y: np.ndarray, class_: str) -> Markup:
        """A curve."""
        return path(*self.place(x, y), class_=f"line {class_}")

    def band(
        self, x: np.ndarray, low: np.ndarray, high: np.ndarray, class_: str
    ) -> Markup:
        """The area between two curves, left out where either is undefined."""
        known = np.isfinite(x) & np.isfinite(low) & np.isfinite(high)
        if known.sum() < 2:
            return Markup("")
        x = x[known]
        there = self.place(x, low[known])
        back = self.place(x[::-1], high[known][::-1])
        both = [np.concatenate(pair) for pair in zip(there, back, strict=True)]
        return path(both[0], both[1], class_=f"band {class_}")

    def labels(self, ends: Sequence[tuple[float, float, str, str]]) -> list[Markup]:
        """Names right of the curves' ends (x, y, text, class), none on another."""
        written, lowest = [], -math.inf
        for x, y, text, class_ in sorted(ends, key=lambda end: -end[1]):
            px, py = self.place(np.array(x), np.array(y))
            lowest = max(float(py) + 4, lowest + _LINE_HEIGHT)
            written.append(words(float(px) + 7, lowest, text, f"tag {class_}", "start"))
        return written

    def mark(self, x: float, text: str) -> Markup:
        """A vertical line across the diagram with a word at its top."""
        px = self.place(np.array([x, x]), np.array(self.y_range))[0]
        stroke = path(px, np.array([HEIGHT - BOTTOM, TOP]), "mark")
        return Markup(stroke + words(px[0] - 5, TOP + 11, text, "small", "end"))

    def furniture(self, x_name: str, y_name: str) -> Markup:
        """Grid lines, numbers and the names of both axes."""
        parts = [*self._x_ticks(), *self._y_ticks()]
        middle_x = (LEFT + WIDTH - RIGHT) / 2
        middle_y = (TOP + HEIGHT - BOTTOM) / 2
        parts.append(words(middle_x, HEIGHT - 10, x_name, "axis", "middle"))
        turn = f"rotate(-90 14 {middle_y:g})"
        parts.append(words(14, middle_y, y_name, "axis", "middle", turn))
        return Markup("".join(parts))

    def _x_ticks(self) -> Iterable[Markup]:
        values = ticks(*self.x_range, count=7)
        if sum(len(tick_text(value)) for value in values) > _ROOM_FOR_LETTERS:
            values = ticks(*self.x_range, count=4)
        for value in values:
            px, py = self.place(np.full(2, value), np.array(self.y_range))
            yield path(px, py, "grid")
            yield words(px[0], HEIGHT - BOTTOM + 17, tick_text(value), "tick", "middle")

    def _y_ticks(self) -> Iterable[Markup]:
        for value in ticks(*self.y_range):
            px, py = self.place(np.array(self.x_range), np.full(2, value))
            yield path(px, py, "grid zero" if abs(value) < 1e-12 else "grid")
            yield words(LEFT - 8, py[0] + 4, tick_text(value), "tick", "end")


MARGIN = 26.0
"""View-box units left free around an image frame."""


@final
@dataclass(frozen=True)
class Frame:
    """The image frame drawn to its own proportions inside the view box.

    Attributes
    ----------
    low, high : frame coordinates (x, y) of its top left and bottom right corner.
    """

    low: tuple[float, float]
    high: tuple[float, float]

    @property
    def scale(self) -> float:
        """View-box units per frame unit."""
        return (WIDTH - 2 * MARGIN) / (self.high[0] - self.low[0])

    @property
    def height(self) -> float:
        """Height of the view box that holds the frame and its margins."""
        return 2 * MARGIN + self.scale * (self.high[1] - self.low[1])

    def place(
        self, x: Shaped[np.ndarray, " points"], y: Shaped[np.ndarray, " points"]
    ) -> tuple[Float[np.ndarray, " points"], Float[np.ndarray, " points"]]:
        """View-box units of frame positions."""
        return (
            MARGIN + (np.asarray(x, float) - self.low[0]) * self.scale,
            MARGIN + (np.asarray(y, float) - self.low[1]) * self.scale,
        )

    def border(self) -> Markup:
        """The edge of the frame."""
        (x0, y0), (x1, y1) = self.low, self.high
        x = np.array([x0, x1, x1, x0, x0])
        return path(*self.place(x, np.array([y0, y0, y1, y1, y0])), class_="border")

    def cell(self, x0: float, y0: float, x1: float, y1: float, **kind: str) -> Markup:
        """A filled rectangle between two frame positions."""
        x, y = self.place(np.array([x0, x1]), np.array([y0, y1]))
        size = {
            "width": f"{x[1] - x[0] + 0.3:.1f}",
            "height": f"{y[1] - y[0] + 0.3:.1f}",
        }
        return tag("rect", x=f"{x[0]:.1f}", y=f"{y[0]:.1f}", **size, **kind)

    def ruler(self, length: float, text: str) -> Markup:
        """A scale bar of so many view-box units under the frame's left corner."""
        x, y = MARGIN, self.height - MARGIN + 14
        bar = np.array([x, x, x, x + length, x + length, x + length])
        up = np.array([y - 4, y + 4, y, y, y - 4, y + 4])
        note = words(x + length + 8, y + 4, text, "small", "start")
        return Markup(path(bar, up, "ruler") + note)


def sensor_frame(camera: dict, x: np.ndarray, y: np.ndarray) -> Frame:
    """The sensor, or the extent of a grid if the sensor size is not stated."""
    width = camera.get("sensor_width_mm") or float(np.ptp(x)) or 1.0
    height = camera.get("sensor_height_mm") or float(np.ptp(y)) or 1.0
    return Frame((-width / 2, -height / 2), (width / 2, height / 2))
