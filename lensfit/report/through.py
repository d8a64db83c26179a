"""Point-spread functions through focus and through the aperture, for the report.

They are of one focus distance, that of the sharpest photograph: a point of light at
several distances, at several f-numbers, at three places of the frame. A photograph with
the lens focused elsewhere counts as photographed here too, at the distance that is as
far out of focus (the same vergence from the plane of focus). A figure for each place
has distances across and f-numbers down.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from lensfit.errors import LensfitError
from lensfit.lens import Lens
from lensfit.preset.schema import Preset
from lensfit.preset.store import load_preset
from lensfit.report.kernels import (
    GAMMA,
    SIZE_PX,
    KernelState,
    kernel_states,
    kernels_at,
    lenses_at,
    pixel_of_blur_mm,
    reach_share,
    tiles_of,
)
from lensfit.report.markup import Markup, number, tag
from lensfit.report.pictures import png, png_address, sheet_of
from lensfit.report.report_sections import distance_text, figure_html, stop_text
from lensfit.report.svg import WIDTH, Figure, drawing, words

HEIGHTS = {"Middle of the frame": 0.0, "Half way": 0.45, "Near the corner": 0.9}
"""Places, as shares of the way from the middle to the lower right corner."""
DISTANCES, MOST_STOPS, MOST_FOCAL_LENGTHS = 7, 4, 3
_FULL_STOPS = (1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0, 11.0, 16.0, 22.0)
_SAME_STOP = 0.2
BEYOND = 1.5
"""How much farther out of focus than photographed the outermost distances are."""
_IN_FOCUS = 0.05
"""Of the range of defocus: what counts as none."""
_USUAL_RADIUS_PX = 12.0
_TOLERANCE, _GLANCE, _ROOM = 0.08, 0.2, 1.25


@dataclass(frozen=True, eq=False)
class ThroughSheet:
    """Predictions of one focal length.

    Attributes
    ----------
    focal_length_mm, focus_distance_mm : Of the lens.
    f_numbers, distances_mm : Of the rows and columns.
    photographed : Which of them were.
    pictures : PNG of each place in `HEIGHTS`.
    width_px : Of a tile, in pixels of the camera.
    """

    focal_length_mm: float | None
    focus_distance_mm: float | None
    f_numbers: tuple[float, ...]
    distances_mm: tuple[float, ...]
    photographed: Bool[np.ndarray, "stops distances"]
    pictures: tuple[bytes, ...]
    width_px: float


class _Plan(NamedTuple):
    """What to draw of one focal length; `defocus` in 1/mm of vergence."""

    focal_length_mm: float | None
    focus_distance_mm: float | None
    f_numbers: tuple[float, ...]
    defocus: tuple[float, ...]
    seen: set[tuple[float, float]]


def through_sheets(report: dict, preset_path: Path) -> list[ThroughSheet]:
    """One sheet for each focal length whose blur was measured; none without preset."""
    pixel_mm = pixel_of_blur_mm(report)
    if pixel_mm is None:
        return []
    try:
        preset = load_preset(preset_path)
        states = kernel_states(report, preset)
        return _sheets(preset, states, pixel_mm)
    except LensfitError:
        return []


def _sheets(
    preset: Preset, states: list[KernelState], pixel_mm: float
) -> list[ThroughSheet]:
    focals = list(dict.fromkeys(state.focal_length_mm for state in states))
    found = []
    for focal in focals[:MOST_FOCAL_LENGTHS]:
        mine = [state for state in states if state.focal_length_mm == focal]
        plan = _plan(mine, lenses_at(preset, mine), pixel_mm)
        wanted = [
            KernelState(focal, plan.focus_distance_mm, stop, 0.0)
            for stop in plan.f_numbers
        ]
        # Beside all states, so that the program of those serves these.
        lenses = lenses_at(preset, [*states, *wanted])[len(states) :]
        found.append(_sheet(plan, lenses, pixel_mm))
    return found


def _plan(states: list[KernelState], lenses: list[Lens], pixel_mm: float) -> _Plan:
    defocus = [
        round(
            _vergence(lens, state.object_distance_mm) - lens.blur_per_vergence()[1], 7
        )
        for lens, state in zip(lenses, states, strict=True)
    ]
    sharpest = int(np.argmin(np.abs(defocus)))
    widest = min(range(len(states)), key=lambda k: states[k].f_number)
    usual = usual_defocus(lenses[widest], pixel_mm)
    to_focus = lenses[sharpest].blur_per_vergence()[1]
    stops = f_numbers_of([state.f_number for state in states])
    return _Plan(
        focal_length_mm=states[0].focal_length_mm,
        focus_distance_mm=states[sharpest].focus_distance_mm,
        f_numbers=stops,
        defocus=defocus_of(defocus, usual, -to_focus),
        seen={(s.f_number, d) for s, d in zip(states, defocus, strict=True)},
    )


def usual_defocus(lens: Lens, pixel_mm: float) -> float:
    """How far out of focus to go on a side that was not photographed, 1/mm."""
    per_vergence, _ = lens.blur_per_vergence()
    return _USUAL_RADIUS_PX * pixel_mm / per_vergence if per_vergence > 0 else 1e-4


def f_numbers_of(photographed: list[float]) -> tuple[float, ...]:
    """Up to `MOST_STOPS`: those photographed, and full stops beyond the widest."""
    stops = sorted(set(photographed))
    if len(stops) > MOST_STOPS:
        chosen = np.linspace(0, len(stops) - 1, MOST_STOPS).round().astype(int)
        return tuple(stops[k] for k in chosen)
    for full in _FULL_STOPS:
        known = any(abs(full / stop - 1) < _SAME_STOP for stop in stops)
        if full > stops[0] and not known and len(stops) < MOST_STOPS:
            stops.append(full)
    return tuple(sorted(stops))


def defocus_of(
    photographed: list[float], usual: float, farthest: float
) -> tuple[float, ...]:
    """`DISTANCES` values of defocus, from far to near, those photographed among them.

    Parameters
    ----------
    photographed : Vergence of the object less that of the plane of focus, 1/mm.
    usual : How far to go on a side that was not photographed.
    farthest : Defocus of an object at infinity.
    """
    values = sorted(set(photographed))
    if min(map(abs, values)) > _IN_FOCUS * (values[-1] - values[0]):
        values = sorted([*values, 0.0])
    while len(values) > DISTANCES - 2:
        # The most crowded goes, never the ends.
        crowded = min(
            range(1, len(values) - 1), key=lambda k: values[k + 1] - values[k - 1]
        )
        values.pop(crowded)
    low, high = values[0], values[-1]
    values.append(BEYOND * high if high > 0 else usual)
    values.append(max(BEYOND * low if low < 0 else -usual, farthest))
    values = sorted(set(values))
    while len(values) < DISTANCES:
        gap = int(np.argmax(np.diff(values)))
        values.insert(gap + 1, (values[gap] + values[gap + 1]) / 2)
    return tuple(values)


def _vergence(lens: Lens, distance_mm: float) -> float:
    """Of an object, from the entrance pupil."""
    return 1 / (distance_mm - float(lens.entrance_pupil_offset_mm))


def _distances_mm(lens: Lens, defocus: tuple[float, ...]) -> tuple[float, ...]:
    offset, focus = float(lens.entrance_pupil_offset_mm), lens.blur_per_vergence()[1]
    vergence = [value + focus for value in defocus]
    return tuple(1 / v + offset if v > 1e-9 else np.inf for v in vergence)


def _sheet(plan: _Plan, lenses: list[Lens], pixel_mm: float) -> ThroughSheet:
    half_mm = np.asarray(lenses[0].sensor_size_mm) / 2
    places = np.array(list(HEIGHTS.values()))[:, None] * half_mm
    width_mm = width_through_mm(lenses[0], places, plan.defocus, pixel_mm)
    found = through_tiles(lenses, places, plan.defocus, width_mm)
    photographed = [
        [(stop, value) in plan.seen for value in plan.defocus]
        for stop in plan.f_numbers
    ]
    return ThroughSheet(
        focal_length_mm=plan.focal_length_mm,
        focus_distance_mm=plan.focus_distance_mm,
        f_numbers=plan.f_numbers,
        distances_mm=found.distances_mm,
        photographed=np.array(photographed),
        pictures=tuple(png(sheet_of(one)) for one in found.tiles),
        width_px=width_mm / pixel_mm,
    )


class ThroughTiles(NamedTuple):
    """Point-spread functions at several places, f-numbers and distances, to show."""

    tiles: Float[np.ndarray, "places stops distances size size"]
    distances_mm: tuple[float, ...]


def through_tiles(
    lenses: list[Lens],
    places_mm: Float[np.ndarray, "places 2"],
    defocus: tuple[float, ...],
    width_mm: float,
) -> ThroughTiles:
    """Tiles of lenses that differ in their f-number, the widest first.

    Parameters
    ----------
    defocus : Vergence of the objects less that of the plane of focus, 1/mm.
    width_mm : Of each tile; `width_through_mm` holds them all.

    Raises
    ------
    LensfitError : A lens has no image of an object so near.
    """
    points, apart = _objects(lenses[0], places_mm, defocus)
    tiles = np.stack(
        [
            tiles_of(kernels_at(one, points, apart, width_mm, _TOLERANCE))
            for one in lenses
        ]
    )
    shape = (len(lenses), len(places_mm), len(defocus), SIZE_PX, SIZE_PX)
    by_place = np.swapaxes(tiles.reshape(shape), 0, 1)
    return ThroughTiles(by_place, _distances_mm(lenses[0], defocus))


def width_through_mm(
    lens: Lens,
    places_mm: Float[np.ndarray, "places 2"],
    defocus: tuple[float, ...],
    pixel_mm: float,
) -> float:
    """Width of a tile that holds the widest blur: twice what a thin lens says, then as
    seen.

    Parameters
    ----------
    lens : The one with the widest stop.
    pixel_mm : Of the camera; nothing is drawn narrower than a few.

    Raises
    ------
    LensfitError : The lens has no image of an object so near.
    """
    points, distances = _objects(lens, places_mm, defocus)
    radius = lens.blur_per_vergence()[0] * max(map(abs, defocus))
    width = max(4 * radius, 12 * pixel_mm)
    outermost = np.isin(distances, (distances.min(), distances.max()))
    seen = kernels_at(lens, points[outermost], distances[outermost], width, _GLANCE)
    return max(_ROOM * reach_share(seen) * width, 6 * pixel_mm)


def _objects(
    lens: Lens, places_mm: Float[np.ndarray, "places 2"], defocus: tuple[float, ...]
) -> tuple[Float[np.ndarray, "points 2"], Float[np.ndarray, " points"]]:
    """Image points and object distances, mm, of all distances at every place."""
    points = np.repeat(places_mm, len(defocus), axis=0)
    return points, np.tile(_distances_mm(lens, defocus), len(places_mm))


_LEFT, _BOTTOM = 66.0, 30.0


def through_figures(sheet: ThroughSheet) -> list[Markup]:
    """Title, what it means, and a figure for each place of the frame."""
    figures = [
        figure_html(_figure(sheet, place, picture))
        for place, picture in zip(HEIGHTS, sheet.pictures, strict=True)
    ]
    return [
        tag("h4", "Through focus and through the aperture"),
        tag("p", _about(sheet), class_="facts"),
        tag("div", *figures, class_="figures thirds"),
    ]


def _about(sheet: ThroughSheet) -> str:
    text = "Predicted: a point of green light at distances from the sensor (across, "
    text += "in metres) and at f-numbers (down)"
    if sheet.focus_distance_mm is not None:
        text += f", the lens focused at {distance_text(sheet.focus_distance_mm)}"
    text += f". All tiles are {number(sheet.width_px, 'px')} wide, light to the power "
    text += f"{GAMMA:g}, each tile against its own peak. Framed: as much out of focus "
    return (
        text + "as one of the photographs of that f-number; the others rest on these."
    )


def _figure(sheet: ThroughSheet, place: str, picture: bytes) -> Figure:
    stops, columns = sheet.photographed.shape
    step = (WIDTH - _LEFT) / columns
    height = stops * step
    shapes = [
        tag(
            "image", href=png_address(picture), x=f"{_LEFT:g}", y="0",
            width=f"{WIDTH - _LEFT:g}", height=f"{height:.1f}",
            preserveAspectRatio="none",
        )
    ]  # fmt: skip
    for row, stop in enumerate(sheet.f_numbers):
        name = stop_text({"f_number": stop})
        middle = (row + 0.5) * step + 7
        shapes.append(words(_LEFT - 8, middle, name, "tick", "end"))
    shapes.append(words(_LEFT - 8, height + 21, "m", "tick", "end"))
    for column, distance in enumerate(sheet.distances_mm):
        middle = _LEFT + (column + 0.5) * step
        name = number(float(f"{distance / 1000:.3g}"))
        shapes.append(words(middle, height + 21, name, "tick", "middle"))
    shapes += [
        _frame(_LEFT + column * step, row * step, step)
        for row in range(stops)
        for column in range(columns)
        if sheet.photographed[row, column]
    ]
    label = f"Point-spread functions through focus and aperture, {place}"
    drawn = drawing(label, *shapes, height=height + _BOTTOM)
    return Figure("through", place, drawn, "")


def _frame(x: float, y: float, step: float) -> Markup:
    at = {"x": f"{x + 1.5:.1f}", "y": f"{y + 1.5:.1f}"}
    side = f"{step - 3:.1f}"
    return tag("rect", **at, width=side, height=side, class_="shown")
