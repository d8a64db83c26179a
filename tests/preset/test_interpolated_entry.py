"""Between measured states: one-to-one, continuous, in the span, exact at the ends."""

import itertools
import math

import hypothesis.strategies as st
import jax
import jax.numpy as jnp
import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from preset_makers import make_entry, make_preset

from lensfit.optics import radial
from lensfit.optics.distortion import jacobian_at
from lensfit.preset.blend import blend
from lensfit.preset.blocks import (
    Camera,
    ChannelShift,
    Distortion,
    FallOff,
    LateralColour,
    Projection,
)
from lensfit.preset.entry import Entry
from lensfit.preset.interpolated_entry import (
    focus_weight,
    interpolated_in_focal_length,
    interpolated_in_focus,
)
from lensfit.preset.lens_of_entry import lens_of_entry

CAMERA = Camera(None, 28.0, 21.0, 2800, 2100)
X, Y = np.meshgrid(np.linspace(-16.1, 16.1, 9), np.linspace(-12.1, 12.1, 7))
FRAME = np.stack([X.ravel(), Y.ravel()], -1)
"""The frame and 15 % overscan, sensor mm."""
RADII = np.linspace(0, 2.5, 200)

PAIRS = 50
"""In every example of `many`: 1250 together; in the fast run, 300."""

many = settings(max_examples=25, deadline=None, derandomize=True)
some_of_many = settings(many, max_examples=6)
some = settings(max_examples=40, deadline=None, derandomize=True)
few = settings(max_examples=8, deadline=None, derandomize=True)


def entry_of(seed: int) -> Entry:
    """Anything that a preset may hold of one lens; far wilder than a lens is."""
    rng = np.random.default_rng(seed)

    def numbers(count: int, largest: float) -> tuple[float, ...]:
        return tuple(rng.uniform(-largest, largest, count).tolist())

    def radius() -> float:
        return float(rng.uniform(0.7, 1.4))

    focal_length_mm = float(rng.uniform(20, 90))
    distortion = Distortion(
        base="rectilinear",
        reference_radius_mm=17.5,
        valid_radius=radius(),
        valid_box=(-radius(), -radius(), radius(), radius()),
        radial_log_slope=tuple(rng.uniform(-1, 1, 3) * (1.0, 0.6, 0.2)),
        decentering=numbers(4, 0.02),
        thin_prism=numbers(2, 0.02),
        anamorphic=numbers(8, 0.02),
        squeeze=2 ** float(rng.uniform(-1, 1)),
        squeeze_axis_rad=float(rng.uniform(-1.57, 1.57)),
    )
    shift = ChannelShift(numbers(2, 3e-3), numbers(2, 1e-2), radius())
    loss = tuple(np.sort(rng.uniform(0, 1.5, 3)).tolist())
    return make_entry(
        focal_length_mm=focal_length_mm,
        projection=Projection(
            focal_length_mm * float(rng.uniform(0.9, 1.15)),
            numbers(2, 0.5),
            float(rng.uniform(-50, 200)),
        ),
        distortion=distortion,
        lateral_colour=LateralColour(shift, shift),
        fall_off=(FallOff(2.8, 17.5 * radius(), loss, loss, loss),),
        blur=None,
    )


entries = st.integers(0, 2**32 - 1).map(entry_of)


def pair_between(first: Entry, second: Entry, how: str, share: float) -> Entry:
    """The entry at a share of the way, zooming or focusing."""
    if how == "zoom":
        first = msgspec.structs.replace(first, focal_length_mm=35.0)
        second = msgspec.structs.replace(second, focal_length_mm=70.0)
        return interpolated_in_focal_length(first, second, 35.0 + share * 35.0)
    first = msgspec.structs.replace(first, focus_distance_mm=math.inf)
    second = msgspec.structs.replace(second, focus_distance_mm=600.0)
    return interpolated_in_focus(first, second, 600.0 / share if share else math.inf)


