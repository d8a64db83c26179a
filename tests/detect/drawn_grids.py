"""Photographs of line grids and checkerboards drawn by exact means, with their truth.

The lattice coordinates of a pixel position are a closed formula (rotation, perspective
and radial terms). Every pixel is cut into small squares in which that formula is as
good as linear, and the part of a small square on one side of a straight edge is a
closed formula too. Only the truth, where a lattice point lands, is found by Newton's
method.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter

from lensfit.photograph import Photograph

CUTS = 3
"""Small squares along each side of a pixel."""

Paint = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Mean reflectance of small squares, by lattice coordinates and their gradients."""


@dataclass(frozen=True)
class View:
    """How a target appears: lattice coordinates as a formula of pixel positions."""

    size_px: tuple[int, int] = (300, 240)
    pitch_px: float = 34.0
    rotation_rad: float = 0.05
    radial: float = 0.12
    perspective: tuple[float, float] = (0.08, -0.05)
    offset_px: tuple[float, float] = (3.3, -5.7)

    def lattice(self, points_px: np.ndarray) -> np.ndarray:
        """Lattice coordinates of positions in pixels."""
        size = np.asarray(self.size_px, float)
        q = (np.asarray(points_px, float) - size / 2 - self.offset_px) / (size[0] / 2)
        q = q * (1 + self.radial * (q**2).sum(-1, keepdims=True))
        c, s = np.cos(self.rotation_rad), np.sin(self.rotation_rad)
        q = q @ np.array([[c, -s], [s, c]])
        q = q / (1 + q @ np.asarray(self.perspective)[:, None])
        return q * (size[0] / 2 / self.pitch_px)

    def pixels(self, lattice: np.ndarray, start: np.ndarray) -> np.ndarray:
        """Positions in pixels of lattice coordinates, by Newton's method."""
        p = np.asarray(start, float)
        for _ in range(8):
            f = self.lattice(p) - lattice
            jx, jy = (
                (self.lattice(p + h) - self.lattice(p - h)) / 2e-4
                for h in 1e-4 * np.eye(2)
            )
            step = np.linalg.solve(np.stack([jx, jy], -1), f[..., None])[..., 0]
            p = p - step
        return p

    def shifted(self, dx: float, dy: float) -> "View":
        """The same view displaced by some pixels."""
        offset = (self.offset_px[0] + dx, self.offset_px[1] + dy)
        return replace(self, offset_px=offset)


def part_below(value: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """Part of a unit square, where a linear function has that mean value, below 0."""
    a, b = np.maximum(np.abs(np.moveaxis(gradient, -1, 0)), 1e-5)
    t = (a + b) / 2 - value

    def ramp(u: np.ndarray) -> np.ndarray:
        return np.maximum(u, 0) ** 2

    part = (ramp(t) - ramp(t - a) - ramp(t - b) + ramp(t - a - b)) / (2 * a * b)
    return np.clip(part, 0, 1)


def line_grid(width: float) -> Paint:
    """1 on lines of the given width in pitches, 0 between."""

    def paint(lattice: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        away = lattice - np.round(lattice)
        covered = part_below(away - width / 2, gradient)
        covered -= part_below(away + width / 2, gradient)
        return 1 - (1 - covered).prod(-1)

    return paint


def checkerboard(columns: int, rows: int) -> Paint:
    """Black squares on white with columns x rows inner corners about the middle."""

    def paint(lattice: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        place = lattice + (np.array([columns, rows]) - 1) / 2
        edge = np.round(place)
        odd = np.where(edge % 2 == 0, 1, -1)
        wave = odd * (1 - 2 * part_below(place - edge, gradient))
        far = np.array([columns, rows])
        inside = part_below(-1 - place, gradient) * part_below(place - far, gradient)
        return 1 - inside.prod(-1) * (1 + wave.prod(-1)) / 2

    return paint


def draw(
    view: View,
    paint: Paint,
    *,
    dark: float = 0.02,
    light: float = 0.8,
    blur_px: float = 0.0,
    noise: float = 0.0,
    shade: Callable[[np.ndarray], np.ndarray] | None = None,
    seed: int = 0,
) -> np.ndarray:
    """Pixel means of the target, blurred, shaded and noisy: height x width."""
    width, height = view.size_px
    x, y = np.meshgrid(*((np.arange(n * CUTS) + 0.5) / CUTS for n in view.size_px))
    lattice = view.lattice(np.stack([x, y], -1))
    gradient = np.stack(
        [np.gradient(lattice, axis=1), np.gradient(lattice, axis=0)], -1
    )
    fine = dark + (light - dark) * paint(lattice, gradient)
    if blur_px:
        fine = gaussian_filter(fine, blur_px * CUTS, mode="nearest")
    image = fine.reshape(height, CUTS, width, CUTS).mean((1, 3))
    if shade is not None:
        x, y = np.meshgrid(np.arange(width), np.arange(height))
        image = image * shade(np.stack([x + 0.5, y + 0.5], -1) / view.size_px)
    return image + noise * np.random.default_rng(seed).normal(size=image.shape)


def photograph(*channels: np.ndarray, saturation: float = np.inf) -> Photograph:
    """A record around one or three drawn channels."""
    pixels = np.stack(channels, -1).astype(np.float32)
    return Photograph(pixels, Path("drawn.exr"), "", saturation=saturation)
