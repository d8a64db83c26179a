"""The finding on the blur: its use, or the photographs that are needed for it."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from lensfit.psf.blur_quality import GOOD_BLUR, ROUGH_BLUR
from lensfit.report.evidence import (
    Finding,
    numbers,
    sentence_list,
    used_takes,
    value_of,
)
from lensfit.report.markup import number, stated_value

_FAR_WORSE = 3.0
"""Times the misfit of the median take, from which on one is named."""


def blur_findings(report: dict) -> Iterator[Finding]:
    """What it is good for; the worst focal length speaks for all. Then what would mend
    it."""
    if not report.get("entries"):
        return
    known = [one for one in report.get("blur") or [] if _blur_error(one)[0] >= 0]
    if not known:
        yield Finding("note", f"Blur was not measured: {_why_not(report)}.")
        return
    worst = max(known, key=lambda one: _blur_error(one)[0])
    error, whose = _blur_error(worst)
    place = (
        f" at {stated_value(worst.get('focal_length_mm'), 'mm')}"
        if len(known) > 1
        else ""
    )
    targets = targets_of(worst.get("takes") or [])
    said = (
        f"the images of {targets} {whose} match to {number(100 * error, '%', 2)}{place}"
    )
    yield _use(known, error, said)
    yield from _unsaid(report, known)
    yield from _outstanding(report, known)


def targets_of(takes: Sequence[dict]) -> str:
    """What of the charts was photographed: dots, corners, or both."""
    return (
        " and ".join(sorted({str(t.get("targets", "dots")) for t in takes})) or "dots"
    )


def _all_targets(known: list[dict]) -> str:
    return targets_of([take for blur in known for take in blur.get("takes") or []])


def _use(known: list[dict], error: float, said: str) -> Finding:
    """What the blur is good for."""
    extrapolated = [one for blur in known for one in blur.get("extrapolated") or []]
    if any(one.get("converged") is False for one in known):
        return Finding(
            "caution",
            f"The blur is not to be relied on, its fit did not converge: {said}.",
        )
    if any(one.get("mirrored") for one in known):
        return Finding(
            "caution",
            f"The blur is not to be relied on: the {_all_targets(known)} look as if "
            "they lay on the other side of focus than was stated. Were "
            "focus_distance_mm of near and far takes swapped?",
        )
    if any(one.get("sign_known") is False for one in known):
        return Finding(
            "caution",
            f"The blur is usable only where it was photographed: {said}, but on which "
            "side of focus is not known. State focus_distance_mm and "
            "target_distance_mm, or add a take on the other side.",
        )
    if error > ROUGH_BLUR:
        return Finding(
            "caution",
            f"The blur is not usable: {said}. Use small bright holes, more f-numbers "
            "and both sides of focus.",
        )
    if extrapolated:
        why = "; ".join(dict.fromkeys(extrapolated))
        return Finding(
            "caution",
            f"The blur is usable only where it was photographed: {said}; {why}.",
        )
    if error <= GOOD_BLUR:
        return Finding("good", f"The blur is usable: {said} (median).")
    return Finding("caution", f"The blur is usable for soft backgrounds: {said}.")


def _unsaid(report: dict, known: list[dict]) -> Iterator[Finding]:
    """Distances that nobody stated, without which takes of one focus are not known
    from those of another."""
    shown = {take.get("image") for blur in known for take in blur.get("takes") or []}
    takes = [take for take in used_takes(report) if take.get("image") in shown]
    for key in ("focus_distance_mm", "target_distance_mm"):
        # Of some it may be unknown: a tilted chart has no one distance.
        if takes and all(take.get(key) is None for take in takes):
            yield Finding(
                "caution",
                f"No take states {key}: state it, or the blur at one focus is taken "
                "for that at another.",
            )


def _outstanding(report: dict, known: list[dict]) -> Iterator[Finding]:
    """Takes whose dots are far worse explained than those of the others."""
    named = {take.get("image"): take for take in report.get("takes") or []}
    for blur in known:
        takes = blur.get("takes") or []
        misfit = numbers([value_of(take.get("misfit")) for take in takes])
        if np.isfinite(misfit).sum() < 3:
            continue
        usual = float(np.nanmedian(misfit))
        bad = (misfit > _FAR_WORSE * usual) & (misfit > GOOD_BLUR)
        names = [
            _name_and_stop(named.get(take.get("image"), take))
            for take, worse in zip(takes, bad, strict=True)
            if worse
        ]
        if names:
            yield Finding(
                "caution",
                f"The {targets_of(takes)} of {sentence_list(names)} are not those of "
                f"this lens (misfit of {100 * float(np.nanmax(misfit)):.0f} %, of the "
                f"others {100 * usual:.0f} %): check the stated f_number and focus.",
            )


def _name_and_stop(take: dict) -> str:
    name = take.get("name") or take.get("image") or "a take"
    return f"“{name}” (f/{value_of(take.get('f_number')):g})"


def _why_not(report: dict) -> str:
    """What the fit said of the dots; where there were none, what to photograph."""
    said = [str(one.get("reason")) for one in report.get("blur_not_measured") or []]
    ask = "photograph the dots at two f-numbers and on both sides of focus"
    return "; ".join(dict.fromkeys(said)) or ask


def _blur_error(blur: dict) -> tuple[float, str]:
    """Held-out misfit, else the largest of the takes', else NaN."""
    held_out = value_of(blur.get("held_out_misfit"))
    if not math.isnan(held_out):
        return held_out, "that the fit never saw"
    each = [value_of(take.get("misfit")) for take in blur.get("takes") or []]
    known = [misfit for misfit in each if not math.isnan(misfit)]
    return max(known, default=math.nan), "in the worst take"
