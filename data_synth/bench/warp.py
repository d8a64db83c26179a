"""The warp beside those that a user would pick: error and time on the same pixels.

The picture is a sum of plane waves, so that its exact value is known wherever a map
reads it; their spectrum is that of a picture blurred by a lens. The map bends as a
lens does. Every method reads float32 and writes float32, the picture's border left out.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, get_args

import cv2
import numpy as np
from jaxtyping import Float

from data_synth.bench.plot import Curve, write_curves
from data_synth.bench.result import Row, as_tables, bench_result, machine
from data_synth.bench.times import best, timed
from lensfit.coords import Window
from lensfit.progress import Progress, silent
from lensfit.rendering.buffers import aligned_empty
from lensfit.rendering.filters import Filter
from lensfit.rendering.uv import SourceMap
from lensfit.rendering.warp import warp

PICTURE = "error_against_time_warp.png"
SIZES = {"HD": (1920, 1080), "UHD": (3840, 2160)}
_WAVES = 32
_CUT_OFF = 0.2
"""Cycles per pixel at which the spectrum has fallen to 1/e."""
_RUNS = 5
_BORDER_PX = 16
_PEER, _OWN = "cv2.remap cubic", "lensfit cubic"
_MOST = 1.3


class WarpTask(NamedTuple):
    """A picture, where it is read, and what is there exactly."""

    pixels: Float[np.ndarray, "height width 4"]
    moved_px: Float[np.ndarray, "2 height width"]
    exact: Float[np.ndarray, "height width"]

    @property
    def at_px(self) -> tuple[np.ndarray, np.ndarray]:
        """Column and row to read, whole numbers at pixel centres."""
        height, width = self.exact.shape
        y, x = np.mgrid[:height, :width].astype(np.float32)
        return x + self.moved_px[0], y + self.moved_px[1]


def warp_task(width: int, height: int, seed: int = 0) -> WarpTask:
    """A picture of four channels that share their waves, and a bending map."""
    rng = np.random.default_rng(seed)
    frequency = rng.normal(0, _CUT_OFF / np.sqrt(2), (_WAVES, 2))
    phase = rng.uniform(0, 2 * np.pi, _WAVES)

    def value(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        found = np.full(x.shape, 0.5)
        for (fx, fy), start in zip(frequency, phase, strict=True):
            found += 0.3 / _WAVES * np.cos(2 * np.pi * (fx * x + fy * y) + start)
        return found

    y, x = np.mgrid[:height, :width].astype(float)
    u, v = (x - width / 2) / width, (y - height / 2) / width
    bend = 0.04 * (u * u + v * v)
    moved = aligned_empty((2, height, width))
    moved[0], moved[1] = bend * u * width, bend * v * width
    pixels = aligned_empty((height, width, 4))
    pixels[:] = value(x, y)[..., None]
    return WarpTask(pixels, moved, value(x + moved[0], y + moved[1]))


def bench_warp(
    out_dir: str | Path | None = None,
    *,
    quick: bool = False,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Measure every method at every size.

    Parameters
    ----------
    out_dir : Folder for bench_warp.json and error_against_time_warp.png.
    quick : The small size only.

    Returns
    -------
    "rows" with bars, "curves" with a point for each size and method (median and spread
    of the seconds, rms error), "machine".

    Raises
    ------
    LensfitError : The results cannot be written.
    """
    on = machine()
    sizes = {"HD": SIZES["HD"]} if quick else SIZES
    points, rows = [], []
    for done, (name, (width, height)) in enumerate(sizes.items()):
        progress("warp", done, len(sizes))
        task = warp_task(width, height)
        measured = {
            method: _measured(run, task) for method, run in _methods(task).items()
        }
        points += [{"size": name, "method": m} | p for m, p in measured.items()]
        rows += _rows(name, measured)
    progress("warp", len(sizes), len(sizes))
    curves = {"warp": points}
    if out_dir is not None:
        _write_plot(points, Path(out_dir) / PICTURE)
    return bench_result("warp", on, out_dir, rows=as_tables(rows), curves=curves)


def warp_row(width: int, height: int) -> Row:
    """Seconds of one warp over those of `cv2.remap`, cubic, on the same pixels."""
    methods = _methods(warp_task(width, height))
    _, theirs, _ = best(methods[_PEER])
    methods[_OWN]()
    _, ours, _ = best(methods[_OWN])
    peers = {"lensfit, s": ours, "cv2.remap, s": theirs}
    return Row(
        "uhd", "warp, times cv2.remap cubic", ours / theirs, bar=_MOST, peers=peers
    )


