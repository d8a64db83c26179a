"""The verdict of a calibration: the use it is good for, in plain words.

Each rule judges one kind of evidence and gives at most a few findings. The first
finding grades the whole: the worse of the error on held-out points (which includes
detection noise, so it is never too small) and of the predicted standard deviation
in the corners, of the map and of objects in focus. Half a pixel is where a locked-off
match-move begins to show; a tenth is negligible for set measurement; and both assume
that the focal length was measured, which needs views from several sides to separate it
from the chart's distance. The other findings name what is weak and which photograph
would improve it. Residuals of fitted points alone are no evidence (mrcal, "tour of
uncertainty and cross-validation").
"""

import math
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from lensfit.preset.verdict_levels import LEVELS, Level, Reason, Verdict
from lensfit.report.blur_rules import blur_findings
from lensfit.report.evidence import (
    GOOD_PX,
    LEAST_OBJECT_DEVIATION_PX,
    PRECISE_PX,
    ROUGH_PX,
    Finding,
    Tone,
    counts_by_focal,
    covered_share,
    empty_places,
    error_px,
    object_deviation_px,
    photographed_corner_px,
    plural,
    takes_by_focal,
    unmeasured_focals,
    used_takes,
)
from lensfit.report.markup import number
from lensfit.report.rules import (
    corner_findings,
    coverage_findings,
    failed_findings,
    focal_length_findings,
    lighting_findings,
    map_findings,
    missing_findings,
    outstanding_findings,
    overfit_findings,
    pattern_findings,
    peer_findings,
    rejected_findings,
    sound_findings,
    too_few_findings,
)

FEWEST_VIEWS = 3
"""Of a focal length: two cannot say which of them is wrong."""
USED_FOR: dict[Level, str] = {
    "measurement": "measuring a set, match-moving and CG",
    "match-moving": "match-moving and CG",
    "undistortion": "undistortion, and CG where the stated focal length will do",
    "look": "soft or moving CG",
    "unusable": "nothing yet",
}
AT_MOST: dict[Level, str] = {
    "measurement": "Ready for measurement",
    "match-moving": "Good for match-moving at most",
    "undistortion": "Good for undistortion at most",
    "look": "Good for soft CG at most",
    "unusable": "Not usable",
}
REMEDIES = {
    "coverage": "move the chart until it fills the frame",
    "corner": "shoot the chart in the corners",
    "extrapolation": "shoot the chart in the corners",
    "too_few": "shoot three views or more, one of them tilted by 20°",
    "failed": "mend what the sentence names, or shoot the view again",
    "outstanding": "look at its overlay, or shoot it again",
    "overfit": "shoot more views",
    "pattern": "glue the chart to something flat",
    "rejected": "look at the overlays for glare, blur or dirt",
    "focal_length": "tilt the chart in two more views",
    "lighting": "light the chart evenly, or use bright holes before an even light",
    "blur": "photograph small bright holes at two f-numbers on both sides of focus",
    "map": "shoot the chart out to the frame's edges",
    "grade": "shoot what the other reasons ask for",
}
"""What to do of findings whose sentence holds no remedy of its own."""
WHOLE_COVERAGE = 0.75
"""Part of the frame; where points reach less, no figure can speak for the rest."""
_RULES = (
    map_findings, overfit_findings, too_few_findings, failed_findings,
    outstanding_findings, coverage_findings, corner_findings, pattern_findings,
    rejected_findings, focal_length_findings, missing_findings, lighting_findings,
    blur_findings, sound_findings, peer_findings,
)  # fmt: skip


def verdict(report: dict) -> list[str]:
    """The verdict as sentences, the headline first."""
    return [finding.sentence for finding in findings(report)]


def verdict_of(report: dict) -> Verdict:
    """The verdict as data: the page, the terminal and JSON are made of this one.

    Parameters
    ----------
    report : What `calibrate` writes as ``report.json``; `contradictions` may be absent.
    """
    headline, *rest = findings(report)
    level = _limited_level(_grade(report).level, report)
    accuracy = _accuracy_px(report)
    covered = least_coverage(report) if used_takes(report) else None
    places = [p for _, counts in counts_by_focal(report) for p in empty_places(counts)]
    return Verdict(
        level=level,
        headline=headline.sentence,
        used_for=USED_FOR[level],
        accuracy_px=None if math.isnan(accuracy) else round(accuracy, 4),
        covered=covered,
        extrapolated=tuple(dict.fromkeys(places)),
        reasons=tuple(
            Reason(
                one.kind,
                one.tone,
                one.sentence,
                one.remedy
                or (REMEDIES.get(one.kind, "") if one.tone != "good" else ""),
            )
            for one in [headline, *rest]
        ),
    )


