"""Photographs of charts drawn by area coverage, with a blur that is known."""

from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from lensfit.photograph import Photograph

SIZE_PX = (800, 600)
PITCH_PX = 36.0


def dot_centres(scale: float = 1.0, pitch_px: float = PITCH_PX) -> np.ndarray:
    """Of a square lattice about the middle of the frame, `scale` times as large."""
    width, height = SIZE_PX
    across, down = width / 2 / pitch_px, height / 2 / pitch_px
    i, j = np.meshgrid(
        np.arange(-np.floor(across) - 1, across + 2),
        np.arange(-np.floor(down) - 1, down + 2),
    )
    centres = scale * pitch_px * np.stack([i.ravel(), j.ravel()], 1)
    centres = centres + np.array(SIZE_PX) / 2 + [0.31, 0.17]
    inside = ((centres > 8) & (centres < np.array(SIZE_PX) - 8)).all(1)
    return centres[inside]


def dots(
    centres: np.ndarray,
    diameter_px: float,
    covariance_px2: np.ndarray,
    *,
    dark: bool = False,
    kernel: np.ndarray | None = None,
) -> np.ndarray:
    """Discs blurred by a Gaussian of this covariance, or by a kernel; fine then binned.

    Each disc is convolved at its own place, so no interpolation blurs besides.
    """
    fine = 4
    width, height = SIZE_PX
    sharp = np.zeros((height * fine, width * fine), np.float32)
    radius = diameter_px * fine / 2
    reach = int(np.ceil(radius)) + 2
    for x, y in centres * fine:
        x0, y0 = int(x) - reach, int(y) - reach
        row, column = np.mgrid[y0 : y0 + 2 * reach + 1, x0 : x0 + 2 * reach + 1]
        away = np.hypot(column + 0.5 - x, row + 0.5 - y)
        cover = np.clip(radius - away + 0.5, 0, 1)
        sharp[y0 : y0 + 2 * reach + 1, x0 : x0 + 2 * reach + 1] += cover
    return finished(sharp, fine, covariance_px2, dark=dark, kernel=kernel)


def finished(
    sharp: np.ndarray,
    fine: int,
    covariance_px2: np.ndarray,
    *,
    dark: bool = False,
    kernel: np.ndarray | None = None,
) -> np.ndarray:
    """A fine picture, blurred, binned to pixels, in the tones of a chart."""
    kernel = (
        gaussian(np.asarray(covariance_px2) * fine**2) if kernel is None else kernel
    )
    blurred = cv2.filter2D(sharp, -1, kernel, borderType=cv2.BORDER_REPLICATE)
    binned = cv2.resize(blurred, SIZE_PX, interpolation=cv2.INTER_AREA)
    return 0.8 - 0.7 * binned if dark else 0.01 + 0.6 * binned


def gaussian(covariance: np.ndarray) -> np.ndarray:
    """A kernel of these second moments, in samples."""
    half = int(np.ceil(5 * np.sqrt(np.linalg.eigvalsh(covariance)[-1]))) + 1
    y, x = np.mgrid[-half : half + 1, -half : half + 1]
    inverse = np.linalg.inv(covariance)
    power = inverse[0, 0] * x * x + 2 * inverse[0, 1] * x * y + inverse[1, 1] * y * y
    weight = np.exp(-power / 2)
    return (weight / weight.sum()).astype(np.float32)


def moved(kernel: np.ndarray, length: float, angle_deg: float) -> np.ndarray:
    """A kernel besides smeared along a line, both in samples."""
    steps = np.linspace(-0.5, 0.5, 41) * length
    pad = int(np.ceil(length / 2)) + 1
    wide = np.pad(kernel, pad)
    way = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    total = np.zeros_like(wide)
    for step in steps:
        shift = np.array([[1, 0, step * way[0]], [0, 1, step * way[1]]])
        total += cv2.warpAffine(wide, shift, wide.shape[::-1])
    return total / total.sum()


def noisy(picture: np.ndarray, seed: int = 0, deviation: float = 5e-4) -> np.ndarray:
    """With read noise."""
    rng = np.random.default_rng(seed)
    return picture + rng.normal(0, deviation, picture.shape)


def photograph(picture: np.ndarray) -> Photograph:
    """A picture of one channel, that clips at 1."""
    pixels = np.minimum(noisy(picture), 1.0).astype(np.float32)[..., None]
    return Photograph(pixels, Path("drawn.tif"), sha256="", saturation=1.0)


def write_linear(path: Path, picture: np.ndarray, seed: int = 0) -> None:
    """A 16-bit picture of linear codes."""
    codes = np.clip(np.round(65535 * noisy(picture, seed)), 0, 65535)
    Image.fromarray(codes.astype(np.uint16)).save(path)
