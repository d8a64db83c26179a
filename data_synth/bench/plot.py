"""Error against time as a picture, both axes logarithmic: a curve for every method.

A method that was run once is a point, one that takes no time to speak of a level.
"""

import io
from pathlib import Path
from typing import NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lensfit.atomic import write_bytes_atomic

_ROOM_FOR_LABELS = 0.2
"""On either side, of the width that the points take."""


class Curve(NamedTuple):
    """Errors of one method.

    Attributes
    ----------
    name : Of the method.
    errors : One for each setting of it.
    seconds : As many; none for a method without a time (one error).
    labels : Names of the settings, or none.
    worse : Larger errors of the same runs (90th percentiles), or none.
    """

    name: str
    errors: list[float]
    seconds: list[float]
    labels: tuple[str, ...] = ()
    worse: tuple[float, ...] = ()


def write_curves(curves: list[Curve], path: Path, *, time: str, error: str) -> Path:
    """Draw curves and write the picture.

    Parameters
    ----------
    time, error : What the axes say.

    Raises
    ------
    OutputError : The file cannot be written.
    """
    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    axes = figure.add_subplot(xscale="log", yscale="log")
    axes.margins(x=_ROOM_FOR_LABELS, y=0.08)
    timed = [curve for curve in curves if curve.seconds]
    for curve in timed:
        _draw(axes, curve)
    least = min((s for curve in timed for s in curve.seconds), default=1.0)
    for curve in curves:
        if not curve.seconds:
            axes.axhline(curve.errors[0], color="0.6", lw=1)
            place = (least, curve.errors[0])
            axes.annotate(curve.name, place, fontsize=8, color="0.4")
    axes.set_xlabel(time)
    axes.set_ylabel(error)
    axes.grid(True, which="both", lw=0.3)
    axes.legend(fontsize=8)
    drawn = io.BytesIO()
    figure.savefig(drawn, format="png", dpi=150)
    write_bytes_atomic(path, drawn.getvalue())
    return path


def _draw(axes: Axes, curve: Curve) -> None:
    mark = "o-" if len(curve.seconds) > 1 else "s"
    (line,) = axes.plot(curve.seconds, curve.errors, mark, label=curve.name)
    if curve.worse:
        dashed = {"ls": "--", "lw": 0.8, "mfc": "none", "marker": mark[0]}
        axes.plot(curve.seconds, curve.worse, color=line.get_color(), **dashed)
    places = zip(curve.seconds, curve.errors, strict=True)
    for label, place in zip(curve.labels, places, strict=False):
        axes.annotate(label, place, (3, 3), textcoords="offset points", fontsize=7)
