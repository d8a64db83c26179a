"""The finding on the blur: what it is good for, or which photographs would tell."""

import math
from collections.abc import Iterator

from lensfit.kernel.blur_quality import GOOD_BLUR, ROUGH_BLUR
from lensfit.workflow.report.evidence import Finding, value_of
from lensfit.workflow.report.markup import number, stated


def blur_findings(report: dict) -> Iterator[Finding]:
    """One sentence: the worst focal length speaks for all."""
    if not report.get("entries"):
        return
    known = [one for one in report.get("blur") or [] if _blur_error(one)[0] >= 0]
    if not known:
        yield Finding("note", f"Blur was not measured: {_why_not(report)}.")
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
