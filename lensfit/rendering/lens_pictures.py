"""Pictures of a lens itself: the dot grid it would photograph, and its kernels.

Both are drawn from `Lens.psfs` (to 4 %), at the pixels of a plate, without the
renderer's approximations. Dots are points of light; their positions are exact to an
eighth of a pixel, since kernels are drawn four times finer and laid down in quarters.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float, Float32

from lensfit.coords import Window
from lensfit.rendering.uv import PlateGeometry

if TYPE_CHECKING:
    from lensfit.lens import Lens

DOTS_ACROSS = 16
"""Dots along the width of the frame."""
DOT_AREA_PX = 7.0
"""Light of a dot, in pixels of radiance one: a disc three pixels wide."""
FIELD_GRID = (9, 5)
_FINER = 4
_SIZES_PX = (17, 33, 65, 129, 257)
_BATCH = 16
_MOST_AT_BORDER = 0.01
"""Of the light; an array sums to 1 whatever falls beside it."""
_TOLERANCE = 0.04


class KernelMosaic(NamedTuple):
    """Kernels over the frame, side by side.

    Attributes
    ----------
    rgb : One tile for each field point, laid out as the points lie in the frame.
    tile_px : Rows and columns of a tile.
    """

    rgb: Float32[np.ndarray, "height width 3"]
    tile_px: int


def aberration_dots(
    lens: "Lens", geometry: PlateGeometry, window: Window, object_distance_mm: float
) -> Float32[np.ndarray, "height width 3"]:
    """The dot grid as the lens would photograph it.

    Parameters
    ----------
    lens : At its camera state.
    geometry : How the plate lies on the sensor.
    window : Pixels wanted.
    object_distance_mm : Of the flat chart, from the sensor plane.

    Raises
    ------
    LensfitError : The chart is nearer than the lens has an image of it, or nobody
        knows the f-number of a lens whose blur was not measured.
    """
    pitch = geometry.size_px[0] / DOTS_ACROSS
    centre = np.array(geometry.display_window[:2]) + np.array(geometry.size_px) / 2
    reach = [int(np.ceil(n / pitch)) for n in (window.width, window.height)]
    index = np.stack(np.meshgrid(*(np.arange(-n, n + 1) for n in reach)), -1).reshape(
        -1, 2
    )
    landed = geometry.distorted(lens, "g")(centre + index * pitch)
    low, size = np.array(window[:2]), np.array([window.width, window.height])
    inside = ((landed > low) & (landed < low + size)).all(-1)
    landed = landed[inside]
    kernel_px = _size_px(lens, geometry, object_distance_mm)
    margin = kernel_px // 2 + 1
    canvas = np.zeros((window.height + 2 * margin, window.width + 2 * margin, 3))
    for first in range(0, len(landed), _BATCH):
        points = landed[first : first + _BATCH]
        finer = _psfs(
            lens,
            geometry,
            points,
            object_distance_mm,
            _FINER * kernel_px,
            _FINER,
        )
        light = _light(lens, geometry, points)
        for point, kernel, gain in zip(
            points - low + margin, finer, light, strict=True
        ):
            _lay_down(canvas, point, kernel * (gain * DOT_AREA_PX)[:, None, None])
    return canvas[margin:-margin, margin:-margin].astype(np.float32)


def kernel_mosaic(
    lens: "Lens", geometry: PlateGeometry, object_distance_mm: float
) -> KernelMosaic:
    """The lens' kernels of one object distance over a grid of field points.

    Each tile holds the light of a point at the plate's pixels: green sums to 1.

    Raises
    ------
    LensfitError : As for `aberration_dots`.
    """
    display, (columns, rows) = geometry.display_window, FIELD_GRID
    x = display.x_min + (np.arange(columns) + 0.5) / columns * display.width
    y = display.y_min + (np.arange(rows) + 0.5) / rows * display.height
    points = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
    size = _size_px(lens, geometry, object_distance_mm)
    kernels = np.concatenate(
        [
            _psfs(lens, geometry, points[at : at + _BATCH], object_distance_mm, size, 1)
            for at in range(0, len(points), _BATCH)
        ]
    )
    tiles = kernels.reshape(rows, columns, 3, size, size).transpose(0, 3, 1, 4, 2)
    rgb = tiles.reshape(rows * size, columns * size, 3).astype(np.float32)
    return KernelMosaic(rgb, size)


def _psfs(
    lens: "Lens",
    geometry: PlateGeometry,
    points_px: np.ndarray,
    object_distance_mm: float,
    size_px: int,
    finer: int,
) -> Float[np.ndarray, "points 3 size size"]:
    pitch_mm = geometry.area_mm[0] / geometry.size_px[0] / finer
    padded = np.concatenate(
        [points_px, np.repeat(points_px[-1:], _BATCH - len(points_px), 0)]
    )
    kernels = lens.psfs(
        geometry.mm(padded),
        object_distance_mm,
        pixel_pitch_mm=pitch_mm,
        size_px=size_px,
        tolerance=_TOLERANCE,
    )
    return np.asarray(kernels)[: len(points_px)]


def _size_px(lens: "Lens", geometry: PlateGeometry, object_distance_mm: float) -> int:
    """Odd size of an array that holds the light of a point anywhere in the frame."""
    display = geometry.display_window
    low, size = np.array(display[:2]), np.array(geometry.size_px)
    points = low + size * np.array([[0.5, 0.5], [0.5, 0], [0, 0.5], [0, 0], [1, 1]])
    for wanted in _SIZES_PX:
        kernels = _psfs(lens, geometry, points, object_distance_mm, wanted, 1)
        border = 1 - kernels[..., 1:-1, 1:-1].sum((2, 3))
        if (border < _MOST_AT_BORDER).all():
            break
    return wanted


def _light(
    lens: "Lens", geometry: PlateGeometry, points_px: np.ndarray
) -> Float[np.ndarray, "points 3"]:
    points = geometry.mm(points_px)
    gains = [np.asarray(lens.relative_illumination(points, c)) for c in "rgb"]  # pyright: ignore[reportArgumentType]
    return np.nan_to_num(np.stack(gains, -1))


def _lay_down(
    canvas: np.ndarray, point_px: np.ndarray, kernel: Float[np.ndarray, "3 size size"]
) -> None:
    """Add a kernel whose middle is at a point; its finer pixels fall whole into those
    of the canvas."""
    start = np.rint(point_px * _FINER).astype(int) - kernel.shape[1] // 2
    pixel, finer = np.divmod(start, _FINER)
    x_pad, y_pad = ((f, -(kernel.shape[1] + f) % _FINER) for f in finer)
    padded = np.pad(kernel, ((0, 0), y_pad, x_pad))
    count = padded.shape[1] // _FINER, padded.shape[2] // _FINER
    coarse = padded.reshape(3, count[0], _FINER, count[1], _FINER).sum((2, 4))
    y, x = pixel[1], pixel[0]
    y0, x0 = max(y, 0), max(x, 0)
    y1 = min(y + count[0], canvas.shape[0])
    x1 = min(x + count[1], canvas.shape[1])
    canvas[y0:y1, x0:x1] += coarse[:, y0 - y : y1 - y, x0 - x : x1 - x].transpose(
        1, 2, 0
    )
