"""What stands before a light, and before a surface, along each ray: closed forms."""

from pathlib import Path

import numpy as np
import pytest
from ideal_lens import HEIGHT, WIDTH, depth_of, depth_plane, ideal_lens
from scipy.special import j1

import lensfit
from lensfit.coords import Window
from lensfit.rendering.frame import render
from lensfit.rendering.layer_stack import LayerStack
from lensfit.rendering.render_stages import Switches
from lensfit.rendering.uv import PlateGeometry

LENS = ideal_lens()
PRIME = Path(__file__).parents[2] / "presets" / "prime_50" / "preset.json"
ROW, COLUMN, POWER = 70, 100, 400.0


def layer(columns, colour=0.0):
    """An opaque layer over some columns."""
    rgba = np.zeros((HEIGHT, WIDTH, 4), np.float32)
    rgba[:, columns] = (colour, colour, colour, 1)
    return rgba


def light_behind(front, front_px, light_px=-9.0):
    """A light on black behind a layer, each at its own distance."""
    back = layer(slice(None))
    back[ROW, COLUMN, :3] = POWER
    depth = np.stack([depth_plane(front_px), depth_plane(light_px)])
    return render(LayerStack(np.stack([front, back]), depth), None, LENS)[..., 1]


def test_a_column_in_focus_cuts_half_a_disc():
    """Its edge runs through the light's middle: pixels are seen up to the edge."""
    found = light_behind(layer(slice(0, COLUMN)), 0.0)
    assert found[:, : COLUMN - 1].sum() < 1e-3 * POWER
    assert found.sum() == pytest.approx(POWER * (0.5 + 0.5 / (9 * np.pi / 2)), rel=0.02)


def test_a_light_hidden_in_the_pinhole_plate_shows_beside_what_hides_it():
    narrow = layer(slice(COLUMN - 2, COLUMN + 3))
    found = light_behind(narrow, 0.0)
    assert found[ROW, COLUMN] < 1e-3 * POWER / 250
    assert found.sum() > 0.5 * POWER


@pytest.mark.parametrize("near_px", [0.0, 4.5, 9.0])
def test_a_wire_draws_its_line_where_similar_triangles_put_it(near_px: float):
    wire = COLUMN + 4
    found = light_behind(layer(slice(wire, wire + 1)), near_px)
    # A ray at s of the pupil lands at x + 9 s and crosses the wire's plane at
    # x + (9 + near) s: shadows are the nearer to the middle the nearer the wire.
    share = 9.0 / (9.0 + near_px)
    expected = COLUMN + 0.5 + (wire - COLUMN) * share
    rows = found[ROW - 4 : ROW + 5].sum(0)
    inside = np.arange(COLUMN - 2, COLUMN + 8)
    lost = rows[COLUMN - 4] - rows[inside]
    assert (lost * (inside + 0.5)).sum() / lost.sum() == pytest.approx(
        expected, abs=0.35
    )
    assert lost.sum() == pytest.approx(share * rows[COLUMN - 4], rel=0.2)


@pytest.mark.slow
def test_a_light_is_the_point_spread_function_of_a_fitted_lens():
    width, height, half = 240, 180, 20
    lens = lensfit.load_preset(PRIME).at(
        focal_length_mm=50.0, f_number=2.0, focus_distance_mm=2000.0
    )
    geometry = PlateGeometry.of(lens, Window.of_size(width, height))
    picture = np.full((height, width, 3), 1e-6, np.float32)
    x, y = 170, 60
    picture[y, x] = POWER
    for distance_mm in (1200.0, 5000.0):
        depth = np.full((height, width), distance_mm, np.float32)
        depth -= np.float32(lens.entrance_pupil_offset_mm)
        switches = Switches(False, False, False)
        found = render(picture, depth, lens, switches=switches) / POWER
        kernels = lens.psfs(
            geometry.mm(np.array([[x + 0.5, y + 0.5]])),
            distance_mm,
            pixel_pitch_mm=geometry.pitch_mm[0],
            size_px=2 * half + 1,
            with_lateral_colour=False,
        )[0]
        patch = found[y - half : y + half + 1, x - half : x + half + 1]
        away = np.moveaxis(patch, -1, 0) - np.asarray(kernels)
        size = np.linalg.norm(np.asarray(kernels), axis=(1, 2))
        assert (np.linalg.norm(away, axis=(1, 2)) / size).max() < 0.06


