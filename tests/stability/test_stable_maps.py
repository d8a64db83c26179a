"""Maps where they are hard to invert: near a fold, at 180 degree fields, in 32 bits."""

from dataclasses import replace

import equinox as eqx
import hypothesis.strategies as st
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from examples import examples
from hypothesis import given
from scipy.integrate import quad

from lensfit.coords import Window
from lensfit.lens import Lens
from lensfit.optics import field
from lensfit.optics.distortion import (
    Distortion,
    distorted_from_undistorted,
    magnification,
    no_distortion,
    undistorted_from_distorted,
    undistorted_radius,
)
from lensfit.optics.lateral import ChannelShift
from lensfit.optics.projection import BASE_PROJECTIONS, image_of_direction
from lensfit.rendering.uv import PlateGeometry, SourceMap, stmap_redistort

RADII = jnp.linspace(0.0, 1.0, 2001)
ONE = jnp.ones(())
REFERENCE_MM = 15.0
SENSOR_MM = (24.0, 18.0)
DEGREE = 4


@jax.jit
def profile(radius, coefficients):
    return radius * jax.vmap(lambda r: magnification(r**2, coefficients, ONE))(radius)


@jax.jit
def inverse(radius, coefficients):
    return jax.vmap(lambda r: undistorted_radius(r, coefficients, ONE))(radius)


@eqx.filter_jit
def distort(points, lens):
    return jax.vmap(distorted_from_undistorted, (0, None))(points, lens)


@eqx.filter_jit
def undistort(points, lens):
    return jax.vmap(undistorted_from_distorted, (0, None))(points, lens)


@pytest.mark.parametrize("slope", [1e-2, 1e-4, 1e-6])
def test_a_profile_near_its_fold(slope: float, measured):
    """Radial map near the fold (slope 1e-2 to 1e-6 at the frame's edge): still rises,
    equals the integral of its slope, and inverts to rounding over slope."""
    coefficients = jnp.asarray([np.log(slope), 0.0, 0.0])
    there = profile(RADII, coefficients)
    assert (np.diff(there) > 0).all()
    exact = quad(lambda r: slope ** (r * r), 0, 1, epsabs=1e-15)[0]
    measured("r' against quadrature", abs(float(there[-1]) - exact), 1e-13)
    back = inverse(there, coefficients)
    again = profile(back, coefficients)
    measured("r' after the round trip", np.abs(again - there).max(), 1e-15)
    measured("r times slope", np.abs(back - RADII).max() * slope, 1e-15)


@pytest.mark.parametrize("log_slope", [-700.0, -100.0, -20.0, 20.0, 100.0, 300.0])
def test_a_profile_that_no_number_holds(log_slope: float, measured):
    """Radial map beyond any lens (slope e^-700 to e^300): its inverse is right on the
    sensor, or NaN, never wrong."""
    coefficients = jnp.asarray([log_slope, 0.0, 0.0])
    there = profile(jnp.linspace(0.0, 3.0, 301), coefficients)
    there = there[np.isfinite(there) & (there < 1e300)]
    back = inverse(there, coefficients)
    found = np.isfinite(back)
    off = np.abs(profile(back[found], coefficients) - there[found])
    measured("share of r' where found", (off / (there[found] + 1e-300)).max(), 2e-9)


@pytest.mark.parametrize("base", ["stereographic", "equidistant"])
def test_fields_of_180_degrees(base, measured):
    """Inverse at a field of 180 degrees (1e-1 to 1e-12 rad short of 90 off axis): the
    undistorted point is far out and lands where it came from; NaN from 90 degrees."""
    lens = no_distortion(10.0, REFERENCE_MM, base)
    edge_mm = {"stereographic": 20.0, "equidistant": 5 * np.pi}[base]
    short = 10.0 ** -np.arange(1, 13)
    turn = np.linspace(0, 2, 12)
    ray = np.stack([np.cos(turn), np.sin(turn)], -1)
    inside = jnp.asarray(ray * (edge_mm * (1 - short))[:, None])
    far = undistort(inside, lens)
    measured("mm", np.abs(distort(far, lens) - inside).max(), 2e-14)
    tangent = np.hypot(*np.asarray(far).T) / 10
    angle = np.hypot(*np.asarray(inside).T) / 10
    exact = {"stereographic": 2 * np.arctan(angle / 2), "equidistant": angle}[base]
    wrong = np.abs(np.arctan(tangent) - exact)
    measured("rad", wrong.max(), 1e-15)
    beyond = undistort(jnp.asarray(ray * edge_mm * (1 + 1e-12)), lens)
    assert np.isnan(beyond).all()


@pytest.mark.parametrize("base", ["stereographic", "equidistant"])
def test_directions_behind_the_lens(base, measured):
    """Directions of 90 to 180 degrees off axis: land by the closed form."""
    angle = np.pi - np.append(10.0 ** np.linspace(-8, 0, 33), np.pi / 2)
    rays = jnp.asarray(np.stack([np.sin(angle), 0 * angle, np.cos(angle)], -1))
    landed = jax.vmap(lambda d: image_of_direction(d, base))(rays)[:, 0]
    # What is left to 180 degrees is taken from the ray itself: pi - angle rounds.
    left = np.arctan2(rays[:, 0], -rays[:, 2])
    exact = {"stereographic": 2 / np.tan(left / 2), "equidistant": np.pi - left}[base]
    measured("relative", np.abs(landed / exact - 1).max(), 1e-14)


