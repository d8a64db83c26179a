"""Kernels where optics degenerate: infinity, the front element, f/0.7, f/64, no depth.

The measured lens is the prime of `presets/`; ideal ones have closed forms.
"""

import math
from functools import cache
from pathlib import Path

import equinox as eqx
import hypothesis.strategies as st
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from examples import examples
from hypothesis import given
from jax.flatten_util import ravel_pytree

import lensfit
from lensfit.errors import LensfitError, PresetError
from lensfit.lens import Lens
from lensfit.optics.pupil_nodes import pupil_nodes
from lensfit.optics.spectrum import chromatic_coordinate
from lensfit.preset.thin_lens import ThinCamera, thin_lens_preset
from lensfit.psf.spot import (
    diffraction_variance_mm2,
    image_of,
    landed_rays,
    pixel_shares,
    profile_of,
    split_by_wavelength,
    spot_of,
)

PRIME = Path(__file__).parents[2] / "presets" / "prime_50" / "preset.json"
FIELD = (5.0, 3.0)
SIZE = 64


def thin(f_number: float, focus_mm: float, focal_mm: float = 50.0) -> Lens:
    """An ideal lens in front of 36 mm."""
    camera = ThinCamera(focal_mm, f_number, focus_mm / 1000, 36.0, 96, 64)
    preset = thin_lens_preset(camera)
    return preset.at(focal_mm, f_number, focus_mm)


@cache
def prime(f_number: float) -> Lens:
    """A measured one."""
    return lensfit.load_preset(PRIME).at(f_number=f_number, focus_distance_mm=2000.0)


def psf(lens: Lens, distance_mm: float, point=FIELD, channel="g", pitch_mm=0.006):
    options = {"pixel_pitch_mm": pitch_mm, "size_px": SIZE}
    return np.asarray(lens.psf(point, distance_mm, channel, **options))


def relative(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.linalg.norm(one - other) / np.linalg.norm(other))


def disc_radius_px(patch: np.ndarray) -> float:
    """Of the disc with the same second moment, less that of a pixel."""
    x = np.arange(len(patch)) - (len(patch) - 1) / 2
    rows, columns = patch.sum(1), patch.sum(0)
    square = sum(w @ x**2 - (w @ x) ** 2 - 1 / 12 for w in (rows, columns))
    return math.sqrt(2 * max(square, 0.0))


@pytest.mark.parametrize("f_number", [0.7, 2.0])
def test_focus_at_infinity(f_number: float, measured):
    """Focus at infinity: an ordinary distance, equal to 1e9 mm, sharp for the sky and
    the thin lens' disc for the rest."""
    there, near = thin(f_number, math.inf), thin(f_number, 1e9)
    for distance in (math.inf, 1e9, 50_000.0, 3000.0):
        both = [psf(lens, distance, pitch_mm=0.05) for lens in (there, near)]
        measured("against 1e9 mm, relative L2", relative(*both), 1e-4)
    distance = 2e5 / f_number
    exact = 50 / f_number * 50 / distance / 2 / 0.001
    found = disc_radius_px(psf(there, distance, (0.0, 0.0), pitch_mm=0.001))
    measured("radius, relative", abs(found / exact - 1), 0.02)


def test_focus_at_the_front_element(measured):
    """Focus at the front element (to 1e-9 focal lengths from the front focal point):
    what is in focus is sharp, the rest a thin lens' disc, all sums are 1, and an object
    at the front focal point is refused."""
    for beyond in (1e-1, 1e-3, 1e-6, 1e-9):
        focus = 50.0 * (1 + beyond)
        lens = thin(2.0, focus)
        assert psf(lens, focus).max() > 0.2
        for distance in (focus, 60.0, 2000.0, math.inf):
            patch = psf(lens, distance)
            assert patch.min() >= 0
            measured("sum", abs(patch.sum() - 1), 1e-12)
        exact = 50 / 2 * 50 * (1 / focus - 1 / 80) / 2
        found = disc_radius_px(psf(lens, 80.0, (0.0, 0.0), pitch_mm=exact / 20)) / 20
        measured("radius of an object at 80 mm, relative", abs(found - 1), 0.03)
        with pytest.raises(LensfitError, match="no sharp image"):
            psf(lens, lens.perfect_blur().nearest_mm)


