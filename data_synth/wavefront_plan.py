"""What to photograph so that a wavefront can be measured: dots in and out of focus.

One chart of small bright holes stands still. It is photographed wide open and two stops
down, the lens focused on it, nearer and farther; then tilted, rolled and at a distance
that nobody wrote down; and last a line grid at about f/8. A spot that is out of focus
shows the pupil: where light lands against where it came through.

The focus is moved as far as 0.715 and 1.65 times the chart's distance, but no further
than the traced spots wide open stay within a part of the dots' pitch.
"""

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np

from data_synth.aim import tracer_from_object
from data_synth.chart import Chart, ChartKind, Pose
from data_synth.files import PictureFormat
from data_synth.lens import set_lens
from data_synth.prescription import Prescription
from data_synth.pupilmap import REFERENCE_NM, open_bounds_mm, pupil_map
from data_synth.sensor import Frame
from data_synth.shoot import Shot
from data_synth.spots import field_points_mm

MARKS_ACROSS = 25.6
LEAST_PITCH_PX = 32.0
SPOTS_IN_PITCH, MARKS_IN_PITCH = 3.0, 1.6
"""Dots stand at least so many spots in focus, or diameters, apart."""
ORDINARY_ENDS, WIDE_ENDS = (0.715, 1.65), (0.4, 6.0)
LEAST_PART = 0.1
BISECTIONS = 6
SPOT_FIELD = ((0.0, 0.5, 0.9), (-0.9, -0.4, 0.0, 0.4, 0.9))
LINES_F_NUMBER = 8.0
LINE_PX = 3.0
BOARD_PX = 25.0
"""What stands for the diameter of a hole: modules of markers are four pixels then."""
DISTANCE_IN_FOCAL_LENGTHS = 40.0
BRIGHTEST = 0.85

ALMOST_SQUARE = Pose(
    0.0, tilt_deg=0.1, pan_deg=-0.15, roll_deg=0.4, shift_mm=(0.11, -0.07)
)
"""As well as a chart is set up by hand; shifts in pitches."""

_PUPIL_CELLS = 17
"""Across the pupil, of patterns that are out of focus: pictures of a fast lens far out
of focus are then within .0006 of white (rms) of those of 49 cells."""
_NAMES = {
    "dot-grid": "dots",
    "checkerboard": "checkers",
    "line-grid": "lines",
    "charuco": "markers",
}

FocusState = Literal["in", "near", "far"]
FOCUS_STATES: tuple[FocusState, ...] = ("in", "near", "far")


@dataclass(frozen=True)
class WavefrontPlan:
    """How a wavefront shoot departs from the ordinary one.

    Attributes
    ----------
    hole_px : Diameter of a hole's image in focus, in x.
    blur_in_pitches : Largest spot wide open; 1 or more lets dots overlap.
    brightest : Exposed so that the brightest sample has this value; above 1 saturates.
    pose : How the chart stands in all takes but the tilted one; the distance is set by
        the plan, shifts count in pitches.
    reach : Half-sides of the printed chart as parts of what the frame sees; None prints
        beyond the frame.
    focus_states : Which of them are photographed.
    with_tilted, with_lines, with_stopped_down : Whether those takes are there.
    form : Of the picture files.
    dark : Dots are black ones on white.
    kind : Of the chart that is photographed in and out of focus.
    """

    hole_px: float = 1.6
    blur_in_pitches: float = 0.4
    brightest: float = BRIGHTEST
    pose: Pose = ALMOST_SQUARE
    reach: tuple[float, float] | None = None
    focus_states: tuple[FocusState, ...] = FOCUS_STATES
    with_tilted: bool = True
    with_lines: bool = True
    with_stopped_down: bool = True
    form: PictureFormat = "exr"
    dark: bool = False
    kind: ChartKind = "dot-grid"