def fisheye() -> Lens:
    """Equidistant, 180 degrees across the width."""
    return Lens(
        distortion=no_distortion(SENSOR_MM[0] / np.pi, REFERENCE_MM, "equidistant"),
        lateral_colour=None,
        illumination=None,
        entrance_pupil_offset_mm=jnp.zeros(()),
        sensor_size_mm=SENSOR_MM,
        focal_length_mm=8.0,
    )


def test_a_uv_map_of_180_degrees(measured):
    """UV map of a field of 180 degrees: finite inside the image circle, NaN outside,
    and right to a share of the distance from the axis."""
    window = Window.of_size(200, 150)
    found = stmap_redistort(fisheye(), window).positions_px() - [100, 75]
    away = window.pixel_centres() - [100, 75]
    angle = np.hypot(*np.moveaxis(away, -1, 0)) * np.pi / 200
    inside = angle < np.pi / 2
    assert np.isnan(found[~inside]).all()
    assert np.isfinite(found[inside]).all()
    exact = away * (200 / np.pi * np.tan(angle) / (angle * 200 / np.pi))[..., None]
    off = np.linalg.norm(found - exact, axis=-1) / np.linalg.norm(exact, axis=-1)
    measured("relative", off[inside].max(), 2e-6)


def test_maps_in_32_bits_over_16k_pixels(measured):
    """Map of 16,384 pixels, float32 against float64: displacements keep 1e-4 px, UV
    files a float's step at 1 (2 / 1024 px)."""
    lens = replace(
        fisheye(),
        distortion=replace(
            no_distortion(30.0, REFERENCE_MM), radial=jnp.asarray([-0.3, 0.1])
        ),
    )
    display = Window.of_size(16384, 12288)
    strip = Window(0, 6100, 16383, 6107)
    found = stmap_redistort(lens, display, strip)
    points = strip.pixel_centres()[::7, ::97]
    geometry = PlateGeometry.of(lens, display)
    exact = geometry.undistorted(lens, "g")(points.reshape(-1, 2)).reshape(points.shape)
    away = np.abs(found.positions_px()[::7, ::97] - exact)
    measured("displacement, px", away.max(), 1e-4)
    read = SourceMap.from_uv(found.uv(display), strip, display).positions_px()
    measured("UV file, px", np.abs(read[::7, ::97] - exact).max(), 2.5e-3)


numbers = st.floats(-1, 1, allow_subnormal=False)


@st.composite
def lenses(draw, base):
    """Anything from a fisheye to a telephoto, as bad as glass can be."""
    count = len(field.free_degrees(DEGREE))
    scale = draw(st.lists(numbers, min_size=3, max_size=3))
    seed = draw(st.integers(0, 2**32 - 1))
    rng = np.random.default_rng(seed)
    size = draw(st.floats(0, 0.02))
    squeeze, azimuth = draw(st.floats(0.5, 2.1)), draw(st.floats(-1.57, 1.57))
    turned = np.array([np.cos(2 * azimuth), np.sin(2 * azimuth)])
    ideal = no_distortion(np.exp(draw(st.floats(1.5, 6.5))), REFERENCE_MM, base)
    return replace(
        ideal,
        principal_point_mm=jnp.asarray(rng.uniform(-2, 2, 2)),
        radial=jnp.asarray(scale) * jnp.asarray([1.5, 0.5, 0.2]),
        valid_radius=jnp.asarray(draw(st.floats(0.3, 1.5))),
        squeeze=jnp.asarray(np.log(squeeze) * turned),
        named=jnp.asarray(rng.uniform(-size, size, ideal.named.size)),
        free=jnp.asarray(rng.uniform(-size, size, (2, count))),
        degree=DEGREE,
    )


X, Y = np.meshgrid(np.linspace(-13.8, 13.8, 9), np.linspace(-10.4, 10.4, 7))
FRAME = jnp.asarray(np.stack([X.ravel(), Y.ravel()], -1))


@pytest.mark.slow
@pytest.mark.parametrize("base", BASE_PROJECTIONS)
def test_maps_are_inverse_pairs(base, measured):
    """Inverse pair of any lens (f 4.5 to 660 mm, scale changed up to 9 times, squeezed,
    decentred, with a free field): back to the same point."""

    @examples(40)
    @given(lens=lenses(base))
    def pair(lens: Distortion) -> None:
        undistorted = undistort(FRAME, lens)
        seen = np.isfinite(undistorted).all(-1)
        if base == "rectilinear":
            assert seen.all()
        back = distort(undistorted, lens)
        off = np.abs(back - FRAME)[seen]
        measured("mm", off.max(initial=0.0), 1e-12)

    pair()


@examples(25)
@given(
    magnified=st.lists(st.floats(-5e-3, 5e-3), min_size=2, max_size=2),
    moved=st.lists(st.floats(-2e-2, 2e-2), min_size=2, max_size=2),
    channel=st.sampled_from(["r", "b"]),
)
def test_colours_are_inverse_pairs(magnified, moved, channel, measured):
    """Inverse pair of red and blue (lateral colour up to .5 %): back to the same point,
    also through `Lens`."""
    shift = ChannelShift(jnp.asarray(magnified), jnp.asarray(moved), jnp.asarray(1.05))
    lens = replace(
        fisheye(),
        distortion=replace(
            no_distortion(25.0, REFERENCE_MM), radial=jnp.asarray([-0.6, 0.2])
        ),
        lateral_colour=(shift, shift),
    )
    undistorted = lens.undistorted_from_distorted(FRAME, channel)
    back = lens.distorted_from_undistorted(undistorted, channel)
    measured("mm", np.abs(back - FRAME).max(), 1e-12)
