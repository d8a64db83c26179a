"""Views that are blurred, repeated or of another lens; stops far from stated."""

from dataclasses import replace

import numpy as np
import pytest
from found_marks import found_marks
from pinhole_shoots import drawn, right_shoot

from lensfit.detect.observations import only
from lensfit.workflow.calibration.observe import Observed
from lensfit.workflow.statements.blur_statements import (
    blurred_views,
    contradicted_f_numbers,
    exchanged_focus_distances,
    stated_blur_px,
    unlikely_blur,
    unlikely_focus_distances,
)
from lensfit.workflow.statements.encoding import impossible_fall_off
from lensfit.workflow.statements.lens_identity import mixed_lenses
from lensfit.workflow.statements.repeated_exposures import without_repeated_exposures


def right(seed: int = 1):
    rng = np.random.default_rng(seed)
    truth = drawn(rng)
    return truth, right_shoot(truth, rng), rng


def with_width(take, diameter_px: float, **changes):
    seen = take.observations
    wide = np.full(len(seen), diameter_px)
    return replace(take, observations=replace(seen, diameter_px=wide), **changes)


def test_views_of_two_lenses_are_told_apart_by_the_size_of_the_image():
    """The other lens, longer by a fifth, photographs the very chart from there."""
    _, takes, _ = right()
    middle = np.array([600.0, 450.0])
    mixed = list(takes[:3])
    for k, take in enumerate(takes[:2]):
        seen = take.observations
        larger = replace(seen, points_px=(seen.points_px - middle) * 1.2 + middle)
        mixed.append(replace(take, name=f"other_{k}.png", observations=larger))
    found = list(mixed_lenses(mixed))
    assert [one.kind for one in found] == ["lens_identity"]
    assert found[0].images == ("other_0.png", "other_1.png")
    assert "20 % larger" in found[0].text
    assert list(mixed_lenses(takes)) == []


def bent(take, k1: float, squeeze: float):
    """The photograph squeezed, with distortion of its own along each axis, and bent by
    a camera's correction, which knows of no axes."""
    seen = take.observations
    half = np.asarray(seen.image_size_px) / 2
    place = (seen.points_px - half) / np.linalg.norm(half)
    place = place * (1 - 0.04 * (place**2) @ [[1, 0], [0.5, 1]])
    place = place / [squeeze, 1] * 1.2
    place = place * (1 + k1 * (place**2).sum(1, keepdims=True))
    points = place * np.linalg.norm(half) + half
    kept = (np.abs(points - half) < half - 4).all(1)
    seen = only(replace(seen, points_px=points), kept)
    return replace(take, observations=seen, squeeze=squeeze)


def test_views_corrected_in_camera_are_told_apart_of_an_anamorphic_lens():
    _, takes, _ = right()
    raw = [replace(takes[0], name=f"raw_{k}.png") for k in range(3)]
    raw = [bent(take, 0.0, 1.3) for take in raw]
    corrected = [replace(bent(takes[0], 0.04, 1.3), name=f"bent_{k}.png") for k in "ab"]
    (found,) = mixed_lenses([*raw, *corrected])
    assert found.kind == "lens_identity"
    assert found.images == ("bent_a.png", "bent_b.png")
    assert "distort the edge of the frame" in found.text
    assert list(mixed_lenses(raw)) == []


def test_a_view_wider_than_its_like_is_blurred():
    _, takes, _ = right()
    sharp = with_width(takes[0], 2.0)
    blurred = with_width(takes[0], 9.0, name="moved.png")
    found = list(blurred_views([sharp, blurred]))
    assert [one.images for one in found] == [("moved.png",)]
    assert list(blurred_views([sharp, with_width(takes[0], 2.4)])) == []
    wide_open = with_width(takes[0], 9.0, f_number=1.4)
    assert list(blurred_views([sharp, wide_open])) == []
    other_focus = with_width(takes[1], 9.0)
    assert list(blurred_views([sharp, other_focus])) == []


@pytest.mark.parametrize(
    ("stated", "found_as"), [(16.0, 11.9), (16.0, 10.4), (11.9, None), (12.5, None)]
)
def test_a_stop_far_from_stated_is_named_with_the_true_one(stated, found_as):
    """Discs of defocus as 1/N, N = 2.8 and 11.9 (or 10.4)."""
    _, takes, _ = right()
    true = found_as or 11.9
    views = []
    for stop, shown in ((2.8, 2.8), (true, stated)):
        for take, disc in ((takes[0], 0.0), (takes[1], 40.0), (takes[2], 36.0)):
            width = np.hypot(2.0, disc / stop)
            views.append(with_width(take, float(width), f_number=shown))
    for view in (0, 3):
        views[view] = replace(
            views[view], target_distance_mm=views[view].focus_distance_mm
        )
    found = list(contradicted_f_numbers(views))
    if found_as is None:
        assert found == []
    else:
        assert found[0].agrees_with == pytest.approx(found_as, rel=0.03)


