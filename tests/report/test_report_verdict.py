"""The verdict: each rule speaks when its evidence is there, and only then."""

import copy

import numpy as np
import pytest
from report_samples import barrel_report, failed_take

from lensfit.report.evidence import (
    Residuals,
    cell_counts,
    empty_places,
    pattern_px,
    photographed_corner_px,
)
from lensfit.report.verdict import findings, verdict, verdict_of, verdict_scope

SIZE_PX = (2000.0, 1500.0)


@pytest.fixture
def report() -> dict:
    return barrel_report()


def said(report: dict, words: str) -> bool:
    return any(words in sentence for sentence in verdict(report))


@pytest.mark.parametrize(
    ("held_out_px", "opening", "tone"),
    [
        (0.05, "Ready for measurement", "good"),
        (0.3, "Ready for match-moving", "good"),
        (1.0, "Good enough for soft", "caution"),
        (3.0, "Not usable yet", "bad"),
    ],
)
def test_grade_follows_the_held_out_error(report, held_out_px, opening, tone):
    report["held_out_rms_px"] = held_out_px
    first = findings(report)[0]
    assert first.sentence.startswith(opening)
    assert first.tone == tone


def test_a_small_residual_does_not_hide_uncertain_corners(report):
    """Held-out error is 0.09 px, but the corners are known to 2 px only."""
    for row in report["entries"][0]["uncertainty_grid"]["sd_px"][:2]:
        row[:2] = [2.0, 2.0]
    assert findings(report)[0].tone == "bad"
    assert "in its worst corner the map is known to" in findings(report)[0].sentence
    assert said(report, "In the corners at 50\u202fmm the map is known to 2.0\u202fpx")
    assert said(report, "shoot the chart in the corners")


@pytest.mark.parametrize(
    ("deviation_px", "level", "accuracy_px"),
    [(0.25, "measurement", 0.25), (0.35, "match-moving", 0.35)],
)
def test_objects_that_a_turn_of_the_camera_would_put_right_are_not_known(
    report, deviation_px, level, accuracy_px
):
    """The map is known to 0.05 px after the best turn, objects are not without. Both
    lines always name that; it counts for the level where most errors of that size
    show."""
    report["held_out_rms_px"] = 0.05
    entry = report["entries"][0]
    assert verdict_of(report).level == "measurement"
    grid = entry["uncertainty_grid"]
    turned = {**grid, "sd_px": np.full(np.shape(grid["sd_px"]), deviation_px).tolist()}
    entry["object_uncertainty_grid"] = turned
    judged = verdict_of(report)
    assert judged.level == level
    assert judged.accuracy_px == pytest.approx(accuracy_px, abs=0.01)
    known = f"objects in its corners are known to {deviation_px}\u202fpx."
    assert known in judged.headline
    assert f"; to {deviation_px}\u202fpx at worst; " in verdict_scope(judged)
    entry["object_uncertainty_grid"] = None
    assert verdict_of(report).level == "measurement"


def test_a_map_known_less_well_than_its_objects_is_called_the_map(report):
    """One figure in both lines, and of what it is."""
    report["held_out_rms_px"] = 0.05
    grid = report["entries"][0]["uncertainty_grid"]
    grid["sd_px"] = np.full(np.shape(grid["sd_px"]), 0.2).tolist()
    judged = verdict_of(report)
    assert "the map in its corners is known to 0.20\u202fpx." in judged.headline
    assert "; to 0.20\u202fpx at worst; " in verdict_scope(judged)


def test_what_no_view_could_check_is_not_green(report):
    """The level is that of the figures, and the headline has what it rests on."""
    report["terms"] = [
        {"name": "principal_distance", "kept": False, "focal_length_mm": 50.0}
    ]
    judged = verdict_of(report)
    assert judged.level == "undistortion"
    assert judged.reasons[0].tone == "caution"
    assert "target_distance_mm are right, which these views cannot" in judged.headline


