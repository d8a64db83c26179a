"""How well a point-spread function is known, from what is not known of its blur."""

from dataclasses import replace
from typing import Any

import msgspec
import numpy as np
import pytest
from preset_makers import make_blur, make_entry, make_preset

from lensfit.errors import LensfitError
from lensfit.lens import Lens
from lensfit.preset.blocks import BlurUncertainty, Pupil
from lensfit.preset.blur_of_block import numbers_of, with_moves
from lensfit.preset.knobs import Knobs
from lensfit.psf.lens_psf import fewer_moves

NAMES = (
    "focus_offset_mm",
    "aberrations[re 3 1 1 1].um",
    "pupil.rims[0].radius[0]",
    "pupil_magnification",
)
MOVES = ((2e-3, 0.05, 0.0, 0.0), (5e-4, -0.2, 1e-3, 5e-3))
POINT = (7.0, 4.0)
PIXELS: dict[str, Any] = {"pixel_pitch_mm": 0.006, "size_px": 40}
FAR_MM = 2300.0


def lens_of(moves=MOVES, names=NAMES, **changes) -> Lens:
    known = None if moves is None else BlurUncertainty(names, moves)
    blur = make_blur(uncertainty=known, **changes)
    return make_preset(make_entry(blur=blur)).at(50.0, 1.4)


def deviation(lens: Lens, **options) -> np.ndarray:
    return np.asarray(
        lens.psf_standard_deviation(POINT, FAR_MM, "g", **(PIXELS | options))
    )


def test_what_is_known_exactly_has_no_deviation():
    assert not deviation(lens_of(())).any()


def test_a_preset_that_does_not_say_is_told_so():
    with pytest.raises(LensfitError, match="how well its blur is known"):
        deviation(lens_of(None))


def test_where_no_light_comes_nothing_is_known_exactly():
    with pytest.raises(LensfitError, match=r"no light to \(70, 4\) mm"):
        lens_of().psf_standard_deviation((70.0, 4.0), FAR_MM, "g", **PIXELS)


def test_deviation_goes_as_the_root_of_the_covariance():
    half = tuple(tuple(0.5 * v for v in move) for move in MOVES)
    whole = 0.5 * deviation(lens_of())
    apart = np.linalg.norm(deviation(lens_of(half)) - whole)
    assert apart < 0.1 * np.linalg.norm(whole)


def test_independent_moves_add_in_squares():
    one, other = (deviation(lens_of((move,))) for move in MOVES)
    np.testing.assert_allclose(
        deviation(lens_of()), np.hypot(one, other), rtol=1e-6, atol=1e-12
    )


def test_deviation_is_the_scatter_of_lenses_drawn_at_random():
    lens, rng, draws = lens_of(), np.random.default_rng(0), 100
    fine: dict[str, Any] = PIXELS | {"tolerance": 0.002}
    found = []
    for _ in range(draws):
        step = rng.normal(size=len(MOVES)) @ np.array(MOVES)
        block = with_moves(make_blur(), dict(zip(NAMES, step, strict=True)))
        drawn = make_preset(make_entry(blur=block)).at(50.0, 1.4)
        found.append(np.asarray(drawn.psf(POINT, FAR_MM, "g", **fine)))
    scatter, stated = np.std(found, 0), deviation(lens, tolerance=0.002)
    apart = np.linalg.norm(scatter - stated) / np.linalg.norm(stated)
    # Of the scatter itself 1 / sqrt(2 draws) is noise; the rest is curvature and rays.
    assert apart < 3 / np.sqrt(2 * draws)
    known = lens.known_psfs(np.array([POINT]), FAR_MM, "g", **fine)
    square = np.mean(np.sum((np.array(found) - known.psf) ** 2, (1, 2)))
    expected = known.relative_error()[0] * np.linalg.norm(known.psf)
    assert np.sqrt(square) == pytest.approx(expected, rel=0.15)


@pytest.mark.parametrize(
    ("name", "least", "most"),
    [("pupil.stop_shift[0]", 0.0, 0.25), ("focus_offset_mm", 0.9, 1.0)],
)
def test_a_shift_is_no_error_of_shape(name: str, least: float, most: float):
    """A stop that is moved out of focus shifts its disc; defocus widens it."""
    lens = lens_of(((0.01,),), (name,), aberrations=(), pupil=Pupil())
    known = lens.known_psfs(np.array([POINT]), FAR_MM, "g", **PIXELS)
    (share,) = known.relative_shape_error() / known.relative_error()
    assert least <= share <= most