def test_as_fast_and_as_slow_as_lenses_get(measured):
    """f/0.7 and f/64: the blur has the thin lens' radius (to the 1/8N^2 of a fast one),
    and in focus the width of diffraction."""
    at = (0.0, 0.0)
    for f_number, distance in ((0.7, 2100.0), (64.0, 300.0)):
        lens = thin(f_number, 2000.0)
        opening = 50 / f_number * 50
        radius = opening * abs(1 / distance - 1 / 2000) / 2
        patch = psf(lens, distance, at, pitch_mm=radius / 20)
        airy = 0.42 * 550e-6 * f_number / (radius / 20)
        exact = math.sqrt(20**2 + 4 * airy**2)
        off = abs(disc_radius_px(patch) / exact - 1)
        measured(f"radius at f/{f_number:g}, relative", off, 0.05)
        pitch = 0.1 * 0.42 * 550e-6 * f_number
        sharp = disc_radius_px(psf(lens, 2000.0, at, pitch_mm=pitch)) / 2
        measured("width in focus, relative", abs(sharp / 10 - 1), 0.05)


@pytest.mark.parametrize("distance", [0.0, -1.0, -math.inf, math.nan, 49.0])
def test_no_depth_at_all(distance: float, measured):
    """Objects at zero, negative or no distance: refused in one line."""
    with pytest.raises(LensfitError, match="no sharp image") as caught:
        psf(thin(2.0, math.inf), distance)
    measured("lines of the refusal", str(caught.value).count("\n") + 1, 1)


@pytest.mark.parametrize("name", ["f_number", "focus_distance_mm"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, -math.inf])
def test_no_such_setting(name: str, value: float, measured):
    """f-number or focus of zero, less, or NaN: refused in one line."""
    with pytest.raises(PresetError, match=name) as caught:
        lensfit.load_preset(PRIME).at(**{name: value})
    measured("lines of the refusal", str(caught.value).count("\n") + 1, 1)


places = st.tuples(st.floats(-12, 12), st.floats(-8, 8))
vergences = st.floats(0, 1 / 400)


@examples(25)
@given(
    f_number=st.sampled_from([1.4, 2.0, 5.6, 22.0]),
    place=places,
    vergence=vergences,
    channel=st.sampled_from("rgb"),
)
def test_kernels_are_shares_of_light(f_number, place, vergence, channel, measured):
    """Kernel anywhere (measured lens, f/1.4 to f/22, .4 m to infinity, each colour):
    sums to 1, nothing is negative."""
    distance = 1 / vergence if vergence > 0 else math.inf
    patch = psf(prime(f_number), distance, place, channel, pitch_mm=0.02)
    measured("sum", abs(patch.sum() - 1), 1e-12)
    measured("below zero", max(0.0, -patch.min()), 0.0)


@examples(15)
@given(place=places, vergence=vergences, f_number=st.sampled_from([0.7, 2.0, 16.0]))
def test_kernels_have_the_symmetry_of_their_lens(place, vergence, f_number, measured):
    """Kernel of an ideal lens (f/0.7 to f/16): on the axis the mirror image of itself,
    elsewhere that of the mirrored place, to about the tolerance asked for (.01)."""
    distance = 1 / vergence if vergence > 0 else math.inf
    lens = thin(f_number, 2000.0)
    patch = psf(lens, distance, (0.0, 0.0), pitch_mm=0.05)
    for turned in (patch[::-1], patch[:, ::-1], patch.T):
        measured("on the axis, relative L2", relative(turned, patch), 0.03)
    patch = psf(lens, distance, place, pitch_mm=0.05)
    across = psf(lens, distance, (-place[0], place[1]), pitch_mm=0.05)
    measured("across, relative L2", relative(across[:, ::-1], patch), 0.03)


