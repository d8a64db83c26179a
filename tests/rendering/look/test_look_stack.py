"""Looks on a plate: neutral is nothing, one knob is one change, borders and sizes."""

import cv2
import numpy as np
import pytest
from look_makers import (
    FOCUS_MM,
    FRAME,
    HEIGHT,
    WIDTH,
    depth_plane,
    grey,
    ideal_lens,
    looked,
    noise,
    with_light,
)

from lensfit.coords import Window
from lensfit.preset.knob_groups import LookKnobs
from lensfit.rendering.frame import render, render_stages
from lensfit.rendering.layer_stack import LayerStack
from lensfit.rendering.look.stack import EFFECTS, light_spreads, look_of
from lensfit.rendering.render_plan import plan_of
from lensfit.rendering.render_stages import prepare_stages
from lensfit.rendering.uv import PlateGeometry

ON = {
    "pro-mist": {"pro_mist_gain": 0.3},
    "diffusion": {"diffusion_gain": 0.3},
    "ghosting": {"ghost_gain": 0.3, "ghost_threshold": 2.0},
    "glint": {"glint_gain": 0.3, "glint_threshold": 2.0},
    "bloom": {"bloom_gain": 0.3},
    "white balance": {"white_balance_kelvin": 4000.0},
}
ALL = {name: value for knobs in ON.values() for name, value in knobs.items()}
SECOND = {
    "bloom_threshold": 2.0,
    "bloom_size_percent": 3.0,
    "glint_threshold": 9.0,
    "glint_streaks": 4,
    "glint_length_percent": 20.0,
    "glint_rotation_deg": 15.0,
    "glint_dispersion": 0.0,
    "pro_mist_size_percent": 6.0,
    "diffusion_size_percent": 1.0,
    "ghost_threshold": 9.0,
    "ghost_count": 1,
    "ghost_reach": 0.5,
    "ghost_size_percent": 20.0,
    "ghost_tint": 0.5,
    "white_balance_tint": 20.0,
}
EACH = pytest.mark.parametrize("effect", EFFECTS)


def lights():
    """A dim picture with coloured lights."""
    picture = noise(3, 0.0, 0.3)
    for row, column, colour in [(40, 50, (90, 60, 30)), (100, 180, (20, 60, 90))]:
        picture[row : row + 3, column : column + 3] = colour
    return picture


def stages_of(knobs, window=FRAME):
    return prepare_stages(ideal_lens(), FRAME, window, look=LookKnobs(**knobs))


def test_neutral_looks_are_no_stage_and_change_no_bit():
    picture = np.concatenate([noise(), np.ones((HEIGHT, WIDTH, 1), np.float32)], -1)
    assert looked(picture).tobytes() == picture.tobytes()
    assert stages_of({}).look is None
    # All else of an effect may be set while its gain is 0.
    assert (
        stages_of({k: v for k, v in SECOND.items() if "balance" not in k}).look is None
    )
    assert not light_spreads(LookKnobs(white_balance_kelvin=3000.0))


@EACH
def test_only_what_is_turned_is_run_and_planned(effect):
    stages = stages_of(ON[effect])
    assert stages.look is not None
    assert stages.look.runs == (effect,)
    plan = plan_of(stages, FRAME, 1e-3)
    added = [s for s in plan.stages if s.stage in EFFECTS]
    assert [s.stage for s in added] == [effect]
    assert added[0].runs
    assert added[0].seconds > 0
    plain = plan_of(stages_of({}), FRAME, 1e-3)
    assert not {s.stage for s in plain.stages} & set(EFFECTS)


@EACH
def test_each_effect_changes_the_picture_and_not_its_coverage(effect):
    rgba = np.concatenate([lights(), noise(5, 0, 1)[..., :1]], -1)
    made = looked(rgba, **ON[effect])
    assert np.abs(made - rgba)[..., :3].max() > 0.01
    assert made[..., 3].tobytes() == rgba[..., 3].tobytes()