def test_objects_known_less_well_than_a_bad_corner_stand_beside_it(report):
    grid = report["entries"][0]["uncertainty_grid"]
    grid["sd_px"][0][0] = 0.6
    worse = {**grid, "sd_px": np.full(np.shape(grid["sd_px"]), 0.8).tolist()}
    report["entries"][0]["object_uncertainty_grid"] = worse
    judged = verdict_of(report)
    assert judged.level == "look"
    assert judged.accuracy_px == 0.8
    corner = photographed_corner_px(report, report["entries"][0])
    known = f"the map is known to {corner:.2f}\u202fpx, objects to 0.80\u202fpx only."
    assert known in judged.headline


def test_a_corner_counts_as_far_as_points_reach(report):
    """From the last point to the very corner the map is extrapolated."""
    grid = report["entries"][0]["uncertainty_grid"]
    grid["sd_px"][0][0] = 2.0
    camera = report["camera"]
    x_px = (grid["x_mm"][1] / camera["sensor_width_mm"] + 0.5) * 2000
    y_px = (grid["y_mm"][1] / camera["sensor_height_mm"] + 0.5) * 1500
    assert (camera["image_width_px"], camera["image_height_px"]) == (2000, 1500)
    for take in report["takes"]:
        lists = take["residuals"]
        kept = [
            i
            for i, (x, y) in enumerate(zip(lists["x_px"], lists["y_px"], strict=True))
            if x >= x_px and y >= y_px
        ]
        take["residuals"] = {k: [v[i] for i in kept] for k, v in lists.items()}
    corner = photographed_corner_px(report, report["entries"][0])
    assert corner < 0.3
    grid["sd_px"][1][1] = 1.2
    assert photographed_corner_px(report, report["entries"][0]) > 1.0


def test_sound_calibration_draws_no_complaint(report):
    tones = {finding.tone for finding in findings(report)}
    assert tones <= {"good"}
    assert said(report, "reach all of the frame")


def test_a_fold_outweighs_any_error(report):
    report["entries"][0]["monotone"] = False
    assert findings(report)[0].tone == "bad"
    assert said(report, "folds")


def test_fit_that_never_held_points_out_says_so(report):
    report["held_out_rms_px"] = None
    assert said(report, "none were held out")


def test_points_in_one_half_name_the_other(report):
    for take in report["takes"]:
        lists = take["residuals"]
        kept = [i for i, x in enumerate(lists["x_px"]) if x < 1000]
        take["residuals"] = {k: [v[i] for i in kept] for k, v in lists.items()}
    assert said(report, "with gaps at the right side.")
    assert not said(report, "reach all of the frame")


def test_coverage_is_judged_for_each_focal_length(report):
    """A zoom: the long end has points at its left only, the wide end everywhere."""
    take = report["takes"][0]
    take["focal_length_mm"] = 85.0
    lists = take["residuals"]
    kept = [i for i, x in enumerate(lists["x_px"]) if x < 600]
    take["residuals"] = {k: [v[i] for i in kept] for k, v in lists.items()}
    assert said(report, "of the frame at 85\u202fmm")
    assert not said(report, "of the frame at 50\u202fmm")


def test_failed_takes_are_named_with_their_reason(report):
    report["takes"].append(failed_take("tilt", "no dots found."))
    assert said(report, "“tilt” was left out: no dots found.")


def test_no_usable_take_is_no_calibration(report):
    report["takes"] = [failed_take("a", "empty"), failed_take("b", "empty")]
    assert findings(report)[0].sentence.startswith("No photograph could be used")


def test_few_takes_and_unmeasured_focal_length_ask_for_tilted_ones():
    report = barrel_report(takes=1)
    assert said(report, "Only 1 take at 50\u202fmm")
    report["terms"][1]["kept"] = False
    assert said(report, "The focal length is the stated one")


@pytest.mark.parametrize("held_out_px", [0.02, 0.3])
def test_a_focal_length_that_is_only_stated_promises_no_measurement(
    report, held_out_px
):
    report["held_out_rms_px"] = held_out_px
    report["terms"][1]["kept"] = False
    first = findings(report)[0].sentence
    assert first.startswith("Good for undistortion, and for CG only if")
    assert "measurement" not in first
    assert "match-moving" not in first