@pytest.mark.slow
def test_a_rack_focus_has_no_jump(measured):
    """Kernel through focus in 240 steps (which change how many rays make it): no step
    is larger than its neighbours by more than the tolerance of .01."""
    vergence = np.linspace(1 / 1500, 1 / 3000, 241)
    lens = prime(1.4)
    options = {"pixel_pitch_mm": 0.006, "size_px": SIZE}
    points = np.tile(FIELD, (len(vergence), 1))
    all_of_them = np.asarray(lens.psfs(points, 1 / vergence, ("g",), **options))[:, 0]
    size = np.linalg.norm(all_of_them[1:], axis=(1, 2))
    steps = np.linalg.norm(np.diff(all_of_them, axis=0), axis=(1, 2)) / size
    usual = np.array([np.median(steps[max(i - 6, 0) : i + 7]) for i in range(240)])
    measured("jump, relative L2", (steps - usual).max(), 0.01)


@eqx.filter_jit
def smooth_kernel(flat, restored, wavelengths_nm, size_px: int, rays: int):
    """As the fit sees a dot: a function of every number of the lens."""
    (aberration, pupil), place, defocus, f_number = restored(flat)
    chromatic = chromatic_coordinate(wavelengths_nm)
    nodes = pupil_nodes(place / aberration.field_radius_mm, jnp.ones(()), pupil, rays)
    u = split_by_wavelength(nodes.u, len(wavelengths_nm))
    landed = landed_rays(u, place, aberration, defocus, chromatic)
    spot = spot_of(landed, nodes, jnp.zeros((len(wavelengths_nm), 2)))
    pitch = jnp.asarray([0.006, 0.006])
    profile = profile_of(
        spot, -size_px / 2 * pitch, pitch, size_px, diffraction_variance_mm2(f_number)
    )
    return image_of(spot, profile)


@pytest.mark.slow
@pytest.mark.parametrize("defocus", [0.0, 0.05])
def test_kernels_are_continuous_in_every_parameter(defocus: float, measured):
    """Kernel as a function of every number of the lens (aberrations, colours, rims,
    place, defocus, f-number): a step a hundred times smaller changes it a hundred times
    less, in focus and out of it."""
    blur = prime(1.4).blur
    assert blur is not None
    numbers = ((blur.aberration, blur.pupil), jnp.asarray(FIELD), defocus, 1.4)
    numbers = jax.tree.map(lambda a: jnp.asarray(a, float), numbers)
    flat, restored = ravel_pytree(numbers)
    wavelengths = blur.bands.wavelengths_nm[1]

    def kernel(values):
        return smooth_kernel(values, restored, wavelengths, 32, 384)

    here = np.asarray(kernel(flat))
    size = jnp.maximum(jnp.abs(flat), 1e-2)
    for i in range(flat.size):
        change = [
            relative(np.asarray(kernel(flat.at[i].add(step * size[i]))), here)
            for step in (1e-3, 1e-5)
        ]
        measured("step of 1e-5, relative L2", change[1], 1e-3)
        if change[1] > 1e-9:
            ratio = change[0] / change[1]
            measured("its share, off 100", abs(ratio / 100 - 1), 0.2)


def test_kernels_in_32_bits(measured):
    """Kernel, float32 against float64: pixels of 4000 rays agree to a few roundings."""
    rng = np.random.default_rng(0)
    at = rng.normal(32, 6, (4000, 2))
    sigma = rng.uniform(0.05, 3, 4000)

    def patch(dtype):
        x, y, s = (jnp.asarray(a, dtype) for a in (*at.T, sigma))
        columns, _ = pixel_shares(x, s, SIZE)
        rows, _ = pixel_shares(y, s, SIZE)
        return np.asarray(rows @ columns.T, float)

    measured("relative L2", relative(patch(np.float32), patch(np.float64)), 1e-6)
