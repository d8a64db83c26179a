"""What rays are drawn on, and how a dot's image comes of that.

A hole narrower than a cell or two is a place for each ray (`hole`), and rays are drawn
on the patch's own cells. A dot that is broad beside its rays' spacing is a disc with a
sharp rim, an ellipse on the sensor. Its image is the blur of a point convolved with it,

    image^(k) = blur^(k) 2 J1(|A'k|) / |A'k|,

where A leads from the unit disc to the ellipse. Broad dots stand close, and where blur
is wide they reach into each other's pictures: the lens blurs a neighbour as it does the
dot itself, so that the discs beside belong to what is convolved. So rays are drawn as
waves: of a ray at x, a Gaussian of variance v,

    cos(k x) exp(-k^2 v / 2)   and   sin(k x) exp(-k^2 v / 2)

along both axes, exact at any place and width. A period is longer than the patch, since
broad dots reach into it from beyond. Waves are as many as the image has detail: few
where photograph and model are smoothed.

Against discs drawn on sixteenths of a cell, an image is 2 % off at the worst for a
radius of 2 cells and a point of light, 1 % for 8; behind a Gaussian blur of a quarter
of a cell it is less than .5 % for all.

Reference: J. W. Goodman, Introduction to Fourier Optics (2005), 2.1, the transform of a
disc.
"""

import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.typing import DTypeLike
from jaxtyping import Array, Complex, Float
from scipy.special import j1

from lensfit.fit.wavefront.dots import Broad
from lensfit.kernel.pixels import FOOTPRINT, LEAST_SIGMA_PX, Profile, profile_of
from lensfit.kernel.spot import Spot

AROUND = 12
"""Cells on each side of the patch from which broad dots reach into it."""
WAVES = 40
"""Along half an axis, of 48 cells: two periods in three cells."""
LEADING = 14
"""For the matrix, which only leads the way."""
_TOLD = 3.5
"""Radians over the smoothing's deviation, at which it leaves 0.2 % of a wave."""
_AT_ONCE = 256
"""Dots whose transfers are made together, against memory."""
_TINY = 1e-9


class Raster(eqx.Module):
    """What the rays of one dot are drawn on: the cells of its patch, or waves.

    Attributes
    ----------
    corner_mm, cell_mm : Of the patch.
    transfer : Of the discs, from the slowest waves; None where rays leave from places.
    cells : Along a side of the patch.
    """

    corner_mm: Float[Array, "2"]
    cell_mm: Float[Array, "2"]
    transfer: Complex[Array, "down right"] | None
    cells: int = eqx.field(static=True)

    @property
    def drawn(self) -> int:
        """Along a side of what is drawn: cells; or all cosines, then all sines."""
        return self.cells if self.transfer is None else 2 * self.transfer.shape[1]

    def profile(self, spot: Spot, variance_mm2: Float[Array, "*axes"]) -> Profile:
        """Of rays that are Gaussians of this variance, on what is drawn."""
        if self.transfer is None:
            return profile_of(
                spot, self.corner_mm, self.cell_mm, self.cells, variance_mm2
            )
        middle_mm = self.corner_mm + self.cell_mm * self.cells / 2
        own = FOOTPRINT * spot.cell_mm2
        variance_mm2 = jnp.broadcast_to(variance_mm2, (2,))
        (columns, columns_moved), (rows, rows_moved) = (
            self._waves(
                (spot.landing_mm[:, axis] - middle_mm[axis]) / self.cell_mm[axis],
                (variance_mm2[axis] + own) / self.cell_mm[axis] ** 2,
            )
            for axis in (0, 1)
        )
        return Profile(
            rows, columns, rows_moved / self.cell_mm[1], columns_moved / self.cell_mm[0]
        )

    def shown(
        self, drawn: Float[Array, "*images drawn drawn"]
    ) -> Float[Array, "*images cells cells"]:
        """What the patch shows of rays that were drawn."""
        if self.transfer is None:
            return drawn
        waves = _as_waves(drawn)
        transfer = jnp.broadcast_to(self.transfer, waves.shape).astype(waves.dtype)
        down, right = self._at_cells(waves.dtype)
        return jnp.real(down @ (waves * transfer) @ right.T)

    def traced_back(
        self, pull: Float[Array, "cells cells"]
    ) -> Float[Array, "drawn drawn"]:
        """A derivative by what the patch shows as one by what was drawn."""
        if self.transfer is None:
            return pull
        waves = lax.complex(pull, jnp.zeros_like(pull))
        down, right = self._at_cells(waves.dtype)
        waves = down.T @ waves @ right
        return _from_waves(waves * self.transfer.astype(waves.dtype))

    def _waves(
        self, x: Float[Array, " rays"], variance: Float[Array, " rays"]
    ) -> tuple[Float[Array, "drawn rays"], Float[Array, "drawn rays"]]:
        """Every wave along one axis, and its derivative by x; in cells."""
        count = self.drawn // 2
        slowest = 2 * math.pi / (self.cells + 2 * AROUND)
        k = slowest * jnp.arange(count, dtype=x.dtype)[:, None]
        height = jnp.exp(-(k**2) * (variance + LEAST_SIGMA_PX**2)[None] / 2)
        even, odd = (height * part for part in _turned(slowest * x, count))
        return jnp.concatenate([even, odd]), jnp.concatenate([-k * odd, k * even])

    def _at_cells(self, dtype: DTypeLike) -> tuple[Array, Array]:
        """What every cell sees of a wave, down (both ways) and to the right."""
        assert self.transfer is not None
        count = self.transfer.shape[1]
        middle = np.arange(self.cells) + 0.5 - self.cells / 2
        down, right = _wave_numbers(self.cells, count - 1)
        parts = [np.exp(1j * middle[:, None] * k) for k in (down, right)]
        down, right = (jnp.asarray(part.astype(dtype)) for part in parts)
        return down, right


