"""Choose a chart and its distance: what the photograph will show, before it is printed.

With n the noise of a pixel as part of white, the position of a dot of radius r pixels
scatters by ``n R^2 / (2 sqrt(pi) r^2)`` pixels if it is bright, the centroid of an
aperture of radius R (6 px more than r, as far as its light is looked for, and no more
than the detector's window), and by ``n sqrt(w / (pi r))`` if it is dark, as an edge of
w = 4 px carries its place. R and w are measured: they agree with the detector's own
covariance.

A model of k numbers fitted to d dots errs by ``scatter sqrt(k / d)`` pixels rms over
the frame. `lensfit.chart.camera` has the optics and the takes.
"""

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from lensfit.chart.camera import (
    Camera,
    FocusTake,
    distance_of_magnification_mm,
    focus_takes,
    magnification_at,
)
from lensfit.chart.layout import Layout, Wanted, lay_out
from lensfit.chart.sheet import PAPERS, Sheet, paper_sheet
from lensfit.errors import ChartError

_APERTURE_PITCHES = 0.49
"""R at most: what `lensfit.detect.dots` takes a bright dot's light from."""
_BRIGHT_MARGIN_PX, _DARK_EDGE_PX = 6.0, 4.0
SCATTER_FORMULA = {
    "bright": "n R^2 / (2 sqrt(pi) r^2)",
    "dark": f"n sqrt({_DARK_EDGE_PX:g} px / (pi r))",
}


def dot_scatter_px(
    noise: float, mark_px: float, pitch_px: float, *, bright: bool
) -> float:
    """Scatter of a dot's place, in pixels, along one axis.

    Parameters
    ----------
    noise : n, standard deviation of a pixel as part of white.
    mark_px, pitch_px : Diameter of the dot, and distance to the next.
    bright : Light on dark, else dark on light.
    """
    radius = mark_px / 2
    if not bright:
        return noise * math.sqrt(_DARK_EDGE_PX / (math.pi * radius))
    aperture = min(_APERTURE_PITCHES * pitch_px, radius + _BRIGHT_MARGIN_PX)
    return noise * aperture**2 / (2 * math.sqrt(math.pi) * radius**2)


MODEL_NUMBERS = 20
"""Of a lens and a pose, as a fit of one photograph chooses."""
SMALL_HOLE_PX = 1.6
"""Diameter of holes by which blur is measured."""
READABLE_MODULE_PX = 2.5
CLOSE_FOCAL_LENGTHS = 10.0


@dataclass(frozen=True)
class Advice:
    """What a chart will look like, and what to do about it.

    Attributes
    ----------
    distance_mm : Of the chart, from the sensor.
    field_mm : Width and height that the frame sees there.
    marks_on_frame : Dots, crossings or corners, the chart's middle in the frame's.
    mark_px, pitch_px, module_px : Width of a mark, pitch, module of the code.
    scatter_px : Of a dot's position, in focus; None for other charts.
    scatter_formula : What it was reckoned by.
    expected_rms_px : Of a fitted lens over the frame.
    small_hole_mm : Diameter of a hole by which blur could be measured.
    whole_sheet_distance_mm : From where the frame sees the whole sheet, with its code.
    """

    sheet_mm: tuple[float, float]
    kind: str
    pitch_mm: float
    mark_mm: float
    columns: int
    rows: int
    distance_mm: float
    field_mm: tuple[float, float]
    marks_on_frame: int
    mark_px: float
    pitch_px: float
    module_px: float
    scatter_px: float | None
    scatter_formula: str
    expected_rms_px: float | None
    small_hole_mm: float
    whole_sheet_distance_mm: float
    takes: tuple[FocusTake, ...]
    notes: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """In types that JSON knows."""
        return asdict(self)


def advise(
    camera: Camera,
    wanted: Wanted,
    sheet: Sheet | None = None,
    focus_distance_mm: float | None = None,
) -> Advice:
    """What lands on the frame.

    Parameters
    ----------
    sheet : Of the chart; None takes the smallest paper that fills the frame at the
        focus distance, or A3 if there is none.
    focus_distance_mm : Of lens and chart, from the sensor; None takes that at which
        the pattern fills the frame.

    Raises
    ------
    ChartError : The chart cannot be made, or is nearer than the lens can focus.
    """
    camera.check()
    if sheet is None:
        sheet = _paper_for(camera, wanted, focus_distance_mm)
    layout = lay_out(sheet, wanted)
    distance = focus_distance_mm
    if distance is None:
        distance = _filling_distance_mm(camera, _extent_mm(layout))
    magnification = magnification_at(camera.focal_length_mm, distance)
    px_per_mm = magnification / camera.pixel_mm
    pattern = layout.pattern
    field = tuple(side / magnification for side in camera.sensor_mm)
    marks = _marks_in(layout, field)
    scatter = None
    if pattern.kind == "dot-grid":
        scatter = dot_scatter_px(
            camera.noise_percent / 100,
            pattern.mark_mm * px_per_mm,
            pattern.pitch_mm * px_per_mm,
            bright=pattern.polarity == "bright",
        )
    advice = Advice(
        sheet_mm=(sheet.width_mm, sheet.height_mm),
        kind=pattern.kind,
        pitch_mm=pattern.pitch_mm,
        mark_mm=pattern.mark_mm,
        columns=pattern.columns,
        rows=pattern.rows,
        distance_mm=distance,
        field_mm=(field[0], field[1]),
        marks_on_frame=marks,
        mark_px=pattern.mark_mm * px_per_mm,
        pitch_px=pattern.pitch_mm * px_per_mm,
        module_px=layout.module_mm * px_per_mm,
        scatter_px=scatter,
        scatter_formula=SCATTER_FORMULA[pattern.polarity],
        expected_rms_px=scatter and scatter * math.sqrt(MODEL_NUMBERS / max(marks, 1)),
        small_hole_mm=SMALL_HOLE_PX / px_per_mm,
        whole_sheet_distance_mm=_whole_sheet_distance_mm(camera, sheet),
        takes=(),
        notes=(),
    )
    takes = focus_takes(camera, distance, advice.mark_px, advice.pitch_px)
    notes = _notes(camera, layout, advice)
    return Advice(**(vars(advice) | {"takes": takes, "notes": notes}))