def with_discs(takes, stops: dict[float, float], moved: str = "") -> list:
    """Views in, near and far at stops stated for true ones; one of them moved."""
    views = []
    for stated, true in stops.items():
        for k, disc in ((0, 0.0), (1, 40.0), (2, 36.0)):
            name = f"{stated:g}_{k}.png"
            width = float(np.hypot(2.0, disc / true)) + 15.0 * (name == moved)
            views.append(with_width(takes[k], width, f_number=stated, name=name))
    in_focus = {"target_distance_mm": takes[0].focus_distance_mm}
    return [replace(view, **in_focus) for view in views]


def test_stops_that_are_exchanged_blur_no_view():
    """Every view out of focus is wider than its like at the other stop."""
    _, takes, _ = right()
    swapped = with_discs(takes, {2.8: 5.6, 5.6: 2.8})
    assert unlikely_blur(swapped) == []
    (found,) = contradicted_f_numbers(swapped)
    assert found.agrees_with == pytest.approx(1.4, rel=0.05)


def test_f_numbers_that_two_views_exchanged_are_named():
    """Near was shot stopped down first; each is blurred by some pixels only, so that
    neither is called blurred."""
    _, takes, _ = right()
    views = []
    for stop in (4.0, 8.0):
        for k in range(3):
            stated = {"target_distance_mm": takes[0].focus_distance_mm}
            view = replace(takes[k], f_number=stop, name=f"{stop:g}_{k}.png", **stated)
            disc = 0.1 * (stated_blur_px(view) or 0.0)
            view = replace(
                view, sensor_size_mm=tuple(10 * np.array(view.sensor_size_mm))
            )
            views.append(with_width(view, float(np.hypot(2.0, disc))))
    assert list(contradicted_f_numbers(views)) == []
    stops = {"4_1.png": 8.0, "8_1.png": 4.0}
    views = [replace(v, f_number=stops.get(v.name, v.f_number)) for v in views]
    (found,) = contradicted_f_numbers(views)
    assert set(found.images) == set(stops)
    assert "are exchanged: the view stated at f/8" in found.text
    # Widened in focus too, as by a tone curve on both of its views: no f-number.
    coded = [
        with_width(view, 4.0) if view.name == "8_0.png" else view for view in views
    ]
    assert list(contradicted_f_numbers(coded)) == []


@pytest.mark.parametrize("moved", ["5.6_0.png", "5.6_1.png"])
def test_a_view_that_moved_is_no_wrong_f_number(moved):
    _, takes, _ = right()
    views = with_discs(takes, {2.8: 2.8, 5.6: 5.6}, moved)
    assert list(contradicted_f_numbers(views)) == []
    (found,) = unlikely_blur(views)
    assert found.images == (moved,)


def test_focus_distances_in_another_order_are_named():
    """What is stated in focus is blurred, and what is stated nearer is sharp."""
    _, takes, _ = right()
    views = with_discs(takes, {2.8: 2.8, 5.6: 5.6})
    assert list(exchanged_focus_distances(views)) == []
    near, inside, far = (takes[k].focus_distance_mm for k in (1, 0, 2))
    order = {inside: near, near: far, far: inside}
    wrong = [
        replace(view, focus_distance_mm=order[view.focus_distance_mm]) for view in views
    ]
    (found,) = exchanged_focus_distances(wrong)
    assert "exchanged: “2.8_0”" in found.text


def test_sharp_dots_far_from_the_stated_focus_are_named():
    """Marks in feet, stated as metres; a few percent are no contradiction."""
    _, takes, _ = right()
    views = with_discs(takes, {2.8: 2.8, 5.6: 5.6})
    for factor, count in ((3.28, 1), (1.05, 0)):
        wrong = [
            replace(view, focus_distance_mm=factor * view.focus_distance_mm)
            for view in views
        ]
        found = list(unlikely_focus_distances(wrong))
        assert len(found) == count, factor


def observed(take, sha256: str = "") -> Observed:
    return Observed(take.name, take.target, {}, take=take, sha256=sha256)


