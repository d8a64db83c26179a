"""Cells that rays are drawn on, and how a dot's image comes of that.

A hole narrower than a cell or two is a place for each ray (`hole`), and rays are drawn
on the patch's own cells. A dot that is broad beside its rays' spacing is a disc with a
sharp rim, an ellipse on the sensor. Its image is the blur of a point convolved with it,

    image^(k) = blur^(k) 2 J1(|A'k|) / |A'k|,

where A leads from the unit disc to the ellipse. Broad dots stand close, and where blur
is wide they reach into each other's pictures: the lens blurs a neighbour as it does the
dot itself, so that the discs beside belong to what is convolved. The blur is drawn on
finer cells, well beyond the patch since broad dots reach into it from there, each ray a
little wider than a cell of these, so that little detail is lost between them; the
transfer makes up for that width.

Against discs drawn on sixteenths of a cell, a point anywhere between cells has an image
that is 4 % off at the worst for a radius of 1 cell, 2 % for 2, 1 % for 8; behind a
Gaussian blur of a quarter of a cell it is less than .5 % for all.

Reference: J. W. Goodman, Introduction to Fourier Optics (2005), 2.1, the transform of a
disc.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float
from scipy.special import j1

from lensfit.fit.wavefront.dots import Broad
from lensfit.kernel.pixels import Profile, profile_of
from lensfit.kernel.spot import Spot

AROUND = 12
"""Cells on each side of the patch from which broad dots reach into it."""
FINER, COARSER = 2, 1
"""Divisions of a cell: of images, and of the matrix, which only leads the way."""
_SOFT = 0.3
"""Standard deviation, cells, by which rays are widened and the transfer sharpened."""
_AT_ONCE = 256
"""Dots whose transfers are made together, against memory."""
_TINY = 1e-9


class Raster(eqx.Module):
    """Where the rays of one dot are drawn.

    Attributes
    ----------
    corner_mm : Of the first cell that is drawn.
    cell_mm : Of those.
    variance_mm2 : By which rays are widened, along x and y.
    transfer : Of the discs; None where rays leave from places.
    cells, drawn : Along a side of the patch, and of what is drawn.
    finer : Cells that are drawn, along one of the patch.
    """

    corner_mm: Float[Array, "2"]
    cell_mm: Float[Array, "2"]
    variance_mm2: Float[Array, "2"]
    transfer: Complex[Array, "drawn half"] | None
    cells: int = eqx.field(static=True)
    drawn: int = eqx.field(static=True)
    finer: int = eqx.field(static=True)

    def shown(
        self, drawn: Float[Array, "*images drawn drawn"]
    ) -> Float[Array, "*images cells cells"]:
        """What the patch shows of rays that were drawn."""
        if self.transfer is None:
            return drawn
        edge, of_images = AROUND * self.finer, drawn.shape[:-2]
        within = _convolved(drawn, self.transfer)[..., edge:-edge, edge:-edge]
        parts = (self.cells, self.finer, self.cells, self.finer)
        return within.reshape(*of_images, *parts).sum((-3, -1))

    def profile(self, spot: Spot, variance_mm2: Float[Array, "*axes"]) -> Profile:
        """Of rays that are Gaussians of this variance, on what is drawn."""
        return profile_of(
            spot,
            self.corner_mm,
            self.cell_mm,
            self.drawn,
            variance_mm2 + self.variance_mm2,
        )

    def traced_back(
        self, pull: Float[Array, "cells cells"]
    ) -> Float[Array, "drawn drawn"]:
        """A derivative by what the patch shows as one by what was drawn."""
        if self.transfer is None:
            return pull
        spread = jnp.repeat(jnp.repeat(pull, self.finer, 0), self.finer, 1)
        padded = jnp.pad(spread, AROUND * self.finer)
        return _convolved(padded, jnp.conj(self.transfer))


def _convolved(drawn: Array, transfer: Array) -> Array:
    size = drawn.shape[-1]
    waves = jnp.fft.rfft2(drawn)
    of_each = jnp.broadcast_to(transfer, waves.shape).astype(waves.dtype)
    return jnp.fft.irfft2(waves * of_each, s=(size, size))


def raster_of(
    corner_mm: Float[Array, "2"],
    cell_mm: Float[Array, "2"],
    cells: int,
    transfer: Complex[Array, "drawn half"] | None,
    finer: int = FINER,
) -> Raster:
    """For one patch.

    Parameters
    ----------
    corner_mm, cell_mm : Of the patch.
    cells : Along its side (static).
    transfer : As `transfers_of` has it, of one dot.
    finer : `FINER` or `COARSER` (static).
    """
    if transfer is None:
        nothing = jnp.zeros(2, cell_mm.dtype)
        return Raster(corner_mm, cell_mm, nothing, None, cells, cells, 1)
    drawn = (cells + 2 * AROUND) * finer
    half = drawn // 2
    if finer == COARSER:
        rows = jnp.concatenate([transfer[:half], transfer[-half:]])
        transfer = rows[:, : half + 1]
    return Raster(
        corner_mm - AROUND * cell_mm,
        cell_mm / finer,
        (_SOFT * cell_mm) ** 2,
        transfer,
        cells,
        drawn,
        finer,
    )


def transfers_of(
    broad: Broad, cell_mm: Float[np.ndarray, "dots 2"], cells: int
) -> Complex[np.ndarray, "dots drawn half"]:
    """Of every dot and those beside it, on the finer cells; in single precision.

    Parameters
    ----------
    cell_mm, cells : Of the patches.
    """
    some = [slice(k, k + _AT_ONCE) for k in range(0, len(cell_mm), _AT_ONCE)]
    parts = [(Broad(*(part[s] for part in broad)), cell_mm[s]) for s in some]
    return np.concatenate([_transfers(*part, cells) for part in parts])


def _transfers(
    broad: Broad, cell_mm: Float[np.ndarray, "dots 2"], cells: int
) -> Complex[np.ndarray, "dots drawn half"]:
    """Of some of the dots."""
    around = cells + 2 * AROUND
    # Radians per cell of the patch.
    right = 2 * np.pi * np.fft.rfftfreq(around * FINER, 1 / FINER)
    down = 2 * np.pi * np.fft.fftfreq(around * FINER, 1 / FINER)[:, None]
    disc = (broad.disc_mm / cell_mm[:, :, None])[..., None, None]
    waves = [disc[:, 0, k] * right + disc[:, 1, k] * down for k in (0, 1)]
    x = np.maximum(np.hypot(*waves), _TINY)
    sharpened = np.exp(_SOFT**2 * (right**2 + down**2) / 2)
    beside = broad.beside_mm / cell_mm[:, None]
    near = (np.abs(beside) < around / 2).all(-1)
    along_x = np.exp(-1j * np.nan_to_num(beside[..., :1]) * right)
    along_y = np.exp(-1j * np.nan_to_num(beside[..., 1:]) * down[:, 0])
    discs = 1 + np.einsum("dn,dnr,dnc->drc", near, along_y, along_x, optimize=True)
    return (2 * j1(x) / x * sharpened * discs).astype(np.complex64)