def test_of_a_zoom_the_focal_length_that_was_not_measured_is_named():
    report = barrel_report(takes=6)
    distance = report["terms"][1]
    for take in report["takes"][:3]:
        take["focal_length_mm"] = 85.0
    distance["focal_length_mm"] = 50.0
    report["terms"].append(distance | {"focal_length_mm": 85.0, "kept": False})
    assert said(report, "The focal length at 85\u202fmm is the stated one")
    assert findings(report)[0].sentence.startswith("Good for undistortion")


PITCH = {
    "kind": "pitch",
    "limit": "undistortion",
    "text": "pitch_mm of target “dots” is stated as 60.5 mm, but the photographs agree "
    "with 55.06 mm",
    "remedy": "check it in the shoot file",
}


def test_a_contradiction_is_the_headline_and_nothing_is_green(report):
    report["contradictions"] = [PITCH, PITCH | {"kind": "f_number", "text": "f/16"}]
    judged = verdict_of(report)
    assert judged.level == "undistortion"
    assert judged.headline.startswith("Good for undistortion at most: pitch_mm of")
    assert judged.reasons[0].kind == "pitch"
    assert judged.reasons[0].remedy == PITCH["remedy"]
    assert judged.reasons[1].kind == "f_number"
    assert {one.tone for one in judged.reasons} <= {"caution", "note"}
    assert [one.text for one in judged.reasons] == verdict(report)


@pytest.mark.parametrize(
    ("limit", "level"),
    [("match-moving", "match-moving"), ("look", "look"), ("unusable", "unusable")],
)
def test_a_contradiction_lowers_the_level_but_never_raises_it(report, limit, level):
    report["contradictions"] = [PITCH | {"limit": limit}]
    assert verdict_of(report).level == level
    report["held_out_rms_px"] = 9.0
    assert verdict_of(report).level == "unusable"


def test_every_level_follows_from_its_figures(report):
    assert verdict_of(report).level == "measurement"
    for error, level in ((0.3, "match-moving"), (1.0, "look"), (3.0, "unusable")):
        report["held_out_rms_px"] = error
        judged = verdict_of(report)
        assert judged.level == level
        assert judged.accuracy_px == error
    assert judged.used_for == "nothing yet"


def test_an_extrapolated_corner_condemns_no_lens(report):
    """The deviation there is told, and the level is that of the photographed part."""
    report["entries"][0]["uncertainty_grid"]["sd_px"][0][0] = 2.0
    for take in report["takes"]:
        lists = take["residuals"]
        kept = [
            i
            for i, (x, y) in enumerate(zip(lists["x_px"], lists["y_px"], strict=True))
            if x > 500 or y > 500
        ]
        take["residuals"] = {k: [v[i] for i in kept] for k, v in lists.items()}
    judged = verdict_of(report)
    assert judged.level == "measurement"
    assert judged.extrapolated == ("top left",)
    (corner,) = [one for one in judged.reasons if one.kind == "extrapolation"]
    assert "2.0\u202fpx" in corner.text
    assert corner.tone == "caution"


def test_two_views_are_not_for_measurement(report):
    judged = verdict_of(barrel_report(takes=2))
    assert judged.level == "undistortion"
    assert judged.reasons[0].tone == "caution"
    assert "2 views cannot check each other" in judged.headline


def test_noise_is_not_said_to_be_all_of_the_error(report):
    assert said(report, "the map is known to 0.054\u202fpx")
    assert said(report, "a chart other than stated is not")


def test_take_without_focal_length_is_noticed(report):
    report["takes"][0]["focal_length_mm"] = None
    assert said(report, "1 take without a focal length")


def test_outstanding_take_is_pointed_at(report):
    report["takes"][2]["rms_px"] = 0.6
    assert said(report, "“take 3” fits 7.1 times worse")