def distortions_between(seed: int, how: str):
    """Distortions at random places between random pairs of entries, stacked."""
    rng = np.random.default_rng(seed)
    lenses = []
    for first, second in rng.integers(0, 2**32, (PAIRS, 2)):
        found = pair_between(
            entry_of(first), entry_of(second), how, float(rng.random())
        )
        lenses.append(lens_of_entry(found, CAMERA).distortion)
    return jax.tree.map(lambda *leaves: np.stack(leaves), *lenses)


@jax.jit
def profiles(distortions):
    """Distorted radii of rising ones."""

    def one(d):
        return jax.vmap(
            lambda r: r * radial.magnification(r**2, d.radial, d.valid_radius**2)
        )(jnp.asarray(RADII))

    return jax.vmap(one)(distortions)


@jax.jit
def determinants(distortions):
    def one(d):
        jacobian = jax.vmap(lambda p: jacobian_at(p, d))(jnp.asarray(FRAME))
        return jnp.linalg.det(jacobian)

    return jax.vmap(one)(distortions)


seeds = st.integers(0, 2**32 - 1)
how = st.sampled_from(["zoom", "focus"])
share = st.floats(0.0, 1.0)


@some_of_many
@given(seeds, how)
def test_no_map_between_entries_folds_anywhere(seed, how):
    assert_no_map_folds(seed, how)


@pytest.mark.slow
@many
@given(seeds, how)
def test_no_map_between_more_entries_folds_anywhere(seed, how):
    assert_no_map_folds(seed, how)


def assert_no_map_folds(seed, how):
    """Radial profiles rise far beyond the frame. Where the determinant is positive
    over a rectangle, no two of its points meet."""
    distortions = distortions_between(seed, how)
    assert np.diff(profiles(distortions), axis=1).min() > 0
    assert np.asarray(determinants(distortions)).min() > 0


@few
@given(entries, entries, how, share)
def test_maps_between_entries_are_undone(first, second, how, share):
    lens = lens_of_entry(pair_between(first, second, how, share), CAMERA)
    for channel in ("r", "g", "b"):
        there = lens.distorted_from_undistorted(FRAME, channel)
        back = np.asarray(lens.undistorted_from_distorted(there, channel))
        assert np.abs(back - FRAME).max() < 1e-7


def everything(entry: Entry) -> np.ndarray:
    """Where frame and overscan land in each colour, and what arrives there."""
    lens = lens_of_entry(entry, CAMERA)
    maps = [lens.distorted_from_undistorted(FRAME, c) for c in ("r", "g", "b")]
    object_mm = np.column_stack([FRAME * 40, np.full(len(FRAME), 2000.0)])
    maps.append(lens.project(object_mm))
    light = np.asarray(lens.relative_illumination(FRAME))[:, None]
    return np.concatenate([*map(np.asarray, maps), np.repeat(light, 2, 1)])


@few
@given(entries, entries, how)
def test_nothing_jumps_where_a_sequence_leaves_an_entry(first, second, how):
    """Photographed areas differ between the two, and the corners lie beyond both."""
    tiny = 1e-9
    for end, near in ((0.0, tiny), (1.0, 1 - tiny)):
        exact = everything(pair_between(first, second, how, end))
        beside = everything(pair_between(first, second, how, near))
        assert np.abs(beside - exact).max() < 1e-5


@some
@given(entries, entries, st.floats(0.01, 0.99))
def test_every_number_stays_between_its_neighbours(first, second, share):
    for how in ("zoom", "focus"):
        found = pair_between(first, second, how, share)
        radials = (e.distortion.radial_log_slope for e in (first, second, found))
        for a, b, value in zip(*radials, strict=True):
            slack = 1e-12 * max(abs(a), abs(b))
            assert min(a, b) - slack <= value <= max(a, b) + slack
    c = [e.projection.principal_distance_mm for e in (first, second, found)]
    assert min(c[:2]) * (1 - 1e-12) <= c[2] <= max(c[:2]) * (1 + 1e-12)