def _extent_mm(layout: Layout) -> tuple[float, float]:
    """Of the pattern, from its first to its last mark."""
    pattern = layout.pattern
    columns, rows = pattern.lattice_size
    return (columns - 1) * pattern.pitch_mm, (rows - 1) * pattern.pitch_mm


def _filling_distance_mm(camera: Camera, extent_mm: tuple[float, float]) -> float:
    """Where the pattern covers the whole frame, and no more."""
    parts = [s / e for s, e in zip(camera.sensor_mm, extent_mm, strict=True)]
    # a lens images no larger than life size at four focal lengths
    return distance_of_magnification_mm(camera.focal_length_mm, min(max(parts), 1.0))


def _whole_sheet_distance_mm(camera: Camera, sheet: Sheet) -> float:
    sides = (sheet.width_mm, sheet.height_mm)
    parts = [s / e for s, e in zip(camera.sensor_mm, sides, strict=True)]
    return distance_of_magnification_mm(camera.focal_length_mm, min(*parts, 1.0))


def _paper_for(camera: Camera, wanted: Wanted, distance_mm: float | None) -> Sheet:
    if distance_mm is None:
        return paper_sheet("A3")
    magnification = magnification_at(camera.focal_length_mm, distance_mm)
    sheets = [paper_sheet(name) for name in sorted(PAPERS) if name.startswith("A")]
    for sheet in reversed(sheets):
        try:
            extent = _extent_mm(lay_out(sheet, wanted))
        except ChartError:
            continue  # too small for that pitch
        if all(
            e * magnification >= s
            for e, s in zip(extent, camera.sensor_mm, strict=True)
        ):
            return sheet
    return sheets[0]


def _marks_in(layout: Layout, field_mm: tuple[float, ...]) -> int:
    count = 1
    for number, side in zip(layout.pattern.lattice_size, field_mm, strict=True):
        place = (np.arange(number) - (number - 1) / 2) * layout.pattern.pitch_mm
        count *= int(np.count_nonzero(np.abs(place) <= side / 2))
    missing = layout.pattern.kind == "dot-grid" and layout.pattern.oriented
    return max(count - 4 * missing, 0)


def _notes(camera: Camera, layout: Layout, advice: Advice) -> tuple[str, ...]:
    notes = []
    extent = _extent_mm(layout)
    parts = [e / f for e, f in zip(extent, advice.field_mm, strict=True)]
    if min(parts) < 0.95:
        notes.append(
            f"the pattern covers {min(parts[0], 1):.0%} of the frame's width and "
            f"{min(parts[1], 1):.0%} of its height: use a larger sheet, or go to "
            f"{_filling_distance_mm(camera, extent):.0f} mm"
        )
    if advice.distance_mm < CLOSE_FOCAL_LENGTHS * camera.focal_length_mm:
        notes.append(
            f"{advice.distance_mm:.0f} mm is nearer than many lenses focus: a larger "
            "sheet fills the frame from farther away"
        )
    if advice.pitch_px < 12:
        notes.append("marks are less than 12 px apart: use a larger pitch")
    if advice.marks_on_frame < 150:
        notes.append("fewer than 150 marks land on the frame: use a smaller pitch")
    if advice.kind == "dot-grid":
        if advice.mark_px < 1.5:
            notes.append("dots are smaller than 1.5 px: make them larger")
        if advice.mark_px > 1.8:
            notes.append(
                f"to measure blur too, photograph holes of {advice.small_hole_mm:.2g} "
                f"mm ({SMALL_HOLE_PX:g} px); these are {advice.mark_px:.1f} px wide"
            )
    at = advice.whole_sheet_distance_mm
    module = magnification_at(camera.focal_length_mm, max(at, advice.distance_mm))
    module *= layout.module_mm / camera.pixel_mm
    if module < READABLE_MODULE_PX:
        notes.append(
            f"the code's modules are {module:.1f} px where the whole sheet is seen, "
            "too few to read: state the target in the shoot file"
        )
    elif at > 1.02 * advice.distance_mm:
        notes.append(
            "the code lies outside the frame at this distance: let one sharp take show "
            f"a whole strip, for instance from {at:.0f} mm, or state the target"
        )
    return tuple(notes)
