"""Error against time as pictures, both axes logarithmic: a curve for every method.

A method that was run once is a point, one that takes no time to speak of a level.

Of the geometric fit and of OpenCV the held-out error is drawn, a point for each set,
those of more detections further right.

Of renderers it is the root mean square against the path-traced reference,
display-clipped; what is left at any price is the plate's own (a pinhole picture does
not show what stands behind things).

Of point-spread functions every lens has a picture against the time of the fit. Filled
dots are medians over field, colour and photographed settings, hollow ones 90th
percentiles. Processor seconds, since they do not count what else the machine did.
"""

import io
from pathlib import Path
from typing import Any, NamedTuple

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


FIT_PICTURE = "error_against_time_fit.png"
_ERROR, _SECONDS = "held-out reprojection, px rms", "geometric fit, s"
_NOT_METHODS = ("first", "spread")


def write_fit_plot(rows: list[dict[str, Any]], folder: Path) -> Path | None:
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
    curves = [_fit_curve(method, both, errors, seconds) for method in methods]
    return write_curves(
        curves,
        folder / FIT_PICTURE,
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


def _fit_curve(
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


RENDER_PICTURE = "error_against_time.png"


def write_render_plot(result: dict[str, Any], folder: Path) -> Path:
    """Draw the curves of `bench_render` on the plate, and its peers.

    Raises
    ------
    OutputError : The file cannot be written.
    """
    points = result["curves"]["plate"]
    curves = [
        Curve(
            "lensfit",
            [_rms(point["psnr_db"]) for point in points],
            [point["seconds"] for point in points],
            tuple(f"{point['tolerance']:g}" for point in points),
        )
    ]
    for name, (spent, psnr_db) in peers_of(result["rows"]).items():
        seconds = [] if spent is None else [spent]
        curves.append(Curve(name, [_rms(psnr_db)], seconds))
    error = "rms error against the path-traced reference"
    return write_curves(curves, folder / RENDER_PICTURE, time="seconds", error=error)


def peers_of(rows: list[dict[str, Any]]) -> dict[str, tuple[float | None, float]]:
    """Seconds, where they were taken, and PSNR of every peer on the plate."""
    named = {row["what"]: row["peers"] for row in rows if row["set"] == "plate"}
    seconds = named.get("seconds", {})
    quality = named.get("PSNR, dB", {})
    others = {k: v for k, v in quality.items() if k != "without mattes"}
    return {name: (seconds.get(name), value) for name, value in others.items()}


def _rms(psnr_db: float) -> float:
    return 10 ** (-psnr_db / 20)


def write_psf_plot(row: dict[str, Any], folder: Path) -> Path | None:
    """Of one lens; None where nothing beside it was timed.

    Raises
    ------
    OutputError : The file cannot be written.
    """
    curves = curves_of(row)
    if not curves:
        return None
    return write_curves(
        curves,
        folder / f"error_against_time_{row['lens']}.png",
        time="processor seconds of the fit",
        error="relative error of the psf (hollow: 90th percentile)",
    )


def curves_of(row: dict[str, Any]) -> list[Curve]:
    """lensfit at its efforts, each peer a point, the thin lens a level."""
    beside = row["beside"]
    efforts, peers = beside.get("efforts", {}), beside.get("peers", {})
    curves = []
    if efforts:
        curves.append(_psf_curve("lensfit", list(efforts.values()), tuple(efforts)))
    curves += [_psf_curve(name, [one]) for name, one in peers.items()]
    thin = row["figures"]["thin_lens"]["psf"]
    if curves and thin:
        curves.append(Curve("thin lens", [thin["all"]["median"]], []))
    return curves


def _psf_curve(
    name: str, runs: list[dict[str, Any]], labels: tuple[str, ...] = ()
) -> Curve:
    psf = [run["psf"]["all"] for run in runs]
    medians, worse = ([one[part] for one in psf] for part in ("median", "p90"))
    return Curve(
        name, medians, [run["cpu_seconds"] for run in runs], labels, tuple(worse)
    )
