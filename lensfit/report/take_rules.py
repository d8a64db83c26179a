"""Findings on the takes: too few, failed, worse than others, what is not measured."""

import math
from collections.abc import Iterator

import numpy as np

from lensfit.report.evidence import (
    Finding,
    Tone,
    joined,
    plural,
    takes_by_focal,
    unmeasured_focals,
    used_takes,
    value_of,
)
from lensfit.report.frame_coverage import numbers
from lensfit.report.markup import number, stated

_MOST_REASONS = 3


def too_few_findings(report: dict) -> Iterator[Finding]:
    """Focal lengths with one take or two."""
    groups = takes_by_focal(report)
    for count in (1, 2):
        focals = [focal for focal, takes in groups.items() if len(takes) == count]
        if not focals:
            continue
        lengths = [stated(focal, "mm") for focal in focals if focal is not None]
        place = f" at {joined(lengths)}" if lengths else ""
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
        yield Finding("caution", f"{joined(names)} {were} left out: {reason}.")
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
        lengths = [stated(f, "mm") for f in stated_only if f is not None]
        several = len(takes_by_focal(report)) > 1 and lengths
        place = f" at {joined(lengths)}" if several else ""
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
            f"Not measured, and therefore not applied: {joined(absent)}.",
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
