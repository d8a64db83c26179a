"""The lens' own kernels for a plate: over the frame, over depth, made once and kept.

Kernels stand at the nodes of a grid over the frame (`lensfit.render.kernel_variation`
says how fine) and, for many levels of depth, are mixed from those of a few.
"""

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Float32

from lensfit.render.circle import Circle, Levels
from lensfit.render.disc import diffracts, disc_kernel
from lensfit.render.field_grid import FieldGrid
from lensfit.render.stop_shape import StopShape
from lensfit.render.uv import Channel, PlateGeometry

if TYPE_CHECKING:
    from lensfit.lens import Lens

RGB: tuple[Channel, ...] = ("r", "g", "b")
_LARGEST_HALF_PX = 600
_LEAST_RAY_ERROR = 0.004
_ANCHOR_STEP, _ANCHOR_GROWTH = 12.0, 2.2
"""Step (px) and growth of the anchors per relative error of a kernel."""
_PROBES = 8
_TOGETHER = 12
"""Kernels that are asked for together, so that one program serves any number."""
_RAY_ERROR = 0.5
"""Error of a kernel's own rays, as a share of what the mixture is allowed."""


@dataclass(frozen=True)
class KernelNeeds:
    """What a tolerance asks of kernels.

    Attributes
    ----------
    error : Relative error (L2) allowed between nodes.
    lost : Share of the light that may be cut off.
    """

    error: float
    lost: float


