"""Values over the frame as a smooth colour field with contours: uncertainty, fall-off.

Values are interpolated linearly between the grid's points and drawn as one small
picture in cividis (Nunez, Anderton, Renslow 2018), which reads the same to colour-blind
eyes and in grey; where nothing is known the picture is transparent.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import final

import cv2
import numpy as np
from jaxtyping import Float
from skimage.measure import find_contours

from lensfit.report.evidence import numbers
from lensfit.report.markup import Markup, number, stated_value, tag
from lensfit.report.pictures import png_address
from lensfit.report.svg import (
    MARGIN,
    WIDTH,
    Figure,
    Frame,
    drawing,
    path,
    sensor_frame,
    tick_text,
    ticks,
    words,
)

_PICTURE_WIDTH = 200
_FINE = (65, 49)
_RIM = 0.08
_MIDDLE = np.array([0.5, 0.5])
"""Where the value of the middle stands, as shares of the frame."""
_STEEP = 4.0
"""Largest value over the usual one from which even steps would all be in corners."""
_LEAST_STOPS = 1e-4
_CIVIDIS = np.array(
    [
        (0, 34, 78), (35, 62, 108), (87, 92, 109), (124, 123, 120), (165, 156, 116),
        (210, 192, 96), (254, 232, 56),
    ]
)  # fmt: skip


@final
@dataclass(frozen=True)
class FieldMap:
    """Values over the frame.

    Attributes
    ----------
    x, y : Of columns and rows, sensor mm.
    values : Row 0 on top; NaN where nothing is known.
    unit : Of the values.
    """

    x: Float[np.ndarray, " columns"]
    y: Float[np.ndarray, " rows"]
    values: Float[np.ndarray, "rows columns"]
    unit: str

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest."""
        return float(np.nanmin(self.values)), float(np.nanmax(self.values))


def uncertainty(entry: dict, camera: dict) -> Figure | None:
    """Predicted standard deviation of the imaged position over the frame."""
    grid = entry.get("uncertainty_grid") or {}
    x, y, sd = (numbers(grid.get(k)) for k in ("x_mm", "y_mm", "sd_px"))
    if sd.shape != (y.size, x.size) or sd.size < 4 or not np.isfinite(sd).any():
        return None
    known = FieldMap(x, y, sd, "px")
    low, high = known.range
    caption = "How far the map may be from the truth (1σ of the imaged position, px), "
    caption += f"if the model is right: {number(low, 'px', 2)} at best, "
    caption += f"{number(high, 'px', 2)} at worst. Lines join places known alike."
    picture = drawn_map("Uncertainty", known, camera)
    return Figure("uncertainty", "Uncertainty over the frame", picture, caption)


def fall_off_surface(entry: dict, camera: dict) -> Figure | None:
    """Light lost over the frame at the widest f-number that was measured, in stops."""
    stops = [
        one
        for one in entry.get("fall_off") or []
        if numbers(one.get("radius_mm")).size > 1
        and numbers(one.get("g")).shape == numbers(one.get("radius_mm")).shape
    ]
    size = [camera.get(key) or 0.0 for key in ("sensor_width_mm", "sensor_height_mm")]
    if not stops or not all(size):
        return None
    widest = min(stops, key=lambda one: one.get("f_number") or np.inf)
    x, y = (
        np.linspace(-side / 2, side / 2, n) for side, n in zip(size, _FINE, strict=True)
    )
    centre = entry.get("principal_point_mm") or (0.0, 0.0)
    radius = np.hypot(x[None] - centre[0], y[:, None] - centre[1])
    measured, light = numbers(widest["radius_mm"]), numbers(widest["g"])
    known = np.interp(radius, measured, light, right=np.nan)
    lost = FieldMap(x, y, _visible(-np.log2(np.maximum(known, 1e-6))), "stops")
    stop = widest.get("f_number")
    name = f"f/{stated_value(round(stop, 1))}" if stop else "an f-number not stated"
    caption = f"Light lost in green at {name}, in stops."
    if widest.get("lighting_too"):
        caption += " Of lens and lighting together."
    if np.isnan(known).any():
        caption += " Left open: farther out than any point."
    picture = drawn_map("Fall-off over the frame", lost, camera)
    return Figure("fall-off-surface", "Fall-off over the frame", picture, caption)


