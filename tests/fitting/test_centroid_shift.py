"""Centroids of dots that are seen obliquely: closed form, symmetry, and brute force."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lensfit.fitting.geometry import BoardPose, Frame, centroid_shift_mm, predicted_mm
from lensfit.fitting.parameters import Layout

LAYOUT = Layout(radial=2)
FOCAL_MM, DISTANCE_MM, HALF_MM = 30.0, 800.0, 200.0
FRAME = Frame(
    jnp.asarray(FOCAL_MM),
    jnp.asarray(15.0),
    jnp.zeros(2),
    jnp.asarray(1.05),
    jnp.array([[-0.8, -0.6], [0.8, 0.6]]),
    jnp.asarray(DISTANCE_MM),
)
MARKS = np.array([[0.0, 0.0], [0.9, 0.6], [-0.5, 0.8]])


def _view(tilt_rad: float) -> BoardPose:
    """A board turned about y, so that its right side is nearer for positive tilts."""
    return BoardPose(
        rotation=jnp.asarray(Rotation.from_rotvec([[0, tilt_rad, 0]]).as_matrix()),
        translation_mm=jnp.array([[0.0, 0.0, DISTANCE_MM]]),
        aperture=jnp.zeros(1, int),
        half_board_mm=jnp.full((1, 2), HALF_MM),
        whole_board=jnp.zeros(1),
    )


def _shift(tilt_rad: float, radius_mm: float, radial=(0.0, 0.0)) -> np.ndarray:
    parameters = np.zeros(LAYOUT.size(1))
    parameters[LAYOUT.blocks["radial"]] = radial
    moved = centroid_shift_mm(
        jnp.asarray(parameters),
        _view(tilt_rad),
        jnp.zeros(1, int),
        jnp.asarray(MARKS)[None],
        jnp.asarray([radius_mm]),
        LAYOUT,
        FRAME,
    )
    return np.asarray(moved)[0]


@pytest.mark.parametrize("tilt_rad", [0.2, -0.5, 0.9])
@pytest.mark.parametrize("radius_mm", [2.0, 10.0])
def test_tilted_dot_on_the_axis_shifts_by_the_closed_form(tilt_rad, radius_mm):
    expected = FOCAL_MM * (radius_mm / DISTANCE_MM) ** 2
    expected *= np.sin(tilt_rad) * np.cos(tilt_rad)
    shift = _shift(tilt_rad, radius_mm)[0]
    np.testing.assert_allclose(shift[0], expected, rtol=0.01)
    assert abs(shift[1]) < 1e-12


def test_frontal_dots_without_distortion_do_not_shift():
    assert np.abs(_shift(0.0, 15.0)).max() < 1e-12


def test_marks_without_size_do_not_shift():
    np.testing.assert_array_equal(_shift(0.5, 0.0, (0.3, 0.1)), 0.0)


@pytest.mark.slow
@pytest.mark.parametrize(("tilt_rad", "radial"), [(0.0, (-0.5, 0.2)), (0.5, (0.4, 0))])
def test_agrees_with_the_image_area_summed_up(tilt_rad, radial):
    """The disc in 200 000 pieces, each weighed by the area of its image."""
    radius_mm = 12.0
    shared = np.zeros(LAYOUT.shared)
    shared[LAYOUT.blocks["radial"]] = radial
    view = jax.tree.map(lambda a: a[0], _view(tilt_rad))
    rho = np.sqrt((np.arange(200) + 0.5) / 200)
    angle = 2 * np.pi * (np.arange(64) + 0.5) / 64
    disc = np.stack(
        [np.outer(rho, np.cos(angle)).ravel(), np.outer(rho, np.sin(angle)).ravel()], -1
    )

    @jax.jit
    def image(mark):
        return predicted_mm(
            mark, jnp.asarray(shared), jnp.zeros(LAYOUT.local), view, LAYOUT, FRAME
        )

    @jax.jit
    def pieces(marks):
        place = jax.vmap(image)(marks)
        return place, jnp.linalg.det(jax.vmap(jax.jacfwd(image))(marks))

    expected = []
    for mark in MARKS:
        place, area = pieces(jnp.asarray(mark + disc * radius_mm / HALF_MM))
        place, area = np.asarray(place), np.asarray(area)
        expected.append(area @ place / area.sum() - image(jnp.asarray(mark)))
    shift = _shift(tilt_rad, radius_mm, radial)
    size = np.abs(expected).max()
    assert size > 1e-5
    np.testing.assert_allclose(shift, expected, atol=0.01 * size)


def test_shift_grows_with_the_square_of_the_radius():
    small, large = _shift(0.4, 3.0, (0.2, 0.0)), _shift(0.4, 6.0, (0.2, 0.0))
    np.testing.assert_allclose(large, 4 * small, rtol=2e-3, atol=1e-9)