def test_one_exposure_is_counted_once_whatever_its_file():
    _, takes, rng = right()
    first = takes[0]
    copy = replace(first, name="copy.png")

    def exposed(noise_px: float):
        seen = first.observations
        noise = rng.normal(0, noise_px, seen.points_px.shape)
        return found_marks(
            seen.points_px + noise,
            seen.image_size_px,
            deviation_px=0.05,
            lattice=seen.lattice,
        )

    resaved, again = exposed(0.002), exposed(0.07)
    views = [
        observed(first, "a"),
        observed(copy, "a"),
        observed(replace(first, name="resaved.png", observations=resaved), "b"),
        observed(replace(first, name="second.png", observations=again), "c"),
        observed(takes[3], "d"),
    ]
    kept, found = without_repeated_exposures(views)
    assert [one.image for one in kept if one.take is not None] == [
        "view_0.png",
        "second.png",
        "view_3.png",
    ]
    assert found[0].images == ("view_0.png", "copy.png", "resaved.png")


def entry(*curves: tuple[float, float], lit: bool = False) -> dict:
    """Of f-numbers and the stops by which light falls off at 17.5 mm."""
    return {
        "focal_length_mm": 28.0,
        "principal_distance_mm": 28.3,
        "fall_off": [
            {
                "f_number": f_number,
                "radius_mm": [0.0, 17.5],
                "g": [1.0, 2.0**-stops],
                "lighting_too": lit,
            }
            for f_number, stops in curves
        ],
    }


def test_light_that_falls_off_more_than_the_fourth_power_of_the_cosine():
    """At 17.5 mm and 28.3 mm the law allows 0.94 stops."""
    (found,) = impossible_fall_off([entry((2.8, 2.5), (8.0, 1.79))])
    assert found.agrees_with == pytest.approx(2 * np.log2(1 + (17.5 / 28.3) ** 2))
    assert found.stated == pytest.approx(1.79)
    lawful = entry((2.8, 2.5), (8.0, 0.77))
    lit = entry((2.8, 2.5), (8.0, 1.79), lit=True)
    clipped_by_rims = entry((5.6, 1.79), (8.0, 1.7))
    for one in (lawful, lit, clipped_by_rims):
        assert list(impossible_fall_off([one])) == []


def test_defocus_moves_light_and_takes_none_away():
    """Fall-off that changes with focus at a small stop; wide open rims may move."""
    changed = [entry((2.8, 1.5), (5.6, 0.55)), entry((2.8, 1.5), (5.6, 0.2))]
    (found,) = impossible_fall_off(changed)
    assert "by 0.20 stops at one focus distance and by 0.55 at another" in found.text
    vignetted = [entry((2.8, 1.5), (5.6, 0.55)), entry((2.8, 1.1), (5.6, 0.5))]
    assert list(impossible_fall_off(vignetted)) == []
    assert list(impossible_fall_off([entry((5.6, 0.55)), entry((8.0, 0.3))])) == []


def test_light_that_falls_off_less_than_any_pupil_keeps():
    (found,) = impossible_fall_off([entry((2.8, 1.2), (5.6, 0.19))])
    assert "0.19 stops only at f/5.6" in found.text
    assert list(impossible_fall_off([entry((2.8, 0.1), (5.6, 0.5))])) == []
    assert list(impossible_fall_off([entry((5.6, 0.1), lit=True)])) == []
    # The law is no bound for long lenses, nor of very wide ones.
    for principal_mm in (100.0, 14.0):
        lens = entry((5.6, 0.05)) | {"principal_distance_mm": principal_mm}
        assert list(impossible_fall_off([lens])) == []


def test_a_lens_that_distorts_otherwise_at_another_focus_is_one_lens():
    """Two states, each with its own distortion, and no view of both."""
    _, takes, _ = right()
    half = np.array([600.0, 450.0])

    def bent(take, k1: float, name: str, **changes):
        seen = take.observations
        place = (seen.points_px - half) / np.linalg.norm(half)
        r2 = (place**2).sum(1, keepdims=True)
        points = place * (1 + k1 * r2) * np.linalg.norm(half) + half
        seen = replace(seen, points_px=points)
        return replace(take, observations=seen, name=name, **changes)

    near = takes[1].focus_distance_mm
    one_state = [bent(takes[0], 0.0, f"a{k}.png") for k in range(2)]
    other = [bent(takes[0], 0.05, f"b{k}.png") for k in range(2)]
    turned = [replace(take, focus_distance_mm=near) for take in other]
    assert list(mixed_lenses(one_state + turned)) == []
    (found,) = mixed_lenses(one_state + other)
    assert "distort the edge of the frame" in found.text