@some
@given(entries, entries, st.floats(0, 1))
def test_a_point_leaves_the_span_no_more_than_the_orders_part(first, second, share):
    """ln dr'/dr is a mean of both, but for orders that move at their own pace."""
    found = pair_between(first, second, "zoom", share).distortion.radial_log_slope
    a, b = (np.array(e.distortion.radial_log_slope) for e in (first, second))
    ratio = 1 + share
    weights = np.array(
        [(1 - ratio ** (-2 * k)) / (1 - 2.0 ** (-2 * k)) for k in (1, 2, 3)]
    )
    powers = np.linspace(0, 1.2, 30)[:, None] ** np.arange(1, 4)
    slack = powers @ (np.abs(weights - weights[0]) * np.abs(b - a))
    low, high = np.minimum(powers @ a, powers @ b), np.maximum(powers @ a, powers @ b)
    value = powers @ np.array(found)
    assert (value >= low - slack - 1e-12).all()
    assert (value <= high + slack + 1e-12).all()


def test_distortion_that_belongs_to_the_field_angle_is_followed_exactly():
    def entry_at(focal: float) -> Entry:
        distortion = msgspec.structs.replace(
            make_entry().distortion,
            radial_log_slope=(-100 / focal**2, 5e4 / focal**4, -2e6 / focal**6),
        )
        projection = Projection(focal * (1 + 1e-3 * focal), (0.0, 0.0), 60.0)
        return make_entry(
            focal_length_mm=focal, distortion=distortion, projection=projection
        )

    preset = make_preset(entry_at(24.0), entry_at(70.0))
    for focal in (25.0, 35.0, 50.0, 69.0):
        found, wanted = preset.select(focal).entry, entry_at(focal)
        assert found.distortion.radial_log_slope == pytest.approx(
            wanted.distortion.radial_log_slope, rel=1e-12
        )
        assert found.projection.principal_distance_mm == pytest.approx(
            wanted.projection.principal_distance_mm, rel=1e-12
        )


def test_breathing_is_monotone_and_ends_where_it_was_measured():
    near = make_entry(
        focus_distance_mm=500.0, projection=Projection(56.0, (0.0, 0.0), 60.0)
    )
    far = make_entry(
        focus_distance_mm=math.inf, projection=Projection(50.0, (0.0, 0.0), 58.0)
    )
    preset = make_preset(near, far)
    focus = [500.0, 500.1, 600.0, 1e3, 3e3, 1e5, 1e12, math.inf]
    c = [
        preset.select(50, 2.8, f).entry.projection.principal_distance_mm for f in focus
    ]
    assert c[0] == 56.0
    assert c[-1] == 50.0
    assert all(a >= b for a, b in itertools.pairwise(c))
    assert c[1] == pytest.approx(56.0, abs=5e-3)


def test_a_pupil_that_cannot_be_meant_does_not_break_the_focus():
    far = make_entry(focus_distance_mm=math.inf)
    near = make_entry(
        focus_distance_mm=300.0, projection=Projection(56.0, (0.0, 0.0), 290.0)
    )
    assert focus_weight(far, near, 600.0) == pytest.approx(0.5)


def test_beyond_the_ends_the_nearest_holds_and_is_noted():
    wide = make_entry(focal_length_mm=24.0)
    long = make_entry(focal_length_mm=70.0)
    preset = make_preset(wide, long)
    for asked, nearest in ((23.0, wide), (73.0, long)):
        chosen = preset.select(asked)
        assert chosen.entry.distortion == nearest.distortion
        assert any("taken as the measured" in note for note in chosen.notes)


def test_fall_off_keeps_both_of_its_ends():
    first = FallOff(2.8, 15.0, (0.4, 0.5), (0.4, 0.5), (0.4, 0.5))
    second = FallOff(2.8, 12.0, (0.1, 0.1, 0.9), (0.1, 0.1, 0.9), (0.1, 0.1, 0.9))
    for weight in np.linspace(0, 1, 21):
        mixed = blend(first, second, float(weight))
        assert all(a <= b + 1e-15 for a, b in itertools.pairwise((0.0, *mixed.g)))
        assert mixed.valid_radius_mm == pytest.approx(15 - 3 * weight)
