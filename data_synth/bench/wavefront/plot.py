"""Error of point-spread functions against the time of the fit, a picture for each lens.

Filled marks are medians over field, colour and photographed settings, hollow ones 90th
percentiles. Processor seconds, since they do not count what else the machine did.
"""

from pathlib import Path
from typing import Any

from data_synth.bench.plot import Curve, write_curves


def write_plot(row: dict[str, Any], folder: Path) -> Path | None:
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
        curves.append(_curve("lensfit", list(efforts.values()), tuple(efforts)))
    curves += [_curve(name, [one]) for name, one in peers.items()]
    thin = row["figures"]["thin_lens"]["psf"]
    if curves and thin:
        curves.append(Curve("thin lens", [thin["all"]["median"]], []))
    return curves


def _curve(
    name: str, runs: list[dict[str, Any]], labels: tuple[str, ...] = ()
) -> Curve:
    psf = [run["psf"]["all"] for run in runs]
    medians, worse = ([one[part] for one in psf] for part in ("median", "p90"))
    return Curve(
        name, medians, [run["cpu_seconds"] for run in runs], labels, tuple(worse)
    )