def _write_plot(points: list[dict[str, Any]], path: Path) -> None:
    """A curve for every method, a point for each size of the picture."""
    curves = []
    for method in dict.fromkeys(point["method"] for point in points):
        mine = [point for point in points if point["method"] == method]
        curves.append(
            Curve(
                method,
                [point["rms"] for point in mine],
                [point["seconds"] for point in mine],
                tuple(point["size"] for point in mine),
            )
        )
    write_curves(curves, path, time="seconds", error="rms error, radiance about .5")


def _rows(size: str, measured: dict[str, dict[str, float]]) -> list[Row]:
    own, peer = measured[_OWN], measured[_PEER]
    ratio = own["seconds"] / peer["seconds"]
    seconds = {f"{name}, s": point["seconds"] for name, point in measured.items()}
    errors = {name: point["rms"] for name, point in measured.items()}
    return [
        Row(size, "warp, times cv2.remap cubic", ratio, bar=_MOST, peers=seconds),
        Row(size, "warp, rms error", own["rms"], peers=errors),
    ]


def _measured(run: Callable[[], np.ndarray], task: WarpTask) -> dict[str, float]:
    """Median and spread of the wall seconds once warm, and the error."""
    found, times = timed(run, 1 + _RUNS)
    inside = (slice(_BORDER_PX, -_BORDER_PX),) * 2
    away = found[..., 0][inside] - task.exact[inside]
    return {
        "first_s": times.first_s,
        "seconds": times.steady_s,
        "spread_s": times.spread_s,
        "rms": float(np.sqrt(np.mean(away**2))),
    }


def _methods(task: WarpTask) -> dict[str, Callable[[], np.ndarray]]:
    """Those that are installed, by name."""
    from scipy.ndimage import map_coordinates
    from skimage.transform import warp as warp_skimage

    height, width = task.exact.shape
    window = Window.of_size(width, height)
    source = SourceMap(window, task.moved_px)
    x, y = task.at_px

    def own(method: Any) -> Callable[[], np.ndarray]:
        return lambda: warp(task.pixels, window, source, method=method, alpha_channel=3)

    def opencv(flag: int) -> Callable[[], np.ndarray]:
        border = cv2.BORDER_CONSTANT
        return lambda: cv2.remap(task.pixels, x, y, flag, borderMode=border)

    def scipy_spline() -> np.ndarray:
        planes = np.moveaxis(task.pixels, -1, 0)
        each = [map_coordinates(plane, (y, x), order=3) for plane in planes]
        return np.stack(each, -1)

    methods = {f"lensfit {name}": own(name) for name in get_args(Filter)}
    methods |= {
        _PEER: opencv(cv2.INTER_CUBIC),
        "cv2.remap Lanczos": opencv(cv2.INTER_LANCZOS4),
        "skimage cubic": lambda: _by_channel(task.pixels, y, x, warp_skimage),
        "scipy spline": scipy_spline,
    }
    return methods | _openimageio(task)


def _by_channel(
    pixels: np.ndarray, y: np.ndarray, x: np.ndarray, warp_one: Any
) -> np.ndarray:
    """scikit-image warps colour by a map of three coordinates, one channel by two."""
    places = np.stack([y, x])
    planes = np.moveaxis(pixels, -1, 0)
    return np.stack([warp_one(p, places, order=3) for p in planes], -1)


def _openimageio(task: WarpTask) -> dict[str, Callable[[], np.ndarray]]:
    """Its st_warp, where it is installed."""
    try:
        import OpenImageIO as oiio  # pyright: ignore[reportMissingImports]
    except ImportError:
        return {}
    height, width = task.exact.shape
    x, y = task.at_px
    st = np.stack([(x + 0.5) / width, (y + 0.5) / height], -1).astype(np.float32)

    def buffer(pixels: np.ndarray) -> Any:
        spec = oiio.ImageSpec(width, height, pixels.shape[2], oiio.FLOAT)
        made = oiio.ImageBuf(spec)
        made.set_pixels(oiio.ROI(), np.ascontiguousarray(pixels))
        return made

    source, places = buffer(task.pixels), buffer(st)

    def run() -> np.ndarray:
        made = oiio.ImageBufAlgo.st_warp(source, places, "cubic")
        return made.get_pixels(oiio.FLOAT)

    return {"OpenImageIO cubic": run}
