"""What to photograph when only a lens is named: a small shoot that suits it.

The chart stands at the focus distance; its marks are sized so that about 25 fit across
the frame, each a few pixels wide. One take stands square to the camera, a second is
tilted so that the focal length is determined; a zoom gets both at every focal length.
"""

import math

from data_synth.chart import Chart, ChartKind, Pose
from data_synth.files import PictureFormat
from data_synth.prescription import Prescription
from data_synth.sensor import Frame
from data_synth.shoot import Shot

MARKS_ACROSS = 25
LEAST_PITCH_PX = 18.0
MARK_PX = {"dot-grid": 3.6, "line-grid": 3.0, "checkerboard": 0.0}


def planned_shots(
    prescription: Prescription,
    frame: Frame,
    *,
    kind: ChartKind = "dot-grid",
    f_number: float | None = None,
    focus_distance_mm: float | None = None,
    form: PictureFormat = "exr",
) -> list[Shot]:
    """A square and a tilted take for every focal length of the lens.

    Parameters
    ----------
    f_number : Two stops down from the widest by default.
    focus_distance_mm : Forty focal lengths by default; the chart stands there.
    """
    f_number = 2 * prescription.f_number if f_number is None else f_number
    shots = []
    for state in prescription.states:
        distance_mm = focus_distance_mm or 40 * state.focal_length_mm
        chart = chart_for(prescription, frame, kind, state.focal_length_mm, distance_mm)
        tilted = Pose(distance_mm, tilt_deg=12.0, pan_deg=-16.0, roll_deg=3.0)
        stem = f"{kind.split('-')[0]}_{state.focal_length_mm:g}mm_f{f_number:g}"
        for name, pose in ((stem, Pose(distance_mm)), (f"{stem}_tilted", tilted)):
            shots.append(
                Shot(
                    name.replace(".", "p"),
                    chart,
                    pose,
                    f_number,
                    distance_mm,
                    focal_length_mm=state.focal_length_mm,
                    form=form,
                    says_distance=pose is not tilted,
                )
            )
    return shots


def chart_for(
    prescription: Prescription,
    frame: Frame,
    kind: ChartKind,
    focal_length_mm: float,
    distance_mm: float,
) -> Chart:
    """A chart whose marks suit the frame at this distance, in handy sizes."""
    mm_per_px = frame.pitch_mm[0] * prescription.squeeze
    mm_per_px *= distance_mm / focal_length_mm - 1
    pitch_px = max(frame.size_px[0] / MARKS_ACROSS, LEAST_PITCH_PX)
    pitch_mm = _two_digits(mm_per_px * pitch_px)
    return Chart(kind, pitch_mm, _two_digits(mm_per_px * MARK_PX[kind]))


def _two_digits(length_mm: float) -> float:
    """Rounded to two significant digits, as one would print it."""
    if length_mm <= 0:
        return 0.0
    return round(length_mm, 1 - math.floor(math.log10(length_mm)))
