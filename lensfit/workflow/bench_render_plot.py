"""Error against time of renderers, as a picture: every method a curve or a point.

Both axes are logarithmic. The error is the root mean square against the path-traced
reference, display-clipped; what is left at any price is the plate's own (a pinhole
picture does not show what stands behind things).
"""

import io
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from lensfit.atomic import write_bytes_atomic

PICTURE = "error_against_time.png"


def write_plot(result: dict[str, Any], folder: Path) -> Path:
    """Draw the curves of `bench_render` on the plate, and its peers.

    Raises
    ------
    OutputError : The file cannot be written.
    """
    points = result["curves"]["plate"]
    peers = peers_of(result["rows"])
    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    axes = figure.add_subplot(xscale="log", yscale="log")
    seconds = [point["seconds"] for point in points]
    axes.plot(seconds, [_rms(p["psnr_db"]) for p in points], "o-", label="lensfit")
    for point in points:
        place = (point["seconds"], _rms(point["psnr_db"]))
        axes.annotate(f" {point['tolerance']:g}", place, fontsize=7)
    for name, (spent, psnr_db) in peers.items():
        if spent is None:
            axes.axhline(_rms(psnr_db), color="0.6", lw=1)
            axes.annotate(name, (min(seconds), _rms(psnr_db)), fontsize=8, color="0.4")
        else:
            axes.plot([spent], [_rms(psnr_db)], "s", label=name)
    axes.set_xlabel("seconds")
    axes.set_ylabel("rms error against the path-traced reference")
    axes.grid(True, which="both", lw=0.3)
    axes.legend(fontsize=8)
    drawn = io.BytesIO()
    figure.savefig(drawn, format="png", dpi=150)
    path = folder / PICTURE
    write_bytes_atomic(path, drawn.getvalue())
    return path


def peers_of(rows: list[dict[str, Any]]) -> dict[str, tuple[float | None, float]]:
    """Seconds, where they were taken, and PSNR of every peer on the plate."""
    named = {row["what"]: row["peers"] for row in rows if row["set"] == "plate"}
    seconds = named.get("seconds", {})
    quality = named.get("PSNR, dB", {})
    others = {k: v for k, v in quality.items() if k != "without mattes"}
    return {name: (seconds.get(name), value) for name, value in others.items()}


def _rms(psnr_db: float) -> float:
    return 10 ** (-psnr_db / 20)
