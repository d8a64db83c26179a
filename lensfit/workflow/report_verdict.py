"""What a calibration is good for, said in plain words before any number.

Each rule looks at one kind of evidence and gives at most a few findings. The first
finding grades the whole: the worse of the error on points that the fit never saw (it
holds detection noise too, so it never flatters) and of the predicted standard deviation
of the map in its worst corner. Half a pixel is where a locked-off match-move begins
to show; a tenth is where set measurement stops caring. The rest say what is weak and
which photograph would mend it. Residuals of fitted points alone are no evidence
(mrcal, "tour of uncertainty and cross-validation").
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal, final

import numpy as np

from lensfit.workflow.report_coverage import (
    cell_counts,
    empty_places,
    image_size_px,
    numbers,
    pattern_px,
    residuals_of,
)
from lensfit.workflow.report_markup import number, stated

PRECISE_PX = 0.1
GOOD_PX = 0.5
ROUGH_PX = 1.5
WHOLE_COVERAGE = 0.75
"""Part of the frame; where points reach less, no figure can speak for the rest."""
ROUND_TRIP_PX = 1e-3
WEAK_CORNER_PX = 0.3
GOOD_BLUR, ROUGH_BLUR = 0.1, 0.25
"""Relative error of a dot's image: hardly visible; visible but better than a disc."""

Tone = Literal["good", "note", "caution", "bad"]


@final
@dataclass(frozen=True)
class Finding:
    """One sentence of the verdict and how much it should worry the reader."""

    tone: Tone
    sentence: str


def verdict(report: dict) -> list[str]:
    """The verdict as sentences, the grade of the whole first."""
    return [finding.sentence for finding in findings(report)]


def findings(report: dict) -> list[Finding]:
    """Every finding: the grade first, the rest from the worst to the good."""
    rules = (_map, _overfit, _takes, _failed, _outstanding, _coverage, _corners)
    rest = [one for rule in (*rules, _pattern, _rejected) for one in rule(report)]
    rest += [
        one
        for rule in (_focal, _missing, _blur, _sound, _peers)
        for one in rule(report)
    ]
    order = {"bad": 0, "caution": 1, "note": 2, "good": 3}
    return [_grade(report), *sorted(rest, key=lambda finding: order[finding.tone])]


def used_takes(report: dict) -> list[dict]:
    """The takes that went into the fit."""
    return [take for take in report.get("takes") or [] if not take.get("failed")]


def takes_by_focal(report: dict) -> dict[float | None, list[dict]]:
    """Used takes gathered by focal length, shortest first, unstated (None) last."""
    groups: dict[float | None, list[dict]] = {}
    for take in used_takes(report):
        groups.setdefault(take.get("focal_length_mm"), []).append(take)
    return dict(sorted(groups.items(), key=lambda one: (one[0] is None, one[0] or 0.0)))


def corner_deviation_px(entry: dict) -> float:
    """Largest standard deviation (px) at the corners of an entry's grid, or NaN."""
    grid = numbers((entry.get("uncertainty_grid") or {}).get("sd_px"))
    if grid.ndim != 2 or not grid.size:
        return math.nan
    corners = grid[[0, 0, -1, -1], [0, -1, 0, -1]]
    return float(np.max(corners)) if np.isfinite(corners).any() else math.nan


def _value(number_or_none: Any) -> float:
    return math.nan if number_or_none is None else float(number_or_none)


def _plural(count: int, noun: str) -> str:
    return f"{count} {noun}" + ("" if count == 1 else "s")