def effect_of(name):
    """The effect that a knob belongs to."""
    words = {"ghost": "ghosting", "pro": "pro-mist", "white": "white balance"}
    first = name.split("_")[0]
    return words.get(first, first)


@pytest.mark.parametrize("name", SECOND)
def test_two_presets_that_differ_by_a_knob_differ_by_that_alone(name):
    effect, turn = effect_of(name), {name: SECOND[name]}
    one, two = (looked(lights(), **{**ON[effect], **more}) for more in ({}, turn))
    assert np.abs(two - one).max() > 1e-3
    if effect == "white balance":
        return
    # With the effect off the knob does nothing at all.
    other = "diffusion" if effect != "diffusion" else "pro-mist"
    one, two = (looked(lights(), **{**ON[other], **more}) for more in ({}, turn))
    assert one.tobytes() == two.tobytes()


@EACH
def test_energy_is_kept_but_for_what_is_said(effect):
    picture = lights()
    made = looked(picture, **ON[effect])
    if effect == "ghosting":
        assert made.sum() > picture.sum()
    elif effect != "white balance":
        assert made.sum((0, 1)) == pytest.approx(picture.sum((0, 1)), rel=1e-3)


@EACH
def test_a_proxy_looks_like_the_plate(effect):
    rng = np.random.default_rng(8)
    large = cv2.GaussianBlur(
        rng.uniform(0, 1, (640, 960, 3)).astype(np.float32), (0, 0), 8
    )
    large = np.clip(8 * (large - 0.5) + 0.3, 0, None)
    y, x = np.indices(large.shape[:2])
    for row, column in ((100, 300), (420, 700), (300, 480)):
        large += 30 * np.exp(-((y - row) ** 2 + (x - column) ** 2) / 200)[..., None]
    large = large.astype(np.float32)
    half = (480, 320)
    small = cv2.resize(large, half, interpolation=cv2.INTER_AREA)
    lenses = ideal_lens(960, 640), ideal_lens(480, 320)
    full, proxy = (
        looked(p, lens=lens, **ON[effect]) - p
        for p, lens in zip((large, small), lenses, strict=True)
    )
    brought = cv2.resize(full, half, interpolation=cv2.INTER_AREA)
    # Ghosts have edges, which a proxy shows a pixel softer.
    error = 0.07 if effect == "ghosting" else 0.03
    assert np.linalg.norm(proxy - brought) < error * np.linalg.norm(brought)


@EACH
def test_light_from_the_overscan_counts_whether_it_is_kept_or_not(effect):
    wide = FRAME.grown(24, 16)
    picture = np.full((wide.height, wide.width, 3), 0.1, np.float32)
    picture[60:64, 10:14] = 80  # beside the frame
    windows = {"data_window": wide, "display_window": FRAME}
    knobs = {**ON[effect], "diffusion_size_percent": 5.0}
    kept = looked(picture, windows={**windows, "keep_overscan": True}, **knobs)
    shown = looked(picture, windows=windows, **knobs)
    assert shown.shape == (HEIGHT, WIDTH, 3)
    assert kept[16:-16, 24:-24] == pytest.approx(shown, rel=1e-6)
    if light_spreads(LookKnobs(**knobs)):
        assert np.ptp(shown) > 1e-3


def test_the_overscan_counts_with_depth_too():
    wide = FRAME.grown(24, 16)
    picture = np.full((wide.height, wide.width, 3), 0.1, np.float32)
    picture[60:64, 10:14] = 80
    depth = np.full(picture.shape[:2], 900.0, np.float32)
    windows = {"data_window": wide, "display_window": FRAME}
    kept = looked(picture, depth, windows={**windows, "keep_overscan": True}, **ALL)
    shown = looked(picture, depth, windows=windows, **ALL)
    assert kept[16:-16, 24:-24] == pytest.approx(shown, abs=1e-3)


