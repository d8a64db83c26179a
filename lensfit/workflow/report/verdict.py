"""What a calibration is good for, said in plain words before any number.

Each rule looks at one kind of evidence and gives at most a few findings. The first
finding grades the whole: the worse of the error on points that the fit never saw (it
holds detection noise too, so it never flatters) and of the predicted standard deviation
of the map in its worst corner. Half a pixel is where a locked-off match-move begins
to show; a tenth is where set measurement stops caring; and both take the focal length
for measured, which it is only where views from several sides tell it from the chart's
distance. The rest say what is weak and which photograph would mend it. Residuals of
fitted points alone are no evidence (mrcal, "tour of uncertainty and cross-validation").
"""

import math

from lensfit.workflow.report.blur_rules import blur_findings
from lensfit.workflow.report.evidence import (
    GOOD_PX,
    ROUGH_PX,
    Finding,
    corner_deviation_px,
    counts_by_focal,
    covered_share,
    error_px,
    unmeasured_focals,
    used_takes,
)
from lensfit.workflow.report.map_rules import (
    corner_findings,
    coverage_findings,
    map_findings,
    overfit_findings,
    pattern_findings,
    sound_findings,
)
from lensfit.workflow.report.markup import number
from lensfit.workflow.report.take_rules import (
    failed_findings,
    focal_length_findings,
    lighting_findings,
    missing_findings,
    outstanding_findings,
    peer_findings,
    rejected_findings,
    too_few_findings,
)

PRECISE_PX = 0.1
WHOLE_COVERAGE = 0.75
"""Part of the frame; where points reach less, no figure can speak for the rest."""
_RULES = (
    map_findings, overfit_findings, too_few_findings, failed_findings,
    outstanding_findings, coverage_findings, corner_findings, pattern_findings,
    rejected_findings, focal_length_findings, missing_findings, lighting_findings,
    blur_findings, sound_findings, peer_findings,
)  # fmt: skip


def verdict(report: dict) -> list[str]:
    """The verdict as sentences, the grade of the whole first."""
    return [finding.sentence for finding in findings(report)]


def findings(report: dict) -> list[Finding]:
    """Every finding: the grade first, the rest from the worst to the good."""
    rest = [one for rule in _RULES for one in rule(report)]
    order = {"bad": 0, "caution": 1, "note": 2, "good": 3}
    return [_grade(report), *sorted(rest, key=lambda finding: order[finding.tone])]


def _grade(report: dict) -> Finding:
    error, whose = error_px(report)
    if not used_takes(report):
        return Finding("bad", "No photograph could be used: there is no calibration.")
    entries = report.get("entries") or []
    if math.isnan(error):
        return Finding("bad", "Not usable yet: the report holds no error at all.")
    if any(entry.get("monotone") is False for entry in entries):
        return Finding("bad", "Not usable yet: the distortion folds inside the frame.")
    corner = max(
        (sd for sd in map(corner_deviation_px, entries) if sd == sd), default=0.0
    )
    said = (
        f"{whose} land within {number(error, 'px', 2)} rms of where the lens puts them."
    )
    partial = _of_part(report, said)
    if partial is not None and error <= ROUGH_PX:
        return partial
    worst = max(error, corner)
    if corner > error and corner > GOOD_PX:
        said = (
            f"in its worst corner the map is known to {number(corner, 'px', 2)} only."
        )
    if worst <= GOOD_PX and unmeasured_focals(report):
        return Finding(
            "good",
            "Ready for undistortion, and for CG where the stated focal length will do: "
            f"{said}",
        )
    if worst <= PRECISE_PX:
        return Finding("good", f"Ready for measurement, match-moving and CG: {said}")
    if worst <= GOOD_PX:
        return Finding("good", f"Ready for match-moving and CG compositing: {said}")
    if worst <= ROUGH_PX:
        return Finding(
            "caution", f"Good enough for soft or moving CG, not for measurement: {said}"
        )
    return Finding("bad", f"Not usable yet: {said}")


def _of_part(report: dict, said: str) -> Finding | None:
    """Where most photographs, or much of the frame, had no say."""
    used, shot = len(used_takes(report)), len(report.get("takes") or [])
    if 2 * used < shot:
        return Finding(
            "caution",
            f"Only {used} of {shot} photographs agree with what the shoot file states; "
            f"do not rely on them before the others are mended: {said}",
        )
    covered = least_coverage(report)
    if covered < WHOLE_COVERAGE:
        return Finding(
            "caution",
            f"Usable where the points are, {covered:.0%} of the frame, and a guess "
            f"elsewhere: {said}",
        )
    return None


def least_coverage(report: dict) -> float:
    """Part of the frame that the points reach, at the worst focal length; 0 to 1."""
    return min([covered_share(counts) for _, counts in counts_by_focal(report)] + [1.0])
