"""Findings on the takes, and on the map that was fitted to them.

On takes: too few, failed, worse than others, what is not measured. On the map: folds,
coverage, corners, and errors that neighbours share.
"""

import math
from collections.abc import Iterator

import numpy as np

from lensfit.report.evidence import (
    ROUGH_PX,
    Finding,
    Tone,
    corner_deviation_px,
    counts_by_focal,
    covered_share,
    empty_places,
    error_px,
    extrapolated_corner_px,
    image_size_px,
    numbers,
    pattern_px,
    photographed_corner_px,
    plural,
    residuals_of,
    sentence_list,
    takes_by_focal,
    unmeasured_focals,
    used_takes,
    value_of,
)
from lensfit.report.markup import number, stated_value

_MOST_REASONS = 3


def too_few_findings(report: dict) -> Iterator[Finding]:
    """Focal lengths with one take or two."""
    groups = takes_by_focal(report)
    for count in (1, 2):
        focals = [focal for focal, takes in groups.items() if len(takes) == count]
        if not focals:
            continue
        lengths = [stated_value(focal, "mm") for focal in focals if focal is not None]
        place = f" at {sentence_list(lengths)}" if lengths else ""
        yield Finding(
            "note",
            f"Only {plural(count, 'take')}{place}: too few views to check each other. "
            "Three or more, one of them with the chart tilted about 20°, would.",
        )


def failed_findings(report: dict) -> Iterator[Finding]:
    """Takes that were left out."""
    failed = [take for take in report.get("takes") or [] if take.get("failed")]
    total = len(report.get("takes") or [])
    by_reason: dict[str, list[str]] = {}
    for take in failed:
        reason = str(take["failed"]).rstrip(". ")
        by_reason.setdefault(reason, []).append(f"“{take.get('name')}”")
    for reason, names in list(by_reason.items())[:_MOST_REASONS]:
        were = "was" if len(names) == 1 else "were"
        yield Finding("caution", f"{sentence_list(names)} {were} left out: {reason}.")
    if len(by_reason) > _MOST_REASONS:
        yield Finding("caution", f"{len(failed)} of {total} takes were left out.")


def outstanding_findings(report: dict) -> Iterator[Finding]:
    """Takes that fit worse than the others."""
    takes = used_takes(report)
    errors = numbers([value_of(take.get("rms_px")) for take in takes])
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


def rejected_findings(report: dict) -> Iterator[Finding]:
    """Detected points of used takes that were rejected."""
    takes = used_takes(report)
    found, used = (
        sum(take.get(key) or 0 for take in takes)
        for key in ("points_detected", "points_used")
    )
    if found and used < 0.95 * found:
        yield Finding(
            "caution",
            f"{1 - used / found:.0%} of the points found were not used: see the "
            "overlays for glare, blur or dirt.",
        )


def focal_length_findings(report: dict) -> Iterator[Finding]:
    """Focal lengths that nobody stated or measured."""
    takes = used_takes(report)
    silent = sum(take.get("focal_length_mm") is None for take in takes)
    if silent:
        yield Finding(
            "caution",
            f"{plural(silent, 'take')} without a focal length: state it in the shoot "
            "file, or the preset cannot be chosen by it.",
        )
    stated_only = unmeasured_focals(report)
    if stated_only:
        lengths = [stated_value(f, "mm") for f in stated_only if f is not None]
        several = len(takes_by_focal(report)) > 1 and lengths
        place = f" at {sentence_list(lengths)}" if several else ""
        yield Finding(
            "note",
            f"The focal length{place} is the stated one, not measured: these views "
            "cannot tell it from the chart's distance. Tilt the chart in two more "
            "takes.",
        )


def missing_findings(report: dict) -> Iterator[Finding]:
    """What was not measured."""
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
            f"Not measured, and therefore not applied: {sentence_list(absent)}.",
        )


def lighting_findings(report: dict) -> Iterator[Finding]:
    """Fall-off of charts that the room lights."""
    curves = [c for e in report.get("entries") or [] for c in e.get("fall_off") or []]
    if any(curve.get("lighting_too") for curve in curves):
        yield Finding(
            "note",
            "Fall-off is that of lens and lighting together: dark dots and squares "
            "on white cannot tell them apart. Light the chart evenly, or photograph "
            "bright holes before an even light.",
        )


def peer_findings(report: dict) -> Iterator[Finding]:
    """The peer on the same points."""
    comparison = report.get("comparison") or {}
    error = value_of(report.get("held_out_rms_px"))
    peer = value_of(comparison.get("opencv_14_held_out_px"))
    if math.isnan(peer) or math.isnan(error):
        return
    tone: Tone = "good" if error <= peer else "caution"
    yield Finding(
        tone,
        f"OpenCV's 14-parameter calibration of the same points leaves "
        f"{number(peer, 'px', 2)} on points it never saw; this lens "
        f"{number(error, 'px', 2)}.",
    )


ROUND_TRIP_PX = 1e-3
WEAK_CORNER_PX = 0.3