@dataclass(eq=False)
class KernelBank:
    """Kernels of one lens on one plate, made when first asked for.

    Attributes
    ----------
    lens, geometry : Whose kernels, and how pixels lie on the sensor.
    circle, levels : What distances the levels stand for.
    needs : How good the kernels must be.
    of_lights : Kernels of highlights, kept by whoever made them.
    """

    lens: "Lens"
    geometry: PlateGeometry
    circle: Circle
    levels: Levels
    needs: KernelNeeds
    of_lights: dict = field(default_factory=dict)
    _kept: dict = field(default_factory=dict)

    @cached_property
    def is_scaled(self) -> bool:
        """Whether every kernel is one shape in another size, all over the frame."""
        blur, f_number = self.lens.blur, self.lens.f_number
        if f_number is None or not (blur is None or blur.is_ideal):
            return False
        pitch_mm = self.geometry.area_mm[0] / self.geometry.size_px[0]
        return not diffracts(f_number, pitch_mm)

    @cached_property
    def shape(self) -> StopShape | None:
        """That shape; None for a disc."""
        blur = self.lens.blur
        return None if blur is None else StopShape.of(blur)

    @property
    def is_grey(self) -> bool:
        """Whether all colours are known to have the same kernels."""
        return self.is_scaled and (self.shape is None or not self.shape.is_coloured)

    def kernels(
        self,
        level: float,
        grid: FieldGrid,
        channels: tuple[Channel, ...],
        *,
        mixed: bool = False,
    ) -> Float32[np.ndarray, "nodes channels size size"]:
        """Kernels at the nodes of a grid, as small as their light allows.

        Parameters
        ----------
        level : Of `levels`; may lie between two.
        grid : Where.
        channels : One for all ("g"), or all three.
        mixed : Mix the kernel from those of two of `anchors`, which serve many levels;
            a disc is exact all the same.
        """
        key = (round(level, 4), grid, channels, mixed)
        if key not in self._kept:
            if mixed and not self.is_scaled:
                made = self._mixed(self.levels.radius_px(level), grid, channels)
            else:
                made = _without_gaps(self.at(grid.nodes_px(), level, channels))
            self._kept[key] = trimmed(made, self.needs.lost)
        return self._kept[key]

    @cached_property
    def anchors(self) -> Levels:
        """Levels near enough to each other for their kernels to be mixed."""
        return Levels(
            _ANCHOR_STEP * self.needs.error, _ANCHOR_GROWTH * self.needs.error
        )

    def _mixed(
        self, radius_px: float, grid: FieldGrid, channels: tuple[Channel, ...]
    ) -> np.ndarray:
        place = self.anchors.between(radius_px)
        low = math.floor(place)
        both = [
            self.kernels(self.levels.between(self.anchors.radius_px(n)), grid, channels)
            for n in (low, low + 1)
        ]
        size = max(k.shape[-1] for k in both)
        first, second = (_widened(k, size) for k in both)
        return (1 - np.float32(place - low)) * first + np.float32(place - low) * second

    def at(
        self,
        points_px: Float[np.ndarray, "points 2"],
        level: Float[np.ndarray, " points"] | float,
        channels: Sequence[Channel],
        *,
        finer: int = 1,
    ) -> Float32[np.ndarray, "points channels size size"]:
        """Kernels at any points, odd in size; NaN where the lens has no image.

        Parameters
        ----------
        level : Of all points, or of each; may lie between two.
        finer : Pixels of the kernel per pixel of the plate; odd in size all the same.
        """
        each = np.broadcast_to(np.asarray(level, float), len(points_px))
        radii = [self.levels.radius_px(n) for n in each]
        widest = max(abs(r) for r in radii)
        if self.is_scaled:
            return self._scaled(radii, channels, finer)
        half = _filling(max(math.ceil((1.2 * widest + 3) * finer), 3))
        depths = np.array([self.circle.depth_mm(r) for r in radii])
        # A few outermost points say how large kernels are, before all are made.
        few = _outermost(points_px, np.abs(radii))
        found, half = self._whole(points_px[few], depths[few], channels, half, finer)
        if len(few) < len(points_px):
            found, half = self._whole(points_px, depths, channels, half, finer)
        return found

    def _scaled(
        self, radii_px: list[float], channels: Sequence[Channel], finer: int
    ) -> np.ndarray:
        """One shape at these radii."""
        widest, shape = max(abs(r) for r in radii_px), self.shape
        if shape is None:
            half = math.ceil((widest + 1) * finer)
            discs = np.stack([disc_kernel(r, half, finer) for r in radii_px])
            return np.repeat(discs[:, None], len(channels), 1)
        half = math.ceil((widest * shape.widest + 1) * finer)
        numbers = [RGB.index(c) for c in channels]
        each = [[shape.kernel(r, half, c, finer) for c in numbers] for r in radii_px]
        return np.stack([np.stack(kernels) for kernels in each])

    def _whole(
        self,
        points_px: np.ndarray,
        depth_mm: np.ndarray,
        channels: Sequence[Channel],
        half: int,
        finer: int,
    ) -> tuple[np.ndarray, int]:
        """Kernels of `half`, or so much larger that their light has room; and half."""
        while True:
            size = 2 * half + 1
            found = self._evaluated(points_px, depth_mm, channels, size, finer)
            lost = _border_light(found)
            if lost < self.needs.lost or half >= _LARGEST_HALF_PX:
                return found, half
            half = _filling(min(math.ceil(1.6 * half), _LARGEST_HALF_PX))

    def _evaluated(
        self,
        points_px: np.ndarray,
        depth_mm: np.ndarray,
        channels: Sequence[Channel],
        size: int,
        finer: int,
    ) -> np.ndarray:
        distance = depth_mm + float(self.lens.entrance_pupil_offset_mm)
        pitch = self.geometry.area_mm[0] / self.geometry.size_px[0] / finer
        points = np.column_stack([self.geometry.mm(points_px), distance])
        error = max(_RAY_ERROR * self.needs.error, _LEAST_RAY_ERROR)
        together = max(_TOGETHER // len(channels), 1)
        spare = np.tile(points[-1:], (-len(points) % together, 1))
        filled = np.concatenate([points, spare])

        def part(of: np.ndarray) -> np.ndarray:
            found = self.lens.psfs(
                of[:, :2],
                of[:, 2],
                channels,
                pixel_pitch_mm=pitch,
                size_px=size,
                tolerance=error,
                with_lateral_colour=False,  # the chief-ray maps have it
            )
            return np.asarray(found, np.float32)

        with ThreadPoolExecutor() as threads:
            made = threads.map(part, filled.reshape(-1, together, 3))
            return np.concatenate(list(made))[: len(points)]


def _filling(half: int) -> int:
    """At least this, of a few: arrays of 2^n and 3 2^n pixels are made anyhow
    (`lensfit.kernel.lens_psf`), and what is asked of them in few sizes is compiled
    seldom, also where every frame has a focus of its own."""
    size = 2 * half + 1
    octave = 1 << size.bit_length()
    room = 3 * octave // 4 if size < 3 * octave // 4 else octave
    return room // 2 - 1


def trimmed(
    kernels: Float32[np.ndarray, "nodes channels size size"], lost: float
) -> Float32[np.ndarray, "nodes channels size size"]:
    """Without the margin that holds next to nothing; sums stay 1."""
    half = kernels.shape[-1] // 2
    away = np.abs(np.arange(2 * half + 1) - half)
    ring = np.maximum(away, away[:, None])
    light = kernels.max((0, 1))
    inside = np.cumsum(np.bincount(ring.ravel(), light.ravel()))
    keep = int(np.searchsorted(inside, (1 - lost) * inside[-1]))
    cut = kernels[..., half - keep : half + keep + 1, half - keep : half + keep + 1]
    return cut / cut.sum((-2, -1), keepdims=True)


def _widened(kernels: np.ndarray, size: int) -> np.ndarray:
    margin = (size - kernels.shape[-1]) // 2
    return np.pad(kernels, ((0, 0), (0, 0), (margin, margin), (margin, margin)))


def _outermost(points_px: np.ndarray, radius_px: np.ndarray) -> np.ndarray:
    """Rows of the few points where kernels are likely to be largest; all of a few."""
    if len(points_px) <= 2 * _PROBES:
        return np.arange(len(points_px))
    away = np.linalg.norm(points_px - points_px.mean(0), axis=1)
    last = [np.argsort(value)[-_PROBES // 2 :] for value in (away, radius_px)]
    return np.unique(np.concatenate(last))


def _border_light(kernels: np.ndarray) -> float:
    """Largest share of light in the outermost ring."""
    inner = kernels[..., 1:-1, 1:-1].sum((-2, -1))
    return float(np.nanmax(1 - inner, initial=0.0))


def _without_gaps(kernels: np.ndarray) -> np.ndarray:
    """Nodes beyond what the lens images take the kernel of the nearest that has one."""
    bad = ~np.isfinite(kernels).all((1, 2, 3)) | (kernels.sum((1, 2, 3)) <= 0)
    if bad.any() and not bad.all():
        good = np.flatnonzero(~bad)
        for i in np.flatnonzero(bad):
            kernels[i] = kernels[good[np.abs(good - i).argmin()]]
    return kernels