def test_a_leaf_hides_what_the_same_ray_would_have_met():
    """Leaf and wall on both sides of the focus, by many rays, nearest first."""
    near_px, far_px = 7.0, -6.0
    picture = np.empty((HEIGHT, WIDTH, 3), np.float32)
    picture[:, :COLUMN], picture[:, COLUMN:] = (0.8, 0.2, 0.1), (0.1, 0.3, 0.6)
    depth = depth_plane(far_px)
    depth[:, :COLUMN] = depth_of(near_px)
    found = render(picture, depth, LENS)
    u = np.stack(np.meshgrid(*2 * [np.linspace(-1, 1, 161)]), -1).reshape(-1, 2)
    u = u[(u**2).sum(-1) <= 1]
    x = np.arange(WIDTH) + 0.5
    cover = ((x[:, None] + near_px * u[:, 0]) < COLUMN).mean(1)[None, :, None]
    expected = cover * picture[0, 0] + (1 - cover) * picture[0, -1]
    assert np.abs(found[40:100] - expected).max() < 0.02


def test_a_floor_is_one_surface_without_bands():
    """Its distance runs through the focus; what it shows is one smooth slope."""
    ramp = np.linspace(-9, 12, HEIGHT, dtype=np.float32)[:, None]
    depth = np.repeat(depth_of(ramp).astype(np.float32), WIDTH, 1)
    slope = np.repeat(
        np.linspace(0.2, 0.8, HEIGHT, dtype=np.float32)[:, None], WIDTH, 1
    )
    picture = np.repeat(slope[..., None], 3, -1)
    found = render(picture, depth, LENS)[16:-16, 20:-20, 1]
    steps = np.diff(found.mean(1))
    assert np.abs(steps - steps.mean()).max() < 0.15 * steps.mean()