def test_overfit_rejection_round_trip_and_peers(report):
    broken = copy.deepcopy(report)
    broken["rms_px"] = 0.5 * broken["held_out_rms_px"]
    for take in broken["takes"]:
        take["points_used"] = 0.8 * take["points_detected"]
    broken["entries"][0]["round_trip_max_px"] = 0.02
    broken["comparison"]["opencv_14_held_out_px"] = 0.01
    for words in ("2.0 times worse than fitted", "20% of the points", "loses up to"):
        assert said(broken, words)
        assert not said(report, words)
    peers = {f.tone for f in findings(broken) if "OpenCV" in f.sentence}
    assert peers == {"caution"}


def test_what_was_not_measured_is_said(report):
    report["entries"][0]["lateral_colour"] = None
    report["entries"][0]["fall_off"] = []
    assert said(report, "not applied: lateral colour and fall-off")


def test_worst_news_comes_first(report):
    report["entries"][0]["monotone"] = False
    report["takes"][0]["focal_length_mm"] = None
    order = [finding.tone for finding in findings(report)[1:]]
    rank = {"bad": 0, "caution": 1, "note": 2, "good": 3}
    assert order == sorted(order, key=rank.__getitem__)


def test_an_empty_report_still_has_a_verdict():
    assert len(verdict({})) >= 1


def test_empty_places_are_where_the_points_are_not():
    counts = np.ones((6, 8), dtype=np.int64)
    assert empty_places(counts) == []
    counts[:2, :3] = 0
    assert empty_places(counts) == ["top left"]
    counts[2:4, 3:6] = 0
    assert empty_places(counts) == ["top left", "centre"]


def test_counts_keep_every_point_even_on_the_far_edge():
    points = np.array([[0.0, 0.0], [2000.0, 1500.0], [1999.9, 0.1]])
    counts = cell_counts(points, SIZE_PX)
    assert counts.sum() == 3
    assert counts[0, 0] == counts[-1, -1] == counts[0, -1] == 1


def test_pattern_finds_what_neighbours_share_and_ignores_noise():
    rng = np.random.default_rng(3)
    points = rng.uniform((0, 0), SIZE_PX, (6000, 2))
    noise = rng.normal(0, 0.1, (6000, 2))
    bend = np.stack([0.05 * np.sign(points[:, 0] - 1000), np.zeros(6000)], axis=1)
    assert pattern_px(Residuals(points, noise), SIZE_PX) < 0.01
    assert pattern_px(Residuals(points, noise + bend), SIZE_PX) == pytest.approx(
        0.05, abs=0.005
    )


def test_shared_error_is_blamed_on_lens_or_chart(report):
    for take in report["takes"]:
        lists = take["residuals"]
        lists["dx_px"] = [0.2 if x > 1000 else -0.2 for x in lists["x_px"]]
    assert said(report, "Neighbouring points err alike by 0.20\u202fpx")


def test_error_of_each_take_alone_is_blamed_on_the_chart(report):
    """Patterns of opposite sign cancel over the takes, but not within one."""
    for sign, take in zip((1, -1, 1, -1), report["takes"], strict=True):
        lists = take["residuals"]
        lists["dx_px"] = [sign * (0.2 if x > 1000 else -0.2) for x in lists["x_px"]]
    assert said(report, "Each take has its own pattern of errors, 0.20\u202fpx")
    assert not said(report, "Neighbouring points")


@pytest.mark.parametrize("held_out_px", [0.05, 1.0])
def test_points_that_leave_much_of_the_frame_out_cap_the_grade(report, held_out_px):
    """Whatever the corners' figure says: it speaks for a model, not for the frame."""
    report["held_out_rms_px"] = held_out_px
    for take in report["takes"]:
        lists = take["residuals"]
        kept = [i for i, x in enumerate(lists["x_px"]) if x < SIZE_PX[0] / 2]
        take["residuals"] = {k: [v[i] for i in kept] for k, v in lists.items()}
    first = findings(report)[0]
    assert first.sentence.startswith("Usable where the points are")
    assert first.tone == "caution"


