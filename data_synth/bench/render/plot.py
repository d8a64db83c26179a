"""Error against time of renderers, as a picture: every method a curve or a point.

The error is the root mean square against the path-traced reference, display-clipped;
what is left at any price is the plate's own (a pinhole picture does not show what
stands behind things).
"""

from pathlib import Path
from typing import Any

from data_synth.bench.plot import Curve, write_curves

PICTURE = "error_against_time.png"


def write_plot(result: dict[str, Any], folder: Path) -> Path:
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
    return write_curves(curves, folder / PICTURE, time="seconds", error=error)


def peers_of(rows: list[dict[str, Any]]) -> dict[str, tuple[float | None, float]]:
    """Seconds, where they were taken, and PSNR of every peer on the plate."""
    named = {row["what"]: row["peers"] for row in rows if row["set"] == "plate"}
    seconds = named.get("seconds", {})
    quality = named.get("PSNR, dB", {})
    others = {k: v for k, v in quality.items() if k != "without mattes"}
    return {name: (seconds.get(name), value) for name, value in others.items()}


def _rms(psnr_db: float) -> float:
    return 10 ** (-psnr_db / 20)
