"""The entrance pupil of usual lenses against published designs, by exact ray trace."""

from functools import cache

import numpy as np
import pytest

from data_synth.aim import chief_aim_mm
from data_synth.lens import SetLens, set_lens
from data_synth.prescription import load_prescription, prescription_names
from lensfit.fitting.usual_lens import (
    next_order_of_pupil_shift_mm,
    usual_pupil,
    usual_pupil_shift,
)


@cache
def published() -> list[tuple[float, SetLens]]:
    """Nominal focal lengths, and lenses of every state of every spherical design,
    focused forty of these away."""
    designs = [load_prescription(name) for name in prescription_names()]
    return [
        (
            state.focal_length_mm,
            set_lens(
                design,
                focal_length_mm=state.focal_length_mm,
                focus_distance_mm=40 * state.focal_length_mm,
            ),
        )
        for design in designs
        if design.squeeze == 1.0
        for state in design.states
    ]


def shifts_mm(
    lens: SetLens, tangent: np.ndarray, away_mm: float
) -> tuple[np.ndarray, np.ndarray]:
    """Squared sines of the field angles of points of a chart, and how far towards the
    scene their chief rays cross the axis."""
    across_mm = away_mm * tangent
    chart = np.stack([across_mm, 0 * across_mm, 0 * across_mm - away_mm], -1)
    aim_mm = chief_aim_mm(lens, chart, 546.0)[:, 0]
    ahead_mm = away_mm + lens.pupil_z_mm
    slope = (across_mm - aim_mm) / ahead_mm
    return slope**2 / (1 + slope**2), -aim_mm / slope


def test_usual_pupils_hold_for_published_designs():
    off = []
    for focal_mm, lens in published():
        usual = usual_pupil(focal_mm)
        away_mm = -lens.pupil_z_mm - usual.offset_mm
        off.append(away_mm / usual.standard_deviation_mm)
    assert np.abs(off).max() < 1.7
    assert 0.2 < np.sqrt(np.mean(np.square(off))) < 1.2


def test_the_usual_shift_is_that_of_fast_glass():
    fast, slow = (usual_pupil_shift(50.0, stop, 15.0) for stop in (1.4, 4.0))
    assert fast.shift_mm < slow.shift_mm < 0
    unknown = usual_pupil_shift(50.0, None, 15.0)
    assert unknown.shift_mm == 0.0
    assert unknown.standard_deviation_mm > fast.standard_deviation_mm


def test_traced_pupils_shift_as_is_usual():
    off, still, off_next = [], [], []
    for _, lens in published():
        focal_mm = lens.focal_length_mm
        corner_mm = np.hypot(*lens.prescription.sensor_size_mm) / 2
        tangent = np.linspace(0.02, 1, 24) * corner_mm / focal_mm
        sine2, shift_mm = shifts_mm(lens, tangent, 40 * focal_mm)
        # Areas of the frame, in rings of one width.
        weight = np.sqrt(np.arange(1, len(sine2) + 1))
        powers = weight[:, None] * np.stack([sine2, sine2**2], -1)
        (_, second), *_ = np.linalg.lstsq(powers, weight * shift_mm)
        (alone,), *_ = np.linalg.lstsq(powers[:, :1], weight * shift_mm)
        usual = usual_pupil_shift(focal_mm, lens.f_number, corner_mm)
        off.append((alone - usual.shift_mm) / usual.standard_deviation_mm)
        still.append(alone / usual.standard_deviation_mm)
        left_mm = next_order_of_pupil_shift_mm(alone, focal_mm, corner_mm)
        off_next.append(second * sine2[-1] / 2 / left_mm)
    assert np.median(np.abs(off)) < 0.67
    assert np.mean(np.abs(off) < 2) > 0.85
    # It is better than to take it that pupils stand still.
    assert np.median(np.abs(off)) < np.median(np.abs(still))
    assert 0.4 < np.sqrt(np.mean(np.square(off_next))) < 1.2
    assert np.abs(off_next).max() < 2.5


@pytest.mark.parametrize(
    "name",
    ["biotar_50", "cooke_triplet_50", "flektogon_35", "nikkor_28", "petzval_50"],
)
def test_ordinary_lenses_are_within_a_quarter_of_their_focal_length(name: str):
    design = load_prescription(name)
    lens = set_lens(design, f_number=design.f_number, focus_distance_mm=2000.0)
    tangent = np.tan(np.radians([5.0, 10.0, 15.0]))
    sine2, along_mm = shifts_mm(lens, tangent, 2000.0)
    shift_mm = np.mean(along_mm / sine2)
    usual = usual_pupil_shift(lens.focal_length_mm, design.f_number, 15.0)
    assert abs(shift_mm - usual.shift_mm) < 0.25 * lens.focal_length_mm
    if design.f_number <= 2:
        # Where it matters, it is better than to take it that pupils stand still.
        assert abs(shift_mm - usual.shift_mm) < abs(shift_mm) / 2