def test_a_few_random_errors_stand_for_all_on_average():
    rng = np.random.default_rng(1)
    moves = rng.normal(size=(40, 5)) * [1.0, 2.0, 0.1, 1.0, 5.0]
    exact = moves.T @ moves
    many, few = (fewer_moves(moves, count) for count in (20_000, 12))
    assert few.shape == (12, 5)
    size = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
    np.testing.assert_allclose(many.T @ many / size, exact / size, atol=0.05)
    np.testing.assert_array_equal(few, fewer_moves(moves, 12))
    np.testing.assert_allclose(abs(fewer_moves(moves[:1], 1)), abs(moves[:1]))


def test_kernels_are_expected_to_be_as_wrong_by_a_few_random_errors():
    lens = lens_of()
    for_each, for_few = (
        lens.known_psfs(np.array([POINT]), FAR_MM, "g", **PIXELS, draws=draws)
        for draws in (None, 12)
    )
    np.testing.assert_array_equal(for_few.psf, for_each.psf)
    assert for_few.relative_error() == pytest.approx(for_each.relative_error(), rel=0.3)


def test_a_deviation_wider_than_a_blur_can_be_moved_is_linear_all_the_same():
    """A pupil distance known to four times itself cannot be moved by half of that."""
    distance_mm = make_blur().exit_pupil_distance_mm
    narrow, wide = (
        deviation(lens_of(((share * distance_mm,),), ("exit_pupil_distance_mm",)))
        for share in (0.04, 4.0)
    )
    assert np.linalg.norm(wide) == pytest.approx(100 * np.linalg.norm(narrow), rel=0.1)


def test_light_of_a_disc_thins_out_as_it_widens():
    """Inside, light goes as the inverse square of the defocus."""
    offset_mm, spread_mm = 0.2, 1e-3
    lens = lens_of(
        ((spread_mm,),),
        ("focus_offset_mm",),
        aberrations=(),
        pupil=Pupil(),
        focus_offset_mm=offset_mm,
        chief_bend=0.0,
    )
    known = lens.known_psfs(np.array([(0.1, -0.2)]), 2000.0, "g", **PIXELS)
    middle = slice(17, 23)
    psf, spread = (a[0, middle, middle] for a in known[:2])
    np.testing.assert_allclose(spread / psf, 2 * spread_mm / offset_mm, rtol=0.05)


def test_where_all_light_stays_what_pixels_gain_others_lose():
    block = make_blur()
    forth, back = (
        np.asarray(
            make_preset(
                make_entry(blur=with_moves(block, dict(zip(NAMES, step, strict=True))))
            )
            .at(50.0, 1.4)
            .psf(POINT, FAR_MM, "g", **PIXELS)
        )
        for step in (MOVES[0], [-v for v in MOVES[0]])
    )
    change = forth - back
    known = deviation(lens_of((MOVES[0],)))
    assert abs(change.sum()) < 1e-5 * np.abs(change).sum()
    apart = np.abs(change) / 2 - known
    assert np.linalg.norm(apart) < 0.2 * np.linalg.norm(known)


def test_a_knob_that_takes_all_aberrations_off_takes_their_doubt_off():
    names = ("aberrations[re 3 1 1 1].um",)
    blur = make_blur(uncertainty=BlurUncertainty(names, ((0.5,),)))
    preset = make_preset(make_entry(blur=blur))
    knobs = Knobs()
    turned = msgspec.structs.replace(
        knobs, aberration=msgspec.structs.replace(knobs.aberration, coma_gain=0.0)
    )
    assert deviation(preset.at(50.0, 1.4)).max() > 1e-5
    assert deviation(preset.at(50.0, 1.4, knobs=turned)).max() < 1e-9


def test_every_number_has_a_name_and_moves_alone():
    blur = make_blur()
    numbers = numbers_of(blur)
    assert "stops[f/1.4].radius_ratio" in numbers
    for name in NAMES:
        moved = numbers_of(with_moves(blur, {name: 1e-3}))
        changed = {n for n, v in moved.items() if v != numbers[n]}
        assert changed == {name}
    assert with_moves(blur, {"no such": 1.0}) == blur


def test_a_number_that_may_not_be_negative_is_not_made_so():
    with pytest.raises(ValueError, match="no blur can be so"):
        with_moves(make_blur(), {"pupil_magnification": -5.0})


def test_terms_are_found_wherever_they_stand():
    blur = make_blur()
    turned = msgspec.structs.replace(blur, aberrations=blur.aberrations[::-1])
    name = "aberrations[re 4 0 0 0].um"
    assert with_moves(turned, {name: 1.0}).aberrations[0].um == 4.0


def test_a_lens_can_be_copied_with_its_doubt():
    lens = lens_of()
    copy = replace(lens, notes=("a note",))
    np.testing.assert_array_equal(deviation(copy), deviation(lens))
