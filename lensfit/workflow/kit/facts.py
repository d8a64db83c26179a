"""What a kit's page says of one calibrated lens, from its report.

Everything is plain numbers, ready for JSON. A figure that nobody measured is None.
"""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from lensfit.report.plain_numbers import distance_of, plain
from lensfit.report.verdict import verdict_of
from lensfit.workflow.kit.focus_scale import focus_scale
from lensfit.workflow.kit.records import KitLens

Facts = dict[str, Any]


def lens_facts(lens: KitLens, report: Facts) -> Facts:
    """Verdict and figures of a lens.

    Parameters
    ----------
    report : As in ``report.json``.

    Returns
    -------
    "verdict" (level, headline, accuracy_px, remedy), "focal_lengths" (a row for each:
    breathing, distortion, lateral colour, fall-off) and "focus_scale".
    """
    judged = verdict_of(report)
    first = judged.reasons[0]
    entries = report.get("entries") or []
    focals = list(dict.fromkeys(entry.get("focal_length_mm") for entry in entries))
    return {
        "verdict": {
            "level": judged.level,
            "headline": judged.headline,
            "accuracy_px": judged.accuracy_px,
            "tone": first.tone,
            "remedy": first.remedy,
        },
        "views_used": sum(not t.get("failed") for t in report.get("takes") or []),
        "seconds": (report.get("seconds") or {}).get("whole"),
        "focal_lengths": [
            _focal_facts(focal, [e for e in entries if e["focal_length_mm"] == focal],
                         report)
            for focal in focals
        ],
        "focus_scale": focus_scale(lens, report),
    }  # fmt: skip


def _focal_facts(focal_mm: float, entries: list[Facts], report: Facts) -> Facts:
    far = max(entries, key=_focus_order)
    fitted = [
        s
        for s in report.get("statements") or []
        if s["quantity"] == "focal_length" and s["focal_length_mm"] == focal_mm
    ]
    distortion = _of_corner(far, "distortion_percent")
    return {
        "focal_length_mm": focal_mm,
        "fitted_focal_length_mm": plain(_mean([s["fitted"] for s in fitted])),
        "breathing_percent": breathing_percent(entries),
        "distortion_percent": distortion,
        "lateral_colour_px": _lateral_px(entries),
        "fall_off": list(_fall_off(entries)),
    }


def breathing_percent(entries: list[Facts]) -> float | None:
    """How much larger the lens draws at its nearest mark than at its farthest."""
    known = sorted(
        (one for one in entries if one.get("focus_distance_mm") is not None),
        key=_focus_order,
    )
    if len(known) < 2:
        return None
    near, far = (float(one["principal_distance_mm"]) for one in (known[0], known[-1]))
    return round(100 * (near / far - 1), 4)


def _focus_order(entry: Facts) -> float:
    focus = distance_of(entry.get("focus_distance_mm"))
    return math.inf if focus is None else focus


def _of_corner(entry: Facts, key: str) -> float | None:
    """The last value of the radial profile, at the frame's corner."""
    values = (entry.get("radial_profile") or {}).get(key) or []
    known = [value for value in values if value is not None]
    return float(known[-1]) if known else None


def _lateral_px(entries: list[Facts]) -> float | None:
    """The largest displacement of red or blue against green."""
    curves = [entry.get("lateral_colour") or {} for entry in entries]
    values = [
        abs(value)
        for curve in curves
        for key in ("r_px", "b_px")
        for value in curve.get(key) or []
        if value is not None
    ]
    return max(values) if values else None


def _fall_off(entries: list[Facts]) -> Iterator[Facts]:
    """Stops of light that the corner loses at each f-number, the mean of all marks."""
    lost: dict[float, list[float]] = {}
    for entry in entries:
        for curve in entry.get("fall_off") or []:
            light = curve["g"][-1] if curve.get("g") else None
            if curve.get("f_number") and light:
                lost.setdefault(curve["f_number"], []).append(-math.log2(light))
    for stop, values in sorted(lost.items()):
        yield {"f_number": stop, "corner_stops": round(float(np.mean(values)), 4)}


def _mean(values: list[float]) -> float:
    return float(np.mean(values)) if values else math.nan