@EACH
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_broken_pixel_stays_alone(effect, bad):
    picture = lights()
    whole = looked(picture, **ON[effect])
    picture[120, 30] = bad
    made = looked(picture, **ON[effect])
    assert not np.isfinite(made[120, 30]).any()
    broken = ~np.isfinite(made).all(-1)
    assert broken.sum() == 1
    assert made[~broken] == pytest.approx(whole[~broken], abs=0.1)


def test_negative_values_stay():
    picture = grey(0.2)
    picture[10, 10] = -0.5
    for effect in ("bloom", "glint", "ghosting"):
        assert looked(picture, **ON[effect]).tobytes() == picture.tobytes()
    misted = looked(picture, pro_mist_gain=0.5)
    assert misted[10, 10] == pytest.approx(-0.5 + 0.1, abs=5e-3)


def test_the_balance_comes_last_and_moves_no_threshold():
    knobs = {"bloom_gain": 0.4, "glint_gain": 0.3}
    first = looked(lights(), **knobs)
    balance = {"white_balance_kelvin": 4000.0}
    both = looked(lights(), **knobs, **balance)
    assert both == pytest.approx(looked(first, **balance), rel=1e-5, abs=1e-6)


def test_the_primaries_of_the_plate_count():
    acescg = (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767)
    look = LookKnobs(white_balance_kelvin=4000.0)
    made = [
        render(lights(), None, ideal_lens(), look=look, chromaticities=c)
        for c in (None, acescg)
    ]
    assert np.abs(made[0] - made[1]).max() > 1e-2


def test_a_grey_plate_has_looks_too():
    one = lights()[..., :1]
    for effect in ("pro-mist", "bloom", "ghosting"):
        stages = stages_of(ON[effect])
        made = render_stages(one, FRAME, stages, FRAME)
        in_depth = render_stages(one, FRAME, stages, FRAME, depth_mm=depth_plane())
        assert made.shape == one.shape
        assert np.abs(made - one).max() > 0.01
        assert in_depth == pytest.approx(made, abs=1e-4)


def test_a_deep_plate_looks_like_the_flat_one():
    colour = lights()
    rgba = np.concatenate([colour, np.ones((HEIGHT, WIDTH, 1), np.float32)], -1)
    empty = np.zeros_like(rgba)
    depth = np.stack([depth_plane(1500.0), depth_plane(FOCUS_MM)])
    stack = LayerStack(np.stack([empty, rgba]), depth)
    deep = looked(stack, **ALL)
    flat = looked(rgba, depth_plane(), **ALL)
    assert deep == pytest.approx(flat, rel=1e-3, abs=1e-3)


def test_ghosts_of_a_hidden_light_are_not_seen():
    rgba = np.zeros((2, HEIGHT, WIDTH, 4), np.float32)
    rgba[0, 40:60, 40:60] = (0.1, 0.1, 0.1, 1)
    rgba[1] = np.concatenate([with_light(50, 50), np.ones((HEIGHT, WIDTH, 1))], -1)
    depth = np.stack([depth_plane(1500.0), depth_plane(FOCUS_MM)])
    geometry = PlateGeometry.of(ideal_lens(), FRAME)
    look = look_of(LookKnobs(ghost_gain=1.0), ideal_lens(), geometry, 1e-3)
    assert look is not None
    made = looked(LayerStack(rgba, depth), ghost_gain=1.0)
    ghost = made[HEIGHT - 60 : HEIGHT - 40, WIDTH - 60 : WIDTH - 40, :3]
    assert ghost.max() < 1e-4


def test_a_window_far_from_the_origin_is_the_same_picture():
    moved = Window(1000, -300, 1000 + WIDTH - 1, -300 + HEIGHT - 1)
    windows = {"data_window": moved, "display_window": moved}
    here, there = looked(lights(), **ALL), looked(lights(), windows=windows, **ALL)
    assert there == pytest.approx(here, abs=2e-3)
