"""The lens that callers ask: conventions, shapes, channels, refusals."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from lens_makers import REFERENCE_MM, SENSOR_MM, frame_points_mm, strong_lens

from lensfit.lens import Lens
from lensfit.optics.distortion import no_distortion
from lensfit.optics.falloff import Illumination
from lensfit.optics.lateral import ChannelShift

FRAME = np.asarray(frame_points_mm())


def _shift(magnification: float) -> ChannelShift:
    return ChannelShift(
        jnp.asarray([magnification, 0.0]), jnp.zeros(2), jnp.asarray(1.05)
    )


@pytest.fixture(scope="module")
def plain() -> Lens:
    return Lens(
        distortion=no_distortion(50.0, REFERENCE_MM),
        lateral_colour=None,
        illumination=None,
        entrance_pupil_offset_mm=jnp.asarray(40.0),
        sensor_size_mm=SENSOR_MM,
        focal_length_mm=50.0,
    )


@pytest.fixture(scope="module")
def coloured() -> Lens:
    control = jnp.array([[0.1, 0.4, 0.9], [0.1, 0.3, 0.8], [0.2, 0.5, 1.0]])
    return Lens(
        distortion=strong_lens(0),
        lateral_colour=(_shift(1e-3), _shift(-2e-3)),
        illumination=Illumination(control, jnp.asarray(15.0)),
        entrance_pupil_offset_mm=jnp.asarray(40.0),
        sensor_size_mm=SENSOR_MM,
        focal_length_mm=25.0,
        f_number=2.8,
    )


def test_distances_count_from_the_sensor_and_rays_meet_in_the_pupil(plain):
    """A pupil 40 mm ahead sees a point at 2040 mm from 2000 mm away."""
    landed = plain.project([[100.0, -60.0, 2040.0]])
    np.testing.assert_allclose(landed, [[2.5, -1.5]], rtol=1e-14)


def test_orientation_is_kept(plain):
    right_and_down = np.asarray(plain.project([[1.0, 0.0, 1000.0], [0.0, 1.0, 1000.0]]))
    assert right_and_down[0, 0] > 0
    assert right_and_down[1, 1] > 0


@pytest.mark.parametrize("channel", ["r", "g", "b"])
def test_maps_are_inverse_pairs_in_every_channel(coloured, channel):
    undistorted = coloured.undistorted_from_distorted(FRAME, channel)
    back = coloured.distorted_from_undistorted(undistorted, channel)
    np.testing.assert_allclose(back, FRAME, atol=1e-11)


def test_project_and_distort_agree_in_every_channel(coloured):
    d = coloured.distortion
    point = np.array([[300.0, -200.0, 1540.0]])
    pinhole = np.asarray(d.principal_point_mm)
    pinhole = pinhole + float(d.principal_distance_mm) * point[:, :2] / 1500.0
    for channel in "rgb":
        np.testing.assert_allclose(
            coloured.project(point, channel),
            coloured.distorted_from_undistorted(pinhole, channel),
            atol=1e-12,
        )


def test_red_is_larger_and_blue_smaller_than_green(coloured):
    centre = np.asarray(coloured.distortion.principal_point_mm)
    radius = {
        channel: np.linalg.norm(
            np.asarray(coloured.distorted_from_undistorted(FRAME, channel)) - centre,
            axis=-1,
        )
        for channel in "rgb"
    }
    inside = (radius["g"] < 1.05 * REFERENCE_MM) & (radius["g"] > 0.1)
    np.testing.assert_allclose((radius["r"] / radius["g"])[inside], 1.001, rtol=1e-9)
    np.testing.assert_allclose((radius["b"] / radius["g"])[inside], 0.998, rtol=1e-9)


def test_without_lateral_colour_channels_agree(plain, coloured):
    assert coloured.has_lateral_colour
    assert not plain.has_lateral_colour
    np.testing.assert_array_equal(
        plain.project([[1.0, 2.0, 300.0]], "r"), plain.project([[1.0, 2.0, 300.0]], "b")
    )


def test_illumination_is_one_on_the_axis_and_falls_outwards(coloured):
    centre = np.asarray(coloured.distortion.principal_point_mm)
    line = centre + np.linspace(0, 25, 50)[:, None] * [[0.8, 0.6]]
    for k, channel in enumerate("rgb"):
        light = np.asarray(coloured.relative_illumination(line, channel))
        assert light[0] == 1.0
        assert (np.diff(light) < 0).all()
        assert light[-1] > 0
        edge = coloured.relative_illumination(centre[None] + [[15.0, 0.0]], channel)
        assert coloured.illumination is not None
        expected = np.exp(-coloured.illumination.control[k, -1])
        np.testing.assert_allclose(edge, expected, rtol=1e-12)


def test_unmeasured_illumination_is_one(plain):
    np.testing.assert_array_equal(plain.relative_illumination(FRAME), 1.0)


@pytest.mark.parametrize("count", [0, 7])
def test_shapes_and_precision(coloured, count):
    points = np.ones((count, 2), np.float32)
    for answer in (
        coloured.distorted_from_undistorted(points, "r"),
        coloured.undistorted_from_distorted(points, "b"),
        coloured.project(np.ones((count, 3)) * 900.0),
    ):
        assert answer.shape == (count, 2)
        assert answer.dtype == jnp.float64
    assert coloured.relative_illumination(points, "g").shape == (count,)


def test_wrong_shapes_are_refused(coloured):
    with pytest.raises(ValueError, match=r"\(3,\).*\(n, 2\)"):
        coloured.distorted_from_undistorted(np.zeros(3))
    with pytest.raises(ValueError, match=r"expected \(n, 3\)"):
        coloured.project(np.zeros((4, 2)))
    with pytest.raises(ValueError, match=r"expected \(n, 2\)"):
        coloured.undistorted_from_distorted(np.zeros((4, 3)))


@pytest.mark.parametrize("channel", ["R", "green", "", "rg"])
def test_unknown_channels_are_refused(plain, coloured, channel):
    for lens in (plain, coloured):
        with pytest.raises(ValueError, match="none of 'r', 'g', 'b'"):
            lens.project(np.zeros((1, 3)), channel)
        with pytest.raises(ValueError, match="none of 'r', 'g', 'b'"):
            lens.relative_illumination(np.zeros((1, 2)), channel)


def test_no_inverse_is_nan_and_only_there(plain):
    wide = replace(plain, distortion=no_distortion(5.0, REFERENCE_MM, "equidistant"))
    points = np.array([[5.0 * 1.5, 0.0], [5.0 * 1.6, 0.0]])
    undistorted = np.asarray(wide.undistorted_from_distorted(points))
    np.testing.assert_allclose(undistorted[0], [5 * np.tan(1.5), 0], rtol=1e-12)
    assert np.isnan(undistorted[1]).all()