def verdict_scope(judged: Verdict) -> str:
    """Level, what for, to what accuracy and where, in one line."""
    parts = [f"Level {judged.level}: for {judged.used_for}"]
    if judged.accuracy_px is not None:
        parts.append(f"to {number(judged.accuracy_px, 'px', 2)} at worst")
    if judged.covered is not None:
        parts.append(f"where points are, {judged.covered:.0%} of the frame")
    if judged.extrapolated:
        parts.append(f"extrapolated: {', '.join(judged.extrapolated)}")
    return "; ".join(parts) + "."


def findings(report: dict) -> list[Finding]:
    """Every finding: the headline, other contradictions, then worst to good."""
    grade = _grade(report)
    contradictions = report.get("contradictions") or []
    rest = [
        replace(one, kind=one.kind or rule.__name__.removesuffix("_findings"))
        for rule in _RULES
        for one in rule(report)
    ]
    if contradictions or grade.finding.kind == "too_few":
        # Nothing is green of a shoot that nobody could check: it was fitted anyway.
        rest = [
            replace(one, tone="note") if one.tone == "good" else one for one in rest
        ]
    if not contradictions:
        order = {"bad": 0, "caution": 1, "note": 2, "good": 3}
        rest.sort(key=lambda finding: order[finding.tone])
        return [grade.finding, *rest]
    level = _limited_level(grade.level, report)
    order = {"bad": 0, "caution": 1, "note": 2}
    rest.sort(key=lambda finding: order[finding.tone])
    first, *others = [_contradiction_finding(one) for one in contradictions]
    tone: Tone = "bad" if level == "unusable" else "caution"
    sentence = f"{AT_MOST[level]}: {first.sentence}"
    headline = replace(first, tone=tone, sentence=sentence)
    figure = Finding("note", f"As stated, {grade.said}", "error")
    return [headline, *others, *([figure] if grade.said else []), *rest]


def _contradiction_finding(one: dict) -> Finding:
    text, remedy = str(one.get("text")), str(one.get("remedy"))
    sentence = f"{text}; {remedy}."
    return Finding("caution", sentence, str(one.get("kind")), remedy)


@final
@dataclass(frozen=True)
class _Grade:
    """What the figures alone allow, with the sentence on them."""

    level: Level
    finding: Finding
    said: str = ""


def _limited_level(level: Level, report: dict) -> Level:
    """The level that contradictions leave of one."""
    limits = [str(one.get("limit")) for one in report.get("contradictions") or []]
    ranks = [LEVELS.index(level)]
    ranks += [k for k, name in enumerate(LEVELS) if name in limits]
    return LEVELS[min(ranks)]


def _accuracy_px(report: dict) -> float:
    """The worst figure that the headline names: the held-out error, or the deviation of
    the worst photographed corner or of objects if larger."""
    error, _ = error_px(report)
    corner, objects = _corners_and_objects_px(report)
    return math.nan if math.isnan(error) else max(error, corner, objects)


def _judged_px(report: dict) -> float:
    """What the level is judged by: the same, but for objects that are known well enough
    not to bear on it."""
    error, _ = error_px(report)
    corner, objects = _corners_and_objects_px(report)
    return max(error, corner, objects if objects > LEAST_OBJECT_DEVIATION_PX else 0.0)


def _corners_and_objects_px(report: dict) -> tuple[float, float]:
    """Deviations of the map in the worst corner that was photographed and of objects,
    of the worst entry; 0 where none is known."""
    entries = report.get("entries") or []
    corner, objects = (
        np.fmax.reduce([of(report, entry) for entry in entries], initial=0.0)
        for of in (photographed_corner_px, object_deviation_px)
    )
    return float(corner), float(objects)


