"""Curves of benchmarks of renderer and warp as tables."""

from typing import Any

from rich.table import Table

_TITLES = {
    "plate": "error against time, path-traced plate",
    "uhd": "error against time, synthetic frame of 3840 x 2160",
    "pixels": "time against pixels",
    "blur": "time against the area of the blur",
    "warp": "warp, four channels",
}
_NAMES = {
    "tolerance": "tolerance",
    "expected": "expected rms",
    "rms": "rms error",
    "psnr_db": "PSNR, dB",
    "seconds": "s",
    "cpu_seconds": "processor s",
    "seconds_per_megapixel": "s per megapixel",
    "megapixels": "megapixels",
    "blur_area_px": "blur, px",
    "size": "frame",
    "method": "method",
    "first_s": "first, s",
    "spread_s": "spread, s",
}


def curve_tables(curves: dict[str, list[dict[str, Any]]]) -> list[Table]:
    """One for each curve."""
    return [_table(_TITLES[name], points) for name, points in curves.items()]


def _table(title: str, points: list[dict[str, Any]]) -> Table:
    table = Table(
        box=None,
        pad_edge=False,
        header_style="bold",
        title=title,
        title_justify="left",
    )
    keys = list(points[0])
    for key in keys:
        table.add_column(_NAMES[key], justify="right")
    for point in points:
        table.add_row(*(_shown(point[key]) for key in keys))
    return table


def _shown(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.3g}"