def _join(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _error_px(report: dict) -> tuple[float, str]:
    held_out = _value(report.get("held_out_rms_px"))
    if not math.isnan(held_out):
        return held_out, "points that the fit never saw"
    return _value(report.get("rms_px")), "the fitted points (none were held out)"


def _grade(report: dict) -> Finding:
    error, whose = _error_px(report)
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
    covered = least_coverage(report)
    if covered < WHOLE_COVERAGE and error <= ROUGH_PX:
        return Finding(
            "caution",
            f"Usable where the points are, {covered:.0%} of the frame, and a guess "
            f"elsewhere: {whose} land within {number(error, 'px', 2)} rms of where the "
            "lens puts them.",
        )
    worst = max(error, corner)
    if corner > error and corner > GOOD_PX:
        said = (
            f"in its worst corner the map is known to {number(corner, 'px', 2)} only."
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


def least_coverage(report: dict) -> float:
    """Part of the frame that the points reach, at the worst focal length; 0 to 1."""
    return min([_covered(counts) for _, counts in _counts_by_focal(report)] + [1.0])


def _counts_by_focal(report: dict) -> Iterator[tuple[float | None, np.ndarray]]:
    """Points in every cell of the frame, for each focal length that has any."""
    size = image_size_px(report)
    for focal, takes in takes_by_focal(report).items():
        points = residuals_of(takes).points_px
        if len(points) and all(size):
            yield focal, cell_counts(points, size)


def _covered(counts: np.ndarray) -> float:
    return float(np.mean(counts > 0))


def _map(report: dict) -> Iterator[Finding]:
    for entry in report.get("entries") or []:
        place = f"At {stated(entry.get('focal_length_mm'), 'mm')}"
        if entry.get("monotone") is False:
            yield Finding(
                "bad",
                f"{place} the distortion folds: two scene points share one pixel. "
                "Shoot the chart out to the frame's edges.",
            )
        loss = _value(entry.get("round_trip_max_px"))
        if loss > ROUND_TRIP_PX:
            yield Finding(
                "caution",
                f"{place} undistorting and redistorting loses up to "
                f"{number(loss, 'px', 2)}.",
            )


def _overfit(report: dict) -> Iterator[Finding]:
    fitted, held_out = (_value(report.get(k)) for k in ("rms_px", "held_out_rms_px"))
    if held_out > 1.25 * fitted and held_out - fitted > 0.01:
        yield Finding(
            "caution",
            f"Unseen points do {held_out / fitted:.1f} times worse than fitted ones: "
            "more points or more takes are needed to hold the model.",
        )


def _takes(report: dict) -> Iterator[Finding]:
    groups = takes_by_focal(report)
    for count in (1, 2):
        focals = [focal for focal, takes in groups.items() if len(takes) == count]
        if not focals:
            continue
        lengths = [stated(focal, "mm") for focal in focals if focal is not None]
        place = f" at {_join(lengths)}" if lengths else ""
        yield Finding(
            "note",
            f"Only {_plural(count, 'take')}{place}: too few views to check each other. "
            "Three or more, one of them with the chart tilted about 20°, would.",
        )


def _failed(report: dict) -> Iterator[Finding]:
    failed = [take for take in report.get("takes") or [] if take.get("failed")]
    total = len(report.get("takes") or [])
    for take in failed[:3]:
        reason = str(take["failed"]).rstrip(". ")
        yield Finding("caution", f"“{take.get('name')}” was left out: {reason}.")
    if len(failed) > 3:
        yield Finding(
            "caution", f"{len(failed)} of {total} takes were left out; see each below."
        )


def _outstanding(report: dict) -> Iterator[Finding]:
    takes = used_takes(report)
    errors = numbers([_value(take.get("rms_px")) for take in takes])
    if np.isfinite(errors).sum() < 3:
        return
    usual = float(np.nanmedian(errors))
    for take, error in zip(takes, errors, strict=True):
        if error > 2.5 * usual and error - usual > 0.05:
            yield Finding(
                "caution",
                f"“{take.get('name')}” fits {error / usual:.1f} times worse than the "
                "others: look at its overlay for blur or wrong indices, or shoot it "
                "again.",
            )


def _coverage(report: dict) -> Iterator[Finding]:
    several = len(takes_by_focal(report)) > 1
    for focal, counts in _counts_by_focal(report):
        covered, places = _covered(counts), empty_places(counts)
        if covered >= 0.9 and not places:
            continue
        place = f" at {stated(focal, 'mm')}" if several and focal else ""
        where = f", with gaps {_in_places(places)}" if places else ""
        yield Finding(
            "caution",
            f"Points cover {covered:.0%} of the frame{place}{where}. The map is a "
            "guess there: move the chart until it fills the frame.",
        )


def _sound(report: dict) -> Iterator[Finding]:
    """The good news about coverage and corners, which backs the grade."""
    corners = [corner_deviation_px(entry) for entry in report.get("entries") or []]
    known = [corner for corner in corners if not math.isnan(corner)]
    if known and max(known) <= WEAK_CORNER_PX and not list(_coverage(report)):
        yield Finding(
            "good",
            "The points reach all of the frame; in its worst corner the map is known "
            f"to {number(max(known), 'px', 2)} (1σ).",
        )


def _in_places(places: list[str]) -> str:
    """Where on the frame, with three empty ninths along an edge said as that side."""
    edges = ("left", "right", "top", "bottom")
    sides = [edge for edge in edges if sum(edge in p.split() for p in places) == 3]
    if len(sides) == 4:
        return "all around the rim"
    corners = [p for p in places if " " in p and not set(p.split()) & set(sides)]
    if sides:
        return f"at the {_join([f'{side} side' for side in sides] + corners)}"
    return f"at the {_join(places)}"


def _corners(report: dict) -> Iterator[Finding]:
    for entry in report.get("entries") or []:
        corner = corner_deviation_px(entry)
        if not corner > WEAK_CORNER_PX:
            continue
        grid = numbers(entry["uncertainty_grid"]["sd_px"])
        yield Finding(
            "caution" if corner <= ROUGH_PX else "bad",
            f"In the corners at {stated(entry.get('focal_length_mm'), 'mm')} the map "
            f"is known to {number(corner, 'px', 2)} (1σ), against "
            f"{number(float(np.nanmedian(grid)), 'px', 2)} over the frame: shoot the "
            "chart in the corners.",
        )


def _pattern(report: dict) -> Iterator[Finding]:
    """Errors that neighbours share: in all takes it is the lens, in each the chart."""
    size = image_size_px(report)
    if not all(size):
        return
    least = max(0.05, 0.5 * _error_px(report)[0])
    groups = takes_by_focal(report)
    for focal, takes in groups.items():
        place = f" at {stated(focal, 'mm')}" if len(groups) > 1 and focal else ""
        shared = pattern_px(residuals_of(takes), size)
        each = [pattern_px(residuals_of([take]), size) for take in takes]
        known = [pattern for pattern in each if not math.isnan(pattern)]
        own = float(np.median(known)) if known else math.nan
        if shared > least:
            yield Finding(
                "caution",
                f"Neighbouring points{place} err alike by {number(shared, 'px', 2)} "
                "rms: the lens does something the model does not, or the chart is "
                "bent.",
            )
        elif own > least:
            yield Finding(
                "caution",
                f"Each take{place} has its own pattern of errors, "
                f"{number(own, 'px', 2)} rms: the chart is probably bent, or "
                "moved during the exposure. Glue it to something flat.",
            )


def _rejected(report: dict) -> Iterator[Finding]:
    found, used = report.get("points_detected") or 0, report.get("points_used") or 0
    if found and used < 0.95 * found:
        yield Finding(
            "caution",
            f"{1 - used / found:.0%} of the points found were not used: see the "
            "overlays for glare, blur or dirt.",
        )


def _focal(report: dict) -> Iterator[Finding]:
    takes = used_takes(report)
    silent = sum(take.get("focal_length_mm") is None for take in takes)
    if silent:
        yield Finding(
            "caution",
            f"{_plural(silent, 'take')} without a focal length: state it in the shoot "
            "file, or the preset cannot be chosen by it.",
        )
    terms = report.get("terms") or []
    distances = [
        term for term in terms if "principal_distance" in str(term.get("name"))
    ]
    if distances and not any(term.get("kept") for term in distances):
        yield Finding(
            "note",
            "The focal length is the stated one, not measured: these views cannot "
            "tell it from the chart's distance. Tilt the chart in two more takes.",
        )


def _missing(report: dict) -> Iterator[Finding]:
    entries = report.get("entries") or []
    wanted = {"lateral_colour": "lateral colour", "fall_off": "fall-off"}
    absent = [
        name
        for key, name in wanted.items()
        if entries and not any(entry.get(key) for entry in entries)
    ]
    if absent:
        yield Finding(
            "note",
            f"Not measured, and therefore not applied: {_join(absent)}.",
        )


def _blur(report: dict) -> Iterator[Finding]:
    """One sentence: the worst focal length speaks for all."""
    if not report.get("entries"):
        return
    known = [one for one in report.get("blur") or [] if _blur_error(one)[0] >= 0]
    if not known:
        yield Finding(
            "note",
            "Blur was not measured: photograph the dots at two f-numbers and on both "
            "sides of focus.",
        )
        return
    worst = max(known, key=lambda one: _blur_error(one)[0])
    error, whose = _blur_error(worst)
    place = (
        f" at {stated(worst.get('focal_length_mm'), 'mm')}" if len(known) > 1 else ""
    )
    said = f"the images of dots {whose} match to {number(100 * error, '%', 2)}{place}"
    if any(one.get("converged") is False for one in known):
        yield Finding(
            "caution",
            f"The blur is not to be relied on, its fit did not converge: {said}.",
        )
    elif any(one.get("sign_known") is False for one in known):
        yield Finding(
            "caution",
            f"The blur is usable only where it was photographed: {said}, but on which "
            "side of focus is not known. State focus_distance_mm and "
            "target_distance_mm, or add a take on the other side.",
        )
    elif error <= GOOD_BLUR:
        yield Finding("good", f"The blur is usable: {said} (median).")
    elif error <= ROUGH_BLUR:
        yield Finding("caution", f"The blur is usable for soft backgrounds: {said}.")
    else:
        yield Finding(
            "caution",
            f"The blur is not usable: {said}. Use small bright holes, more f-numbers "
            "and both sides of focus.",
        )


def _blur_error(blur: dict) -> tuple[float, str]:
    """Held-out misfit, else the largest of the takes', else NaN."""
    held_out = _value(blur.get("held_out_misfit"))
    if not math.isnan(held_out):
        return held_out, "that the fit never saw"
    each = [_value(take.get("misfit")) for take in blur.get("takes") or []]
    known = [misfit for misfit in each if not math.isnan(misfit)]
    return max(known, default=math.nan), "in the worst take"


def _peers(report: dict) -> Iterator[Finding]:
    comparison = report.get("comparison") or {}
    error = _value(report.get("held_out_rms_px"))
    peer = _value(comparison.get("opencv_14_held_out_px"))
    if math.isnan(peer) or math.isnan(error):
        return
    tone: Tone = "good" if error <= peer else "caution"
    yield Finding(
        tone,
        f"OpenCV's 14-parameter calibration of the same points leaves "
        f"{number(peer, 'px', 2)} on points it never saw; this lens "
        f"{number(error, 'px', 2)}.",
    )