CHART_PLANS = {
    "holes": WavefrontPlan(),
    "dots_6": WavefrontPlan(hole_px=6.0, dark=True, with_lines=False),
    "dots_20": WavefrontPlan(hole_px=20.0, dark=True, with_lines=False),
    "dots_48": WavefrontPlan(hole_px=48.0, dark=True, with_lines=False),
    "checkerboard": WavefrontPlan(kind="checkerboard", with_lines=False),
    "line_grid": WavefrontPlan(kind="line-grid", hole_px=LINE_PX, with_lines=False),
    "charuco": WavefrontPlan(
        kind="charuco", hole_px=BOARD_PX, with_lines=False, blur_in_pitches=0.1
    ),
}
"""By chart: holes of 1.6 pixels, dark dots of 6, 20 and 48, squares, lines of 3, and
squares with markers, which have to stay readable. Holes alone have a line grid beside
them."""


def wavefront_shots(
    prescription: Prescription, frame: Frame, plan: WavefrontPlan | None = None
) -> list[Shot]:
    """The takes of a wavefront shoot of a lens (the first focal length of a zoom)."""
    plan = plan or WavefrontPlan()
    sizes = _sizes(prescription, frame, plan.hole_px)
    distance_mm, pitch_mm, mm_per_px = (
        sizes.distance_mm,
        sizes.pitch_mm,
        sizes.mm_per_px,
    )
    reach_mm = _reach_mm(plan, frame, mm_per_px)
    mark_mm = handy(mm_per_px * plan.hole_px)
    chart = Chart(plan.kind, pitch_mm, mark_mm, reach_mm, plan.dark)
    if plan.kind == "charuco":
        chart = replace(chart, squares=_squares(frame, pitch_mm / mm_per_px))
    about = _NAMES[plan.kind]
    focus_mm = _focus_distances_mm(prescription, frame, sizes, plan.blur_in_pitches)
    widest = prescription.f_number
    stops = (widest, handy(2 * widest)) if plan.with_stopped_down else (widest,)
    take = partial(Shot, form=plan.form, brightest=plan.brightest, from_maps=True)
    blurred = partial(take, pupil_cells=_PUPIL_CELLS)
    pose = _placed(plan.pose, distance_mm, pitch_mm)
    shots = [
        blurred(named(about, stop, state), chart, pose, stop, focus_mm[state])
        for stop in stops
        for state in plan.focus_states
    ]
    if plan.with_tilted:
        far_mm, shift_mm = handy(1.004 * distance_mm, 4), (0.3 * pitch_mm, 0.0)
        tilted = Pose(far_mm, 7.0, -9.0, 4.0, shift_mm)
        name = named(about, widest, "tilt")
        shots.append(
            blurred(name, chart, tilted, widest, distance_mm, says_distance=False)
        )
    if plan.with_lines:
        line_mm = handy(LINE_PX * mm_per_px)
        lines = Chart("line-grid", handy(1.5 * pitch_mm), line_mm, reach_mm)
        stop = max(LINES_F_NUMBER, handy(2 * widest))
        shots.append(take(named("lines", stop), lines, pose, stop, distance_mm))
    return shots


def _squares(frame: Frame, square_px: float) -> tuple[int, int]:
    """Columns and rows that a board needs to reach beyond the frame."""
    columns, rows = (math.ceil(size / square_px) + 2 for size in frame.size_px)
    return columns, rows


def _reach_mm(
    plan: WavefrontPlan, frame: Frame, mm_per_px: float
) -> tuple[float, float] | None:
    """Half-sides of the printed chart; None prints beyond the frame."""
    if plan.reach is None:
        return None
    across, down = (
        part * size / 2 * mm_per_px
        for part, size in zip(plan.reach, frame.size_px, strict=True)
    )
    return across, down


@dataclass(frozen=True)
class _Sizes:
    """Where the chart stands, and lengths on it."""

    distance_mm: float
    pitch_mm: float
    mm_per_px: float