def test_blur_that_was_not_measured_says_which_photographs_would(report):
    for absent in (None, []):
        report["blur"] = absent
        assert said(report, "Blur was not measured: photograph the dots at two f-num")
    del report["blur"]
    assert said(report, "on both sides of focus")


def test_blur_that_could_not_be_measured_says_why(report):
    reason = "the dots themselves are too large; photograph smaller holes"
    report["blur"] = []
    report["blur_not_measured"] = [{"focal_length_mm": 28.0, "reason": reason}] * 2
    assert f"Blur was not measured: {reason}." in verdict(report)


def test_fall_off_on_white_paper_is_that_of_the_lighting_too(report):
    words = "Fall-off is that of lens and lighting together"
    assert not said(report, words)
    report["entries"][0]["fall_off"][1]["lighting_too"] = True
    assert said(report, words)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, "The blur is usable: the images of dots that the fit never saw match to"),
        ({"held_out_misfit": 0.2}, "usable for soft backgrounds"),
        ({"held_out_misfit": 0.4}, "The blur is not usable"),
        ({"sign_known": False}, "on which side of focus is not known"),
        ({"converged": False}, "its fit did not converge"),
        ({"mirrored": True}, "near and far takes swapped?"),
        ({"extrapolated": ["in focus alone: add more"]}, "in focus alone: add more."),
        (
            {"extrapolated": ["in focus alone"], "held_out_misfit": 0.2},
            "The blur is usable only where it was photographed",
        ),
        ({"held_out_misfit": None}, "in the worst take match to 5.1%"),
    ],
)
def test_blur_is_judged_in_one_sentence(report, changes, words):
    report["blur"][0] |= changes
    assert [words in one for one in verdict(report) if "blur is" in one] == [True]
    usable = not changes or changes == {"held_out_misfit": None}
    tones = {f.tone for f in findings(report) if "blur is" in f.sentence}
    assert tones == {"good" if usable else "caution"}


def test_a_take_whose_dots_are_not_those_of_the_lens_is_named(report):
    assert not said(report, "are not those of this lens")
    report["blur"][0]["takes"][1]["misfit"] = 0.6
    report["takes"][1]["f_number"] = 5.6
    assert said(report, "The dots of “take 2” (f/5.6) are not those of this lens")
    assert said(report, "misfit of 60 %")
    for take in report["blur"][0]["takes"]:
        take["targets"] = "corners"
    assert said(report, "The corners of “take 2” (f/5.6) are not those of this lens")
    assert said(report, "the images of corners that the fit never saw")


@pytest.mark.parametrize("key", ["focus_distance_mm", "target_distance_mm"])
def test_distances_that_no_take_states_are_asked_for(report, key):
    assert not said(report, f"No take states {key}")
    for take in report["takes"]:
        take[key] = None
    assert said(report, f"No take states {key}: state it")


def test_takes_left_out_for_one_reason_are_told_in_one_sentence(report):
    for name in "abcd":
        report["takes"].append(failed_take(name, "the shoot says otherwise."))
    (one,) = [s for s in verdict(report) if "left out" in s]
    assert one == "“a”, “b”, “c” and “d” were left out: the shoot says otherwise."


def test_a_fit_to_a_minority_of_the_photographs_is_not_relied_on(report):
    for name in "abcdefgh":
        report["takes"].append(failed_take(name, "the shoot says otherwise."))
    first = findings(report)[0]
    used, shot = len(report["takes"]) - 8, len(report["takes"])
    assert first.sentence.startswith(f"Only {used} of {shot} photographs agree")
    assert first.tone == "caution"


def test_points_of_takes_that_were_left_out_are_not_called_glare(report):
    report["points_detected"] *= 2
    report["takes"].append(failed_take("a", "contradicts") | {"points_detected": 900})
    assert not said(report, "points found were not used")


def test_the_worst_focal_length_speaks_for_the_blur(report):
    report["blur"].append(report["blur"][0] | {"focal_length_mm": 85.0})
    report["blur"][1]["held_out_misfit"] = 0.09
    assert said(report, "match to 9.0% at 85\u202fmm")