def map_findings(report: dict) -> Iterator[Finding]:
    """The distortion folds, or does not invert."""
    for entry in report.get("entries") or []:
        place = f"At {stated_value(entry.get('focal_length_mm'), 'mm')}"
        if entry.get("monotone") is False:
            yield Finding(
                "bad",
                f"{place} the distortion folds: two scene points share one pixel. "
                "Shoot the chart out to the frame's edges.",
            )
        loss = value_of(entry.get("round_trip_max_px"))
        if loss > ROUND_TRIP_PX:
            yield Finding(
                "caution",
                f"{place} undistorting and redistorting loses up to "
                f"{number(loss, 'px', 2)}.",
            )


def overfit_findings(report: dict) -> Iterator[Finding]:
    """Unseen points do worse than fitted ones."""
    fitted, held_out = (value_of(report.get(k)) for k in ("rms_px", "held_out_rms_px"))
    if held_out > 1.25 * fitted and held_out - fitted > 0.01:
        yield Finding(
            "caution",
            f"Unseen points do {held_out / fitted:.1f} times worse than fitted ones: "
            "more points or more takes are needed to hold the model.",
        )


def coverage_findings(report: dict) -> Iterator[Finding]:
    """Where the frame has no points."""
    several = len(takes_by_focal(report)) > 1
    for focal, counts in counts_by_focal(report):
        covered, places = covered_share(counts), empty_places(counts)
        if covered >= 0.9 and not places:
            continue
        place = f" at {stated_value(focal, 'mm')}" if several and focal else ""
        where = f", with gaps {_places_text(places)}" if places else ""
        yield Finding(
            "caution",
            f"Points cover {covered:.0%} of the frame{place}{where}. The map is "
            "extrapolated in the gaps: move the chart until it fills the frame.",
        )


def sound_findings(report: dict) -> Iterator[Finding]:
    """The good news about coverage and corners, which backs the grade."""
    corners = [corner_deviation_px(entry) for entry in report.get("entries") or []]
    known = [corner for corner in corners if not math.isnan(corner)]
    if known and max(known) <= WEAK_CORNER_PX and not list(coverage_findings(report)):
        yield Finding(
            "good",
            "The points reach all of the frame; the map is known to "
            f"{number(max(known), 'px', 2)} (1σ) in its worst corner"
            f"{_largest_share_text(report)}; a chart other than stated is not in it.",
        )


_ERRORS = {
    "detections": "the detections' noise",
    "wavefront": "what the blur leaves open of where chief rays land",
    "statements": "stated distances and focal lengths",
    "systematic": "errors that no residual shows",
}


def _largest_share_text(report: dict) -> str:
    """The largest share of the variance in the worst corner, if the report has it."""
    entries = [entry for entry in report["entries"] if entry.get("corner_shares")]
    if not entries:
        return ""
    worst = max(entries, key=lambda entry: np.nan_to_num(corner_deviation_px(entry)))
    name, share = max(worst["corner_shares"].items(), key=lambda one: one[1])
    return f", {share:.0%} of its variance from {_ERRORS[name]}"


def _places_text(places: list[str]) -> str:
    """Where on the frame, with three empty ninths along an edge said as that side."""
    edges = ("left", "right", "top", "bottom")
    sides = [edge for edge in edges if sum(edge in p.split() for p in places) == 3]
    if len(sides) == 4:
        return "all around the rim"
    corners = [p for p in places if " " in p and not set(p.split()) & set(sides)]
    if sides:
        return f"at the {sentence_list([f'{side} side' for side in sides] + corners)}"
    return f"at the {sentence_list(places)}"


def corner_findings(report: dict) -> Iterator[Finding]:
    """Corners known less well than the rest: photographed ones, then extrapolated."""
    for entry in report.get("entries") or []:
        place = stated_value(entry.get("focal_length_mm"), "mm")
        corner = photographed_corner_px(report, entry)
        if corner > WEAK_CORNER_PX:
            grid = numbers(entry["uncertainty_grid"]["sd_px"])
            yield Finding(
                "caution" if corner <= ROUGH_PX else "bad",
                f"In the corners at {place} the map is known to "
                f"{number(corner, 'px', 2)} (1σ), against "
                f"{number(float(np.nanmedian(grid)), 'px', 2)} over the frame: shoot "
                "the chart in the corners.",
            )
        beyond = extrapolated_corner_px(report, entry)
        if beyond > WEAK_CORNER_PX:
            yield Finding(
                "caution",
                f"Corners at {place} without any point are extrapolated, to "
                f"{number(beyond, 'px', 2)} (1σ); this is no error of the rest: shoot "
                "the chart in the corners.",
                kind="extrapolation",
            )


def pattern_findings(report: dict) -> Iterator[Finding]:
    """Errors that neighbours share: in all takes it is the lens, in each the chart."""
    size = image_size_px(report)
    if not all(size):
        return
    least = max(0.05, 0.5 * error_px(report)[0])
    groups = takes_by_focal(report)
    for focal, takes in groups.items():
        place = f" at {stated_value(focal, 'mm')}" if len(groups) > 1 and focal else ""
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