def _visible(stops: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Nothing where almost nothing is lost: light is kept to five decimals."""
    return np.where(np.abs(stops) < _LEAST_STOPS, 0.0, stops)


def drawn_map(label: str, known: FieldMap, camera: dict) -> Markup:
    """A field of colour, lines of equal value, numbers in the corners, and a key."""
    frame = sensor_frame(camera, known.x, known.y)
    low, high = known.range
    share = np.zeros_like(known.values)
    if high > low:
        share = (known.values - low) / (high - low)
    marks = [
        words(px, py, number(float(known.values[j, i]), digits=2), "onmap", anchor)
        for (j, i, px, py, anchor) in _corner_places(frame, known.values)
        if np.isfinite(known.values[j, i])
    ]
    shapes = [
        _field(frame, known.x, known.y, share),
        *_contours(frame, known),
        *marks,
        frame.border(),
        _heat_key(frame, low, high, known.unit),
    ]
    return drawing(label, *shapes, height=frame.height + 22)


def _contours(frame: Frame, known: FieldMap) -> Iterator[Markup]:
    """Lines of equal value at round values, and what the value is."""
    low, high = known.range
    if not high > low:
        return
    labelled: list[np.ndarray] = []
    for level in _levels(known):
        # A contour ends where a neighbour is not known.
        found = find_contours(known.values, level)
        for line in found:
            x = np.interp(line[:, 1], np.arange(known.x.size), known.x)
            y = np.interp(line[:, 0], np.arange(known.y.size), known.y)
            yield path(*frame.place(x, y), class_="contour")
        if found:
            yield from _label(frame, known, max(found, key=len), level, labelled)


def _levels(known: FieldMap) -> list[float]:
    """Round values in even steps; 1, 2, 5, 10 where most of the frame lies far below
    the largest value."""
    low, high = known.range
    usual = float(np.nanmedian(known.values))
    if high < _STEEP * usual or usual <= 0:
        return ticks(low, high, count=4).tolist()
    powers = range(math.floor(math.log10(usual)), math.ceil(math.log10(high)) + 1)
    series = [step * 10.0**power for power in powers for step in (1, 2, 5)]
    return [level for level in series if usual < level < high]


def _label(
    frame: Frame,
    known: FieldMap,
    line: np.ndarray,
    level: float,
    labelled: list[np.ndarray],
) -> Iterator[Markup]:
    """The value, where its line is inside the frame and farthest from other values;
    none at the rim, where the numbers of the corners are.

    Parameters
    ----------
    labelled : Places of the values so far, as shares of the frame; this one is added.
    """
    last = np.array(known.values.shape) - 1.0
    shares = line / last
    inside = np.minimum(shares, 1 - shares).min(1)
    away = [np.linalg.norm(shares - other, axis=1) for other in [_MIDDLE, *labelled]]
    room = np.where(inside < _RIM, 0.0, np.min([*away, inside], axis=0))
    best = int(np.argmax(room))
    if room[best] == 0:
        return
    labelled.append(shares[best])
    row, column = line[best]
    x = np.interp(column, np.arange(known.x.size), known.x)
    y = np.interp(row, np.arange(known.y.size), known.y)
    px, py = frame.place(np.array(x), np.array(y))
    yield words(float(px), float(py) + 4, tick_text(float(level)), "onmap", "middle")


def _field(frame: Frame, x: np.ndarray, y: np.ndarray, share: np.ndarray) -> Markup:
    """The colour field over the frame, as an embedded picture."""
    (x0, y0), (x1, y1) = frame.low, frame.high
    height = max(2, round(_PICTURE_WIDTH * (y1 - y0) / (x1 - x0)))
    across = x0 + (np.arange(_PICTURE_WIDTH) + 0.5) / _PICTURE_WIDTH * (x1 - x0)
    down = y0 + (np.arange(height) + 0.5) / height * (y1 - y0)
    rows = np.stack([np.interp(across, x, row) for row in share])
    fine = np.stack([np.interp(down, y, column) for column in rows.T], axis=1)
    known = np.isfinite(fine)
    bgra = np.zeros((*fine.shape, 4), dtype=np.uint8)
    bgra[..., :3] = np.rint(_colours(np.where(known, fine, 0.0)))[..., ::-1]
    bgra[..., 3] = np.where(known, 255, 0)
    encoded = cv2.imencode(".png", bgra)[1].tobytes()
    px, py = frame.place(np.array([x0, x1]), np.array([y0, y1]))
    return tag(
        "image",
        href=png_address(encoded),
        x=f"{px[0]:.1f}",
        y=f"{py[0]:.1f}",
        width=f"{px[1] - px[0]:.1f}",
        height=f"{py[1] - py[0]:.1f}",
        preserveAspectRatio="none",
    )


def _colours(share: Float[np.ndarray, "..."]) -> Float[np.ndarray, "... 3"]:
    """Cividis red, green and blue (0 to 255) at shares between 0 and 1."""
    at = np.linspace(0, 1, len(_CIVIDIS))
    return np.stack([np.interp(share, at, _CIVIDIS[:, k]) for k in range(3)], axis=-1)


def _corner_places(frame: Frame, sd: np.ndarray) -> Iterator[tuple]:
    left, right = MARGIN + 8, WIDTH - MARGIN - 8
    top, bottom = MARGIN + 18, frame.height - MARGIN - 10
    yield 0, 0, left, top, "start"
    yield 0, -1, right, top, "end"
    yield -1, 0, left, bottom, "start"
    yield -1, -1, right, bottom, "end"
    rows, columns = sd.shape
    middle = (frame.height / 2) + 5
    yield rows // 2, columns // 2, WIDTH / 2, middle, "middle"


def _heat_key(frame: Frame, low: float, high: float, unit: str) -> Markup:
    """The colour scale under the frame."""
    y, width, steps = frame.height - MARGIN + 10, 160.0, 40
    parts = []
    for k, rgb in enumerate(_colours(np.linspace(0, 1, steps))):
        fill = "#{:02x}{:02x}{:02x}".format(*(round(float(c)) for c in rgb))
        box = {"x": f"{MARGIN + k * width / steps:.1f}", "y": f"{y:.1f}"}
        parts.append(tag("rect", **box, width="4.4", height="9", fill=fill))
    ends = [tick_text(float(f"{value:.2g}")) for value in (low, high)]
    right = MARGIN + width
    parts.append(words(MARGIN, y + 25, ends[0], "small", "start"))
    parts.append(words(right, y + 25, f"{ends[1]} {unit}", "small", "end"))
    return Markup("".join(parts))
