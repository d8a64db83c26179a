"""A pupil that shifts: nothing at the chart, its own parallax elsewhere."""

import jax.numpy as jnp
import numpy as np
import pytest

from data_synth.aim import chief_aim_mm, chief_landings_mm
from data_synth.lens import set_lens
from data_synth.prescription import load_prescription
from lensfit.optics.projection import PupilShift, equivalent_chart_point

CHART_MM = 2000.0
STEEP = PupilShift(jnp.asarray(-40.0), jnp.asarray(CHART_MM))


def moved(point, pupil_shift) -> np.ndarray:
    return np.asarray(equivalent_chart_point(jnp.asarray(point), pupil_shift))


@pytest.mark.parametrize("point", [(300.0, -200.0, CHART_MM), (0.0, 0.0, 700.0)])
def test_the_chart_and_the_axis_stay(point):
    np.testing.assert_array_equal(moved(point, STEEP), point)


def test_a_pupil_that_stands_still_changes_nothing():
    point = np.array([300.0, -200.0, 700.0])
    np.testing.assert_array_equal(moved(point, None), point)


def test_parallax_is_that_of_a_pupil_elsewhere():
    """A far object is seen in the direction that the shifted pupil sees it in, once the
    chart is seen from there, too: to first order in shift over distance."""
    place = np.array([300.0, -200.0])
    sine2 = place @ place / (place @ place + 700.0**2)
    from_shifted = 700.0 - float(STEEP.shift_mm) * sine2
    ray = place / from_shifted
    on_chart = ray * (CHART_MM - float(STEEP.shift_mm) * sine2)
    seen = moved([*place, 700.0], STEEP)
    found = seen[:2] / seen[2] * CHART_MM
    np.testing.assert_allclose(found, on_chart, rtol=2e-4)
    assert np.abs(place / 700.0 * CHART_MM / on_chart - 1).max() > 20 * 2e-4


@pytest.mark.parametrize("name", ["angenieux_50", "biotar_50"])
def test_traced_chief_rays_of_another_distance(name: str):
    """What a chart at 2 m says of an object at 1.2 m, by exact ray traces: the shift,
    at 12 degrees, takes away nine tenths of the error and more."""
    focal_mm = 50.0
    lens = set_lens(
        load_prescription(name),
        focal_length_mm=focal_mm,
        f_number=8.0,
        focus_distance_mm=CHART_MM,
    )
    pupil_mm = -lens.pupil_z_mm
    tangent = np.tan(np.radians([4.0, 8.0, 12.0, 15.0]))

    def plane(distance_mm, tangent):
        ahead = distance_mm - pupil_mm
        across = np.stack([ahead * tangent, 0 * tangent], -1)
        return np.insert(across, 2, -distance_mm, axis=1)

    chart = plane(CHART_MM, tangent)
    aim = chief_aim_mm(lens, chart, 540.0)[:, 0]
    slope = (chart[:, 0] - aim) / (CHART_MM - pupil_mm)
    sine2 = tangent**2 / (1 + tangent**2)
    shift_mm = float((-aim / slope / sine2)[2])
    pupil_shift = PupilShift(jnp.asarray(shift_mm), jnp.asarray(CHART_MM - pupil_mm))

    def landed(points):
        return chief_landings_mm(lens, points, 540.0)[:, 0]

    near_mm = 1200.0 - pupil_mm
    exact = landed(plane(1200.0, tangent))
    seen = np.array([moved([near_mm * t, 0.0, near_mm], pupil_shift) for t in tangent])
    predicted = landed(plane(CHART_MM, seen[:, 0] / seen[:, 2]))
    still = landed(plane(CHART_MM, tangent))
    assert np.abs(still - exact)[2] > 2e-3
    assert (np.abs(predicted - exact) < 0.1 * np.abs(still - exact)).all()