def _sizes(prescription: Prescription, frame: Frame, mark_px: float) -> _Sizes:
    focal_mm = prescription.states[0].focal_length_mm
    distance_mm = handy(DISTANCE_IN_FOCAL_LENGTHS * focal_mm, 3)
    # Perspective counts from the entrance pupil, far ahead in a retrofocus lens.
    lens = set_lens(prescription, focus_distance_mm=distance_mm)
    ahead_mm = distance_mm + lens.pupil_z_mm
    mm_per_px = frame.pitch_mm[0] * prescription.squeeze * ahead_mm / focal_mm
    sharpest_px = spot_diameter_px(prescription, frame, distance_mm, distance_mm)
    pitch_px = max(
        frame.size_px[0] / MARKS_ACROSS,
        LEAST_PITCH_PX,
        SPOTS_IN_PITCH * sharpest_px,
        MARKS_IN_PITCH * mark_px,
    )
    return _Sizes(distance_mm, handy(mm_per_px * pitch_px), mm_per_px)


def _focus_distances_mm(
    prescription: Prescription, frame: Frame, sizes: _Sizes, blur_in_pitches: float
) -> dict[str, float]:
    """Where the lens is focused in each state, mm from the sensor."""
    chart_mm = sizes.distance_mm
    limit_px = blur_in_pitches * sizes.pitch_mm / sizes.mm_per_px
    ends = ORDINARY_ENDS if blur_in_pitches < 1 else WIDE_ENDS
    return {"in": chart_mm} | {
        state: handy(_focus_within_mm(prescription, frame, chart_mm, end, limit_px), 3)
        for state, end in zip(("near", "far"), ends, strict=True)
    }


def _focus_within_mm(
    prescription: Prescription,
    frame: Frame,
    chart_mm: float,
    end: float,
    limit_px: float,
) -> float:
    """The focus farthest from the chart, towards `end`, whose spots keep the limit."""

    def focus_mm(part: float) -> float:
        return chart_mm / (1 + part * (1 / end - 1))

    low, high = 0.0, 1.0
    for part in (1.0, *[math.nan] * BISECTIONS):
        part = (low + high) / 2 if math.isnan(part) else part
        blur_px = spot_diameter_px(prescription, frame, focus_mm(part), chart_mm)
        if blur_px <= limit_px:
            low = part
            if part == 1.0:
                break
        else:
            high = part
    return focus_mm(max(low, LEAST_PART))


def spot_diameter_px(
    prescription: Prescription, frame: Frame, focus_mm: float, object_mm: float
) -> float:
    """Size of the largest spot over the frame wide open, of a disc as wide in rms."""
    lens = set_lens(prescription, focus_distance_mm=focus_mm)
    points = field_points_mm(lens, frame, SPOT_FIELD, object_mm)
    scene = tracer_from_object(points)
    normals = np.broadcast_to([0.0, 0.0, 1.0], scene.shape)
    bounds = open_bounds_mm(lens, scene)
    rays = pupil_map(lens, scene, normals, bounds, REFERENCE_NM, 24)
    fine = rays.refined(lens.stop, 24)
    light = fine.flux.sum(axis=(1, 2))
    lit = light > 0
    weight = (fine.flux[lit] / light[lit, None, None])[:, None]
    landing = fine.landing_mm[lit]
    mean = (weight * landing).sum(axis=(2, 3), keepdims=True)
    variance = (weight * (landing - mean) ** 2).sum(axis=(2, 3))
    spread = np.sqrt((variance / np.array(frame.pitch_mm) ** 2).sum(axis=1))
    return float(2 * np.sqrt(2) * spread.max(initial=0.0))


def named(kind: str, f_number: float, state: str = "") -> str:
    """File name of a take: dots_f1p4_near."""
    parts = [kind, f"f{f_number:g}".replace(".", "p"), state]
    return "_".join(part for part in parts if part)


def handy(value: float, digits: int = 2) -> float:
    """Rounded to a few significant digits, as one would print or read it."""
    return round(value, digits - 1 - math.floor(math.log10(value)))


def _placed(pose: Pose, distance_mm: float, pitch_mm: float) -> Pose:
    shift_x, shift_y = pose.shift_mm
    return replace(
        pose, distance_mm=distance_mm, shift_mm=(shift_x * pitch_mm, shift_y * pitch_mm)
    )