def test_what_a_wire_hides_is_a_blend_of_both_of_its_sides():
    """A thin defocused wire before checks in focus: they show through, unbroken."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    checks = np.where((x // 12 + y // 12) % 2, 0.7, 0.2).astype(np.float32)
    picture = np.repeat(checks[..., None], 3, -1)
    depth = depth_plane(0.0)
    plain = picture.copy()
    picture[:, 99:102], depth[:, 99:102] = 0.05, depth_of(10.0)
    found = render(picture, depth, LENS)
    chord = 2 * (1.5 * np.sqrt(100 - 1.5**2) + 100 * np.arcsin(0.15)) / (np.pi * 100)
    expected = 0.05 * chord + plain * (1 - chord)
    beside = np.s_[30:110, 93:98]
    assert np.abs(found[beside] - expected[beside]).mean() < 0.02
    middle = np.s_[30:110, 99:102]
    assert np.abs(found[middle] - expected[middle]).mean() < 0.06


def test_a_wide_disc_of_a_light_is_even():
    """No texture of rays inside, whatever their number."""
    picture = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    picture[ROW, COLUMN] = POWER
    for tolerance in (1e-3, 1e-2):
        found = render(picture, depth_plane(30.0), LENS, tolerance=tolerance)[..., 1]
        y, x = np.mgrid[:HEIGHT, :WIDTH]
        inside = np.hypot(y - ROW, x - COLUMN) < 27
        even = POWER / (np.pi * 30.0**2)
        assert np.abs(found[inside] - even).max() < 0.03 * even


@pytest.mark.parametrize("owner_px", [0.0, -8.0])
def test_an_outline_in_focus_keeps_its_mixed_pixels_and_no_sharp_ones_behind(owner_px):
    """A third of each pixel of the outline is the front; waves along it lie behind, and
    fade as those that a disc averages."""
    edge, far_px, period_px = WIDTH // 2, -8.0, 9.0
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    waves = np.sin(2 * np.pi * (y + 0.5) / period_px)
    cover = np.where(x < edge, 1.0, np.where(x == edge, 1 / 3, 0.0))
    seen = 0.9 * cover + (0.3 + 0.2 * waves) * (1 - cover)
    depth = np.where(cover > 0.5, depth_of(0.0), depth_of(far_px)).astype(np.float32)
    depth[:, edge] = depth_of(owner_px)
    picture = np.repeat(seen.astype(np.float32)[..., None], 3, -1)
    part = np.s_[30:110, edge - 1 : edge + 2]
    found = render(picture, depth, LENS)[part][..., 1]
    q = 2 * np.pi * far_px / period_px
    faded = 0.3 + 0.2 * waves * 2 * j1(q) / q
    expected = (0.9 * cover + faded * (1 - cover))[part]
    assert np.abs(found - expected).max() < 0.05
    assert np.abs(found.mean(0) - expected.mean(0)).max() < 0.02


def test_no_colour_of_a_near_thing_is_continued_behind_it():
    """A green leaf before a red thing before a wall: green is the leaf's alone."""
    leaf_px, thing_px, wall_px = 8.0, 3.0, -6.0
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    leaf = np.hypot(y - 70, x - 100) < 14
    thing = (x > 60) & (x < 110) & (y > 30) & (y < 80)
    picture = np.full((HEIGHT, WIDTH, 3), (0.0, 0.0, 0.5), np.float32)
    picture[thing], picture[leaf] = (0.6, 0.0, 0.0), (0.0, 0.7, 0.0)
    radius = np.where(leaf, leaf_px, np.where(thing, thing_px, wall_px))
    found = render(picture, depth_of(radius).astype(np.float32), LENS)
    own = render(
        LayerStack(
            np.concatenate([picture * leaf[..., None], leaf[..., None]], -1)[None]
            .astype(np.float32),
            depth_plane(leaf_px)[None],
        ),
        None,
        LENS,
    )  # fmt: skip
    assert np.abs(found[..., 1] - own[..., 1]).max() < 0.01


def test_a_wire_that_ends_leaves_nothing_beyond_its_end():
    picture = np.full((HEIGHT, WIDTH, 3), 0.6, np.float32)
    depth = depth_plane(-5.0)
    picture[:ROW, 99:102], depth[:ROW, 99:102] = 0.05, depth_of(8.0)
    found = render(picture, depth, LENS)[..., 1]
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    beyond = np.hypot(np.maximum(y - ROW, 0), np.maximum(np.abs(x - 100) - 1, 0)) > 10
    assert np.abs(found[beyond & (y >= ROW)] - 0.6).max() < 3e-3
    assert (found < 0.6 + 3e-3).all()


def test_a_thin_bright_thing_before_nothing_is_no_light():
    """A wire alone in its layer covers, and shows its own colour where it blurs."""
    wire, wall = layer(slice(99, 101), 0.7), layer(slice(None), 0.2)
    wire[:ROW, :, :] = 0.0
    depth = np.stack([depth_plane(8.0), depth_plane(-5.0)])
    found = render(
        LayerStack(np.stack([wire, wall]), depth), None, LENS, tolerance=1e-3
    )[..., 1]
    chord = 2 * (1.0 * np.sqrt(64 - 1) + 64 * np.arcsin(1 / 8)) / (np.pi * 64)
    expected = 0.7 * chord + 0.2 * (1 - chord)
    assert found[ROW + 30, 99:101] == pytest.approx(expected, abs=5e-3)
    assert found[ROW - 30].max() == pytest.approx(0.2, abs=1e-3)