def _grade_of(level: Level, tone: Tone, sentence: str, said: str = "") -> _Grade:
    return _Grade(level, Finding(tone, sentence, "grade"), said)


def _grade(report: dict) -> _Grade:
    error, whose = error_px(report)
    entries = report.get("entries") or []
    if not used_takes(report):
        nothing = "No photograph could be used: there is no calibration."
        return _grade_of("unusable", "bad", nothing)
    if math.isnan(error):
        nothing = "Not usable yet: the report holds no error at all."
        return _grade_of("unusable", "bad", nothing)
    if any(entry.get("monotone") is False for entry in entries):
        folded = "Not usable yet: the distortion folds inside the frame."
        return _grade_of("unusable", "bad", folded)
    said = (
        f"{whose} land within {number(error, 'px', 2)} rms of where the lens puts them."
    )
    if error <= ROUGH_PX:
        partial = _partial_use_grade(report, said) or _few_views_grade(report, said)
        if partial is not None:
            return partial
    worst = _judged_px(report)
    said = _with_corners(report, error, said)
    if worst <= GOOD_PX and unmeasured_focals(report):
        # Level and figure hold; what CG needs besides nobody could check.
        ready = (
            "Good for undistortion, and for CG only if focal_length_mm, pitch_mm and "
            "target_distance_mm are right, which these views cannot check (tilt the "
            f"chart by 20° in two more): {said}"
        )
        return _grade_of("undistortion", "caution", ready, said)
    if worst <= PRECISE_PX:
        ready = f"Ready for measurement, match-moving and CG: {said}"
        return _grade_of("measurement", "good", ready, said)
    if worst <= GOOD_PX:
        ready = f"Ready for match-moving and CG compositing: {said}"
        return _grade_of("match-moving", "good", ready, said)
    if worst <= ROUGH_PX:
        soft = f"Good enough for soft or moving CG, not for measurement: {said}"
        return _grade_of("look", "caution", soft, said)
    return _grade_of("unusable", "bad", f"Not usable yet: {said}", said)


def _with_corners(report: dict, error: float, said: str) -> str:
    """What is said of the error, and of the corners where they are known less well."""
    corner, objects = _corners_and_objects_px(report)
    if corner > max(error, GOOD_PX):
        known = number(corner, "px", 2)
        if objects > corner:
            known += f", objects to {number(objects, 'px', 2)}"
        return f"in its worst corner the map is known to {known} only."
    worse = max(corner, objects)
    if worse > max(error, PRECISE_PX):
        least = "objects in its corners are"
        if corner >= objects:
            least = "the map in its corners is"
        return f"{said[:-1]}; {least} known to {number(worse, 'px', 2)}."
    return said


def _partial_use_grade(report: dict, said: str) -> _Grade | None:
    """Where most photographs, or much of the frame, were not used."""
    used, shot = len(used_takes(report)), len(report.get("takes") or [])
    if 2 * used < shot:
        few = (
            f"Only {used} of {shot} photographs agree with what the shoot file states; "
            f"do not rely on them before the others are mended: {said}"
        )
        return _grade_of("look", "caution", few, said)
    covered = least_coverage(report)
    if covered < WHOLE_COVERAGE:
        part = (
            f"Usable where the points are, {covered:.0%} of the frame, and "
            f"extrapolated elsewhere: {said}"
        )
        return _grade_of("undistortion", "caution", part, said)
    return None


def _few_views_grade(report: dict, said: str) -> _Grade | None:
    """Where too few views of a focal length are there to check each other."""
    counts = [len(takes) for takes in takes_by_focal(report).values()]
    if not counts or min(counts) >= FEWEST_VIEWS:
        return None
    few = (
        f"{AT_MOST['undistortion']}: {plural(min(counts), 'view')} cannot check each "
        f"other, shoot {FEWEST_VIEWS} or more, one of them tilted by 20°: {said}"
    )
    if min(counts) == 1:
        few = few.replace("1 view cannot check each other", "1 view checks nothing")
    return _Grade("undistortion", Finding("caution", few, "too_few"), said)


def least_coverage(report: dict) -> float:
    """Part of the frame that the points reach, at the worst focal length; 0 to 1."""
    return min([covered_share(counts) for _, counts in counts_by_focal(report)] + [1.0])
