"""Board to sensor: rotation, pinhole, bends, and who is moved by what."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from pinhole_shoot import Camera
from scipy.spatial.transform import Rotation

from lensfit.fitting.geometry import (
    BoardPose,
    Frame,
    board_point_mm,
    distortion_of,
    parts_of,
    predicted_mm,
    rotation_from_vector,
)
from lensfit.fitting.parameters import DRIFT_PARAMETERS, POSE_PARAMETERS, Layout

FRAME = Frame(
    jnp.asarray(30.0),
    jnp.asarray(15.0),
    jnp.zeros(2),
    jnp.asarray(1.05),
    jnp.array([[-0.8, -0.6], [0.8, 0.6]]),
    jnp.asarray(900.0),
)
LAYOUT = Layout(radial=3, bend_degree=2, stretch_degree=2, apertures=1)
MARKS = np.random.default_rng(0).uniform(-1, 1, (30, 2))


def _view(whole_board: float = 1.0, aperture: int = 0) -> BoardPose:
    return BoardPose(
        rotation=jnp.asarray(Rotation.from_rotvec([0.2, -0.1, 0.05]).as_matrix()),
        translation_mm=jnp.array([20.0, -10.0, 900.0]),
        aperture=jnp.asarray(aperture),
        half_board_mm=jnp.array([280.0, 200.0]),
        whole_board=jnp.asarray(whole_board),
    )


@jax.jit
def _predict(shared, local, view):
    def one(mark):
        return predicted_mm(mark, shared, local, view, LAYOUT, FRAME)

    return jax.vmap(one)(jnp.asarray(MARKS))


SHARED, LOCAL = np.zeros(LAYOUT.shared), np.zeros(LAYOUT.local)


def _with(block: str, *values: float) -> np.ndarray:
    shared = SHARED.copy()
    start = LAYOUT.blocks[block].start
    shared[start : start + len(values)] = values
    return shared


@pytest.mark.parametrize(
    "vector",
    [[0.3, -0.2, 0.5], [0, 0, 0], [1e-5, 0, -1e-5], [1e-4, 1e-4, 0], [0, 3, 0.5]],
)
def test_rotation_agrees_with_scipy(vector):
    mine = rotation_from_vector(jnp.asarray(vector, float))
    scipys = Rotation.from_rotvec(vector).as_matrix()
    np.testing.assert_allclose(mine, scipys, atol=1e-15)


def test_derivative_of_rotation_at_zero_is_the_cross_product():
    for slope in (jax.jacfwd, jax.jacrev):
        generators = jax.jit(slope(rotation_from_vector))(jnp.zeros(3))
        np.testing.assert_allclose(
            np.einsum("ijk,j->ik", generators, [1.0, 2.0, 3.0]),
            np.stack([np.cross(axis, [1.0, 2.0, 3.0]) for axis in np.eye(3)], -1),
            atol=1e-15,
        )


def test_without_distortion_it_is_the_independent_pinhole():
    focal, centre, turn = 30.9, (0.3, -0.15), np.array([0.01, 0.02, -0.03])
    shared = _with("focal_length", np.log(focal / 30.0))
    shared[LAYOUT.blocks["principal_point"]] = np.asarray(centre) / 15.0
    local = LOCAL.copy()
    local[:3], local[3:6] = turn, [0.01, -0.02, 0.03]
    view = _view()
    board = np.concatenate([MARKS * [280.0, 200.0], np.zeros((30, 1))], -1)
    start = Rotation.from_matrix(np.asarray(view.rotation))
    camera = (Rotation.from_rotvec(turn) * start).apply(board)
    camera = camera + np.array([20.0, -10.0, 900.0]) + 900.0 * local[3:6]
    expected = Camera(focal_length_mm=focal, centre_mm=centre).image_mm(camera)
    np.testing.assert_allclose(_predict(shared, local, view), expected, atol=1e-12)


def test_shared_parameters_describe_the_lens():
    shared = _with("radial", 0.1, -0.2, 0.3)
    shared[LAYOUT.blocks["thin_prism"]] = [1, 2, 3, 4]
    lens = distortion_of(jnp.asarray(shared), LAYOUT, FRAME)
    np.testing.assert_array_equal(lens.radial, [0.1, -0.2, 0.3])
    np.testing.assert_array_equal(lens.named[4:8], [1, 2, 3, 4])
    assert float(lens.principal_distance_mm) == 30.0


def test_bend_lifts_the_board_and_vanishes_nowhere_else():
    bent = LOCAL.copy()
    bent[POSE_PARAMETERS + DRIFT_PARAMETERS] = 0.01
    parts = parts_of(jnp.asarray(SHARED), jnp.asarray(bent), LAYOUT)
    point = board_point_mm(jnp.array([1.0, 0.3]), parts, _view(), LAYOUT)
    np.testing.assert_allclose(point, [280.0, 60.0, 0.01 * 280.0], rtol=1e-14)


def test_a_rolling_shutter_moves_every_row_in_proportion_to_its_height():
    drifting = LOCAL.copy()
    drifting[POSE_PARAMETERS : POSE_PARAMETERS + DRIFT_PARAMETERS] = 0.003, -0.002
    still = np.asarray(_predict(SHARED, LOCAL, _view()))
    moved = np.asarray(_predict(SHARED, drifting, _view())) - still
    np.testing.assert_allclose(moved, still[:, 1:] * [0.003, -0.002], atol=1e-15)


def test_stretch_moves_only_boards_seen_whole():
    stretched = _with("board_stretch", 0.01, 0.02)
    moved = _predict(stretched, LOCAL, _view()) - _predict(SHARED, LOCAL, _view())
    assert np.abs(moved).max() > 1e-2
    part = _view(whole_board=0.0)
    np.testing.assert_array_equal(
        _predict(stretched, LOCAL, part), _predict(SHARED, LOCAL, part)
    )


def test_aperture_shift_is_radial_and_spares_the_smallest_aperture():
    shifted = _with("aperture_shift", 1e-3, 2e-3, -1e-3)
    small = np.asarray(_predict(SHARED, LOCAL, _view()))
    np.testing.assert_array_equal(_predict(shifted, LOCAL, _view()), small)
    moved = np.asarray(_predict(shifted, LOCAL, _view(aperture=1))) - small
    q = small / 15.0
    r2 = np.sum(q**2, -1, keepdims=True)
    expected = 15.0 * q * (1e-3 + 2e-3 * r2 - 1e-3 * r2**2)
    np.testing.assert_allclose(moved, expected, atol=1e-13)