def _turned(
    angle: Float[Array, " rays"], count: int
) -> tuple[Float[Array, "count rays"], Float[Array, "count rays"]]:
    """Cosine and sine of 0, 1, ... times an angle, each from the one before."""
    turn = jnp.cos(angle), jnp.sin(angle)

    def further(at: tuple[Array, Array], _: None):
        even = at[0] * turn[0] - at[1] * turn[1]
        return (even, at[1] * turn[0] + at[0] * turn[1]), at

    start = jnp.ones_like(angle), jnp.zeros_like(angle)
    return lax.scan(further, start, None, length=count)[1]


def _as_waves(drawn: Float[Array, "*images drawn drawn"]) -> Complex[Array, "..."]:
    """Complex amplitudes, down both ways and to the right, of cosines and sines."""
    n = drawn.shape[-1] // 2
    even, odd = drawn[..., :n, :], drawn[..., n:, :]
    ee, eo, oe, oo = even[..., :n], even[..., n:], odd[..., :n], odd[..., n:]
    on = lax.complex(ee - oo, -eo - oe)
    back = lax.complex(ee + oo, oe - eo)
    return jnp.concatenate([back[..., :0:-1, :], on], -2)


def _from_waves(pull: Complex[Array, "down right"]) -> Float[Array, "drawn drawn"]:
    """A derivative by amplitudes as one by cosines and sines: `_as_waves` turned
    about."""
    n = pull.shape[1]
    on, back = pull[n - 1 :], jnp.pad(pull[: n - 1][::-1], ((1, 0), (0, 0)))
    real, imaginary = jnp.real(on + back), jnp.imag(on + back)
    return jnp.block([[real, imaginary], [jnp.imag(on - back), jnp.real(back - on)]])


def _wave_numbers(
    cells: int, most: int
) -> tuple[Float[np.ndarray, " down"], Float[np.ndarray, " right"]]:
    """Radians per cell of the patch."""
    slowest = 2 * np.pi / (cells + 2 * AROUND)
    return slowest * np.arange(-most, most + 1), slowest * np.arange(most + 1)


def raster_of(
    corner_mm: Float[Array, "2"],
    cell_mm: Float[Array, "2"],
    cells: int,
    transfer: Complex[Array, "down right"] | None,
    waves: int = WAVES,
) -> Raster:
    """For one patch.

    Parameters
    ----------
    corner_mm, cell_mm : Of the patch.
    cells : Along its side (static).
    transfer : As `transfers_of` has it, of one dot.
    waves : Of them, along half an axis (static).
    """
    if transfer is not None:
        most = transfer.shape[1] - 1
        few = min(waves, most)
        transfer = transfer[most - few : most + few + 1, : few + 1]
    return Raster(corner_mm, cell_mm, transfer, cells)


def waves_told(smoothing: float, cells: int) -> int:
    """How many waves along half an axis smoothed images have.

    Parameters
    ----------
    smoothing : Standard deviation, cells.
    cells : Along a side of the patch.
    """
    slowest = 2 * math.pi / (cells + 2 * AROUND)
    return min(WAVES, math.ceil(_TOLD / (smoothing * slowest))) if smoothing else WAVES


def transfers_of(
    broad: Broad, cell_mm: Float[np.ndarray, "dots 2"], cells: int
) -> Complex[np.ndarray, "dots down right"]:
    """Of every dot and those beside it, seen by cells; in single precision.

    Parameters
    ----------
    cell_mm, cells : Of the patches.
    """
    some = [slice(k, k + _AT_ONCE) for k in range(0, len(cell_mm), _AT_ONCE)]
    parts = [(Broad(*(part[s] for part in broad)), cell_mm[s]) for s in some]
    return np.concatenate([_transfers(*part, cells) for part in parts])


def _transfers(
    broad: Broad, cell_mm: Float[np.ndarray, "dots 2"], cells: int
) -> Complex[np.ndarray, "dots down right"]:
    """Of some of the dots."""
    around = cells + 2 * AROUND
    down, right = _wave_numbers(cells, WAVES)
    disc = (broad.disc_mm / cell_mm[:, :, None])[..., None, None]
    x = [disc[:, 0, k] * right + disc[:, 1, k] * down[:, None] for k in (0, 1)]
    x = np.maximum(np.hypot(*x), _TINY)
    # Waves to the left are not there: each to the right stands for both.
    twice = np.where(right > 0, 2, 1) / around**2
    box = np.sinc(right / (2 * np.pi)) * np.sinc(down / (2 * np.pi))[:, None] * twice
    beside = broad.beside_mm / cell_mm[:, None]
    near = (np.abs(beside) < around / 2).all(-1)
    along_x = np.exp(-1j * np.nan_to_num(beside[..., :1]) * right)
    along_y = np.exp(-1j * np.nan_to_num(beside[..., 1:]) * down)
    discs = 1 + np.einsum("dn,dnr,dnc->drc", near, along_y, along_x, optimize=True)
    return (2 * j1(x) / x * box * discs).astype(np.complex64)
