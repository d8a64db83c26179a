"""A lens on a plate, ready to blur it: what a tolerance and a plate's depths ask for.

Made once per range of depth and kept: a sequence whose camera stays pays for its
kernels with the first frame.
"""

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import jax
import numpy as np
from jaxtyping import Float, Float32, Int

from lensfit.coords import Window
from lensfit.render.blur_budget import BlurBudget
from lensfit.render.blur_setup import BlurSetup
from lensfit.render.circle import Circle, Levels
from lensfit.render.convolve import kernel_transforms
from lensfit.render.field_grid import FieldGrid
from lensfit.render.kernel_bank import RGB, KernelBank, KernelNeeds
from lensfit.render.kernel_variation import colours_differ, field_grid
from lensfit.render.tile_sides import refuse_too_wide, tiling
from lensfit.render.uv import Channel, PlateGeometry

if TYPE_CHECKING:
    from lensfit.lens import Lens

_LEVEL_GROUP = 4
_MOST_EXACT = 6
"""Levels that each get kernels of their own; more share those of a few depths."""
_EVEN = 1e-6
"""Growth of levels that are all of one width."""
_LEAST_STEP_PX, _STEPS_PER_OCTAVE = 0.01, 16
_PROBED = 7
"""Levels at which a probe looks."""
_FINE = 8
"""Kernels are made for multiples of this part of a level, so that frames share them."""


