"""Held-out error against time of the geometric fit and of OpenCV, as a picture.

A curve for every method, a point for each set, those of more marks further right.
"""

from pathlib import Path
from typing import Any

from data_synth.bench.plot import Curve, write_curves

PICTURE = "error_against_time_fit.png"
_ERROR, _SECONDS = "held-out reprojection, px rms", "geometric fit, s"
_NOT_METHODS = ("first", "spread")


def write_plot(rows: list[dict[str, Any]], folder: Path) -> Path | None:
    """Draw the curves of `bench_fit`'s rows; None where no set has both figures.

    Raises
    ------
    OutputError : The file cannot be written.
    """
    errors, seconds = (_by_set(rows, what) for what in (_ERROR, _SECONDS))
    both = [name for name in errors if name in seconds]
    if not both:
        return None
    methods = [m for m in seconds[both[0]] if m not in _NOT_METHODS]
    curves = [_curve(method, both, errors, seconds) for method in methods]
    return write_curves(
        curves,
        folder / PICTURE,
        time="seconds, programs compiled",
        error="held-out reprojection, px rms",
    )


def _by_set(rows: list[dict[str, Any]], what: str) -> dict[str, dict[str, float]]:
    """Figures of all methods by set."""
    return {
        row["set"]: {"lensfit": row["value"]} | row["peers"]
        for row in rows
        if row["what"] == what
    }


def _curve(
    method: str,
    sets: list[str],
    errors: dict[str, dict[str, float]],
    seconds: dict[str, dict[str, float]],
) -> Curve:
    order = sorted(sets, key=lambda name: seconds[name][method])
    return Curve(
        method,
        [errors[name][method] for name in order],
        [seconds[name][method] for name in order],
        tuple(order),
    )
