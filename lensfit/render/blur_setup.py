"""What a tolerance and a plate's depths ask of the blur: levels, kernels, tiles.

Made once per range of depth and kept: a sequence whose camera stays pays for its
kernels with the first frame.
"""

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import jax
import numpy as np
from jaxtyping import Complex64, Float, Float32, Int

from lensfit.coords import Window
from lensfit.errors import LensfitError
from lensfit.render.circle import Circle, Levels
from lensfit.render.convolve import kernel_transforms
from lensfit.render.kernel_bank import (
    RGB,
    FieldGrid,
    KernelBank,
    KernelNeeds,
    colours_differ,
    field_grid,
)
from lensfit.render.uv import Channel, PlateGeometry

if TYPE_CHECKING:
    from lensfit.lens import Lens

_TILES = ((14, 64), (56, 128), (1000, 256))
"""Largest reach of a kernel, px, and the tile that goes with it."""
_LEAST_TILE = 16
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


class BlurBudget(NamedTuple):
    """What a tolerance on the picture allows each approximation of the blur.

    Attributes
    ----------
    step_px : Difference of radius between levels in focus.
    growth : The same over the radius, where that is large.
    kernel_error : Relative error (L2) of a kernel.
    lost : Share of a kernel's light that may be cut off.
    unseen : Share of light that may leave its pixel and the blur still not be run.
    light_step_px : Resolution of the radius of highlights.
    """

    step_px: float
    growth: float
    kernel_error: float
    lost: float
    unseen: float
    light_step_px: float

    @classmethod
    def of(cls, tolerance: float) -> "BlurBudget":
        """Shares of an accepted rms error of the picture, display-referred."""
        # Measured on a path-traced scene: levels `step_px` apart show as 5.6e-3 of it
        # (rms of the picture); a kernel wrong by e, on a 1/f picture, as about e / 50.
        return cls(
            step_px=float(np.clip(180 * tolerance, 0.08, 2.5)),
            growth=float(np.clip(33 * tolerance, 0.02, 0.4)),
            kernel_error=float(np.clip(50 * tolerance, 0.01, 0.3)),
            lost=float(np.clip(tolerance, 1e-5, 1e-2)),
            unseen=10 * tolerance,
            light_step_px=float(np.clip(50 * tolerance, 0.02, 0.1)),
        )


@dataclass(eq=False)
class BlurSetup:
    """Kernels and tiles for one range of depth over one window.

    Attributes
    ----------
    levels : That occur, far to near.
    grid : Nodes of the kernels.
    chromatic : Whether each channel has kernels of its own.
    transforms : Of the kernels of each level that is blurred.
    rooms : Side of the transformed tiles of each such level; sharp ones have none.
    tile : Side of the tiles that are filled.
    reaches : Half the size of each level's kernel; estimated by a probe.
    light_step_px : As in `BlurBudget`.
    is_mixed : Whether kernels were mixed from those of a few depths.
    """

    levels: list[int]
    grid: FieldGrid
    chromatic: bool
    transforms: dict[int, Complex64[jax.Array, "nodes channels room half"]]
    rooms: dict[int, int]
    tile: int
    reaches: dict[int, int]
    light_step_px: float
    is_mixed: bool

    @property
    def is_sharp(self) -> bool:
        """Whether nothing is blurred visibly."""
        return not self.rooms

    def reach_px(self, level: int) -> int:
        """How far light of a level travels."""
        return self.reaches[level] if level in self.rooms else 0

    def around(
        self, corners: Int[np.ndarray, "tiles 2"], room: int
    ) -> tuple[Int[np.ndarray, "tiles corners"], Float32[np.ndarray, "tiles 4"]]:
        """The nodes around tiles, and their cells counted from the tiles' corners.

        Parameters
        ----------
        corners : Row and column of the tiles' first pixels in the window.
        """
        grid = self.grid
        if not grid.varies:
            count = len(corners)
            return np.zeros((count, 1), np.int32), np.zeros((count, 4), np.float32)
        width, height = grid.cell_px
        middle = corners + room / 2
        column = np.clip(middle[:, 1] // width, 0, grid.columns - 1).astype(np.int32)
        row = np.clip(middle[:, 0] // height, 0, grid.rows - 1).astype(np.int32)
        first = row * (grid.columns + 1) + column
        below = first + grid.columns + 1
        nodes = np.stack([first, first + 1, below, below + 1], -1)
        left, top = column * width - corners[:, 1], row * height - corners[:, 0]
        size = np.broadcast_to([[width, height]], (len(corners), 2))
        cells = np.concatenate([np.stack([left, top], -1), size], -1)
        return nodes, cells.astype(np.float32)

    def place_of_light(
        self, centre_px: Float[np.ndarray, "2"]
    ) -> Float[np.ndarray, "2"]:
        """Where a light's kernel is taken, x and y in the pixel space of the plate.

        A kernel serves lights within an eighth of a cell, so that neighbours share it.
        """
        window = self.grid.window
        if not self.grid.varies:
            return self.grid.nodes_px()[0]
        step = np.array(self.grid.cell_px) / 4
        rounded = (np.floor(centre_px / step) + 0.5) * step
        return rounded + np.array(window[:2])


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
        tile, rooms = _tiling(grid, {n: reaches[n] for n in blurred})
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
        tile, rooms = _tiling(grid, blurred)
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
        if not widest <= _TILES[-1][0]:
            raise _too_wide(widest)
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


def _tiling(grid: FieldGrid, reaches: dict[int, int]) -> tuple[int, dict[int, int]]:
    """Side of the tiles, and their room for each level that is blurred."""
    tile = _tile_px(max(reaches.values(), default=0))
    if grid.varies:  # the weights of a cell's nodes hold in that cell
        widest = _LEAST_TILE * int(min(grid.cell_px) // _LEAST_TILE)
        tile = max(min(tile, widest), _LEAST_TILE)
    return tile, {n: room_px(tile, reach) for n, reach in reaches.items()}


def _tile_px(longest: int) -> int:
    """Side of the tiles in which kernels of this reach are convolved."""
    for reach, size in _TILES:
        if longest <= reach:
            return size
    raise _too_wide(longest)


def _too_wide(reach_px: float) -> LensfitError:
    return LensfitError(
        f"blur reaches {reach_px:.4g} px, and {_TILES[-1][0]} px is the most",
        remedy="check f-number, focus distance, and the unit and the nearest pixels of "
        "the depth; or limit the blur (--maximum-blur-percent)",
    )


def room_px(tile: int, reach: int) -> int:
    """Side of a tile with its surroundings, from a few that transform fast."""
    margin = 4
    while margin < reach:
        margin *= 2
    if margin >= 16 and 3 * margin // 4 >= reach:
        margin = 3 * margin // 4
    return tile + 2 * margin


def _leaves(kernels: np.ndarray) -> float:
    """Largest share of light that leaves its pixel."""
    middle = kernels.shape[-1] // 2
    return float(1 - kernels[..., middle, middle].min())