@dataclass(eq=False)
class Defocus:
    """A lens on a plate, ready to blur it; keeps the kernels it has made.

    Attributes
    ----------
    lens : At the camera state of the plate.
    geometry : How the plate lies on the sensor.
    tolerance : Accepted error of the picture, display-referred.
    depth_levels : Levels that a plate's depth is cut into, evenly in blur; None leaves
        it to the tolerance.
    step_px : Between levels that are even.
    """

    lens: "Lens"
    geometry: PlateGeometry
    tolerance: float
    depth_levels: int | None = None
    step_px: float | None = None
    _kept: dict = field(default_factory=dict)

    def over(self, radius_px: Float32[np.ndarray, "*shape"]) -> "Defocus":
        """Itself, or with levels that cut this range of blur into as many as wanted.

        Steps are rounded up a little, so that frames which differ little share kernels.
        """
        if self.depth_levels is None:
            return self
        span = float(radius_px.max()) - float(radius_px.min())
        least = max(span / (self.depth_levels - 1), _LEAST_STEP_PX)
        step = 2 ** (
            math.ceil(_STEPS_PER_OCTAVE * math.log2(least)) / _STEPS_PER_OCTAVE
        )
        key = ("even", step)
        if key not in self._kept:
            self._kept[key] = replace(self, depth_levels=None, step_px=step, _kept={})
        return self._kept[key]

    @cached_property
    def budget(self) -> BlurBudget:
        return BlurBudget.of(self.tolerance)

    @cached_property
    def circle(self) -> Circle:
        return Circle.of(self.lens, self.geometry)

    @cached_property
    def levels(self) -> Levels:
        if self.step_px is not None:
            return Levels(self.step_px, _EVEN)
        return Levels(self.budget.step_px, self.budget.growth)

    @cached_property
    def bank(self) -> KernelBank:
        needs = KernelNeeds(self.budget.kernel_error, self.budget.lost)
        return KernelBank(self.lens, self.geometry, self.circle, self.levels, needs)

    def setup(self, window: Window, found: dict[int, float]) -> BlurSetup:
        """Kernels of levels over a window.

        Parameters
        ----------
        found : Levels that occur, far to near, and where within each its pixels lie.

        Raises
        ------
        LensfitError : A kernel is too wide to convolve.
        """
        levels = list(found)
        grid, chromatic = self.variation(window, levels)
        channels: tuple[Channel, ...] = RGB if chromatic else ("g",)
        at = {n: round(_FINE * found[n]) / _FINE for n in levels}
        mixed = len(levels) > _MOST_EXACT
        kernels = {
            n: self.bank.kernels(at[n], grid, channels, mixed=mixed) for n in levels
        }
        reaches = {n: k.shape[-1] // 2 for n, k in kernels.items()}
        blurred = [n for n in levels if _leaves(kernels[n]) > self.budget.unseen]
        tile, rooms = tiling(grid, {n: reaches[n] for n in blurred})
        transforms = {
            n: self._transforms((at[n], grid, channels, rooms[n], mixed), kernels[n])
            for n in blurred
        }
        return BlurSetup(
            levels,
            grid,
            chromatic,
            transforms,
            rooms,
            tile,
            reaches,
            self.budget.light_step_px,
            mixed,
        )

    def probe(self, window: Window, found: dict[int, float]) -> BlurSetup:
        """What `setup` would come to, without transforms, from few of its kernels: at
        the middle and in the corners of the window, for a few levels, and by
        interpolation between them.

        Parameters and errors are those of `setup`.
        """
        levels = list(found)
        grid, chromatic = self.variation(window, levels)
        channels: tuple[Channel, ...] = RGB if chromatic else ("g",)
        reach, leaving = self._probed(window, levels, channels)
        reaches = dict(zip(levels, reach.tolist(), strict=True))
        seen = (leaving > self.budget.unseen).tolist()
        blurred = {
            n: reaches[n] for n, is_seen in zip(levels, seen, strict=True) if is_seen
        }
        tile, rooms = tiling(grid, blurred)
        mixed = len(levels) > _MOST_EXACT
        step_px = self.budget.light_step_px
        return BlurSetup(
            levels, grid, chromatic, {}, rooms, tile, reaches, step_px, mixed
        )

    def _probed(
        self, window: Window, levels: list[int], channels: tuple[Channel, ...]
    ) -> tuple[Int[np.ndarray, " levels"], Float[np.ndarray, " levels"]]:
        """Reach of each level's kernels, and the share of light that they move."""
        evenly = np.linspace(min(levels), max(levels), _PROBED).round().astype(int)
        at = sorted({*evenly.tolist(), min(levels, key=abs)})
        middle, corners = FieldGrid(window, 0, 0), FieldGrid(window, 1, 1)
        kernels = [
            [self.bank.kernels(n, grid, channels) for grid in (middle, corners)]
            for n in at
        ]
        widest = [max(k.shape[-1] // 2 for k in both) for both in kernels]
        most = [max(_leaves(k) for k in both) for both in kernels]
        reach = np.ceil(np.interp(levels, at, widest)).astype(int)
        return reach, np.interp(levels, at, most)

    def variation(self, window: Window, levels: list[int]) -> tuple[FieldGrid, bool]:
        """How the kernels vary over a window: their grid, and whether by colour.

        Raises
        ------
        LensfitError : A kernel is too wide to convolve.
        """
        # Kernels of a distance near zero would fill any memory.
        widest = max(abs(self.levels.radius_px(n)) for n in levels)
        refuse_too_wide(widest)
        near = min(levels, key=abs)
        ends = [
            _LEVEL_GROUP * math.floor(min(levels) / _LEVEL_GROUP),
            _LEVEL_GROUP * math.ceil(max(levels) / _LEVEL_GROUP),
            0 if abs(near) <= _LEVEL_GROUP else near,
        ]
        key = (window, *ends)
        if key not in self._kept:
            self._kept[key] = (
                field_grid(self.bank, window, ends),
                colours_differ(self.bank, window, ends),
            )
        return self._kept[key]

    def _transforms(self, key: tuple, kernels: np.ndarray) -> jax.Array:
        """Kept by level, grid, channels, room and whether they were mixed."""
        if key not in self._kept:
            self._kept[key] = kernel_transforms(kernels, room=key[3])
        return self._kept[key]


def _leaves(kernels: np.ndarray) -> float:
    """Largest share of light that leaves its pixel."""
    middle = kernels.shape[-1] // 2
    return float(1 - kernels[..., middle, middle].min())
