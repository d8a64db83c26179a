"""How well objects beyond the chart's distance are known."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from lens_makers import REFERENCE_MM, SENSOR_MM, strong_lens

from lensfit.lens import Lens
from lensfit.optics.distortion import no_distortion
from lensfit.optics.map_deviations import (
    PERSPECTIVE_NUMBERS,
    MapCovariances,
    Perspective,
    landed_mm,
    moved_perspective,
    numbers_in,
)
from lensfit.optics.projection import PupilShift

PUPIL_MM, CHART_MM = 90.0, 900.0
SHIFT = PupilShift(jnp.asarray(-3.0), jnp.asarray(CHART_MM - PUPIL_MM))


def lens_of(
    distortion, moves: np.ndarray, pupil_shift: PupilShift | None = SHIFT
) -> Lens:
    """Known but for one direction of its numbers."""
    return Lens(
        distortion=distortion,
        lateral_colour=None,
        illumination=None,
        entrance_pupil_offset_mm=jnp.asarray(PUPIL_MM),
        sensor_size_mm=SENSOR_MM,
        focal_length_mm=25.0,
        pupil_shift=pupil_shift,
        covariances=MapCovariances(perspective=np.outer(moves, moves)),
    )


def pupil_error(distortion, error_mm: float) -> np.ndarray:
    """A pupil that is off, and the principal distance which goes with the picture of
    the chart."""
    moves = np.zeros(numbers_in(distortion) + PERSPECTIVE_NUMBERS)
    moves[-2] = error_mm
    moves[0] = -error_mm / (CHART_MM - PUPIL_MM)
    return moves


def grid(distortion, distance_mm: float) -> np.ndarray:
    half = 0.45 * np.asarray(SENSOR_MM) / float(distortion.principal_distance_mm)
    x, y = (np.linspace(-h, h, 7) * (distance_mm - PUPIL_MM) for h in half)
    across = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
    return np.column_stack([across, np.full(len(across), distance_mm)])


def affinely_left(moved: np.ndarray, still: np.ndarray) -> np.ndarray:
    design = np.column_stack([moved, np.ones(len(moved))])
    return design @ np.linalg.lstsq(design, still, rcond=None)[0] - still


@pytest.fixture(scope="module")
def strong():
    return strong_lens(0)


def test_at_the_chart_a_wrong_pupil_is_seen_nowhere(strong):
    lens = lens_of(strong, pupil_error(strong, 5.0), pupil_shift=None)
    at_chart = lens.object_standard_deviation_mm(grid(strong, CHART_MM))
    elsewhere = lens.object_standard_deviation_mm(grid(strong, 2 * CHART_MM))
    assert at_chart.max() < 0.02 * elsewhere.max()


def test_it_grows_with_the_difference_of_vergences(strong):
    lens = lens_of(strong, pupil_error(strong, 1.0), pupil_shift=None)
    sizes = {
        mm: np.hypot(*lens.object_standard_deviation_mm(grid(strong, mm)).T).max()
        for mm in (600.0, 1200.0, 3000.0)
    }
    apart = {mm: abs(1 / (mm - PUPIL_MM) - 1 / (CHART_MM - PUPIL_MM)) for mm in sizes}
    ratios = [sizes[mm] / apart[mm] for mm in sizes]
    np.testing.assert_allclose(ratios, ratios[0], rtol=0.15)


@pytest.mark.slow
def test_it_is_how_far_objects_land_from_there(strong):
    """Against the lens moved by one deviation, an affine map undone."""
    moves = pupil_error(strong, 0.5)
    moves[-1] = 0.3
    objects = grid(strong, 1800.0)
    lens = lens_of(strong, moves)
    stated = lens.object_standard_deviation_mm(objects)
    at = Perspective(jnp.asarray(PUPIL_MM), strong, SHIFT)
    moved, landed = moved_perspective(at, jnp.asarray(moves)), jax.jit(landed_mm)
    still, off = (
        np.array([landed(jnp.asarray(point), one) for point in objects])
        for one in (at, moved)
    )
    np.testing.assert_allclose(still, lens.project(objects), atol=1e-12)
    left = np.abs(affinely_left(off, still))
    # The frame that the alignment covers is a little more than these objects.
    np.testing.assert_allclose(
        np.hypot(*stated.T).max(), np.hypot(*left.T).max(), rtol=0.4
    )


def test_a_pinhole_is_off_by_a_scale_alone():
    pinhole = no_distortion(25.0, REFERENCE_MM)
    lens = lens_of(pinhole, pupil_error(pinhole, 5.0), pupil_shift=None)
    stated = lens.object_standard_deviation_mm(grid(pinhole, 2 * CHART_MM))
    assert stated.max() < 1e-9
