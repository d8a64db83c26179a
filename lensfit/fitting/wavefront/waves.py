"""Broad dots drawn in waves: the blur of a point, convolved with discs or edges.

A dot aperture narrower than a cell or two is sampled by one point for each ray
(`dot_aperture`). A dot that is broad beside its rays' spacing is a disc with a sharp
rim, an ellipse on the sensor. Its image is the blur of a point convolved with it,

    image^(k) = blur^(k) 2 J1(|A'k|) / |A'k|,

where A maps the unit disc to the ellipse. Ink spreads and dot apertures are cut to a
tolerance: if a disc is larger by a small share, the transform changes by -2 J2 of the
same number per share. Broad dots stand close, and where blur is wide they reach into
each other's patches: the lens blurs a neighbour as it does the dot itself, so the
neighbouring discs are part of the pattern that is convolved. Rays are drawn as waves: a
ray at x, a Gaussian of variance v, has the amplitudes

    cos(k x) exp(-k^2 v / 2)   and   sin(k x) exp(-k^2 v / 2)

along both axes, exact at any place and width. A period is longer than the patch, since
broad dots reach into it from beyond. There are as many waves as the image has detail:
few where photograph and model are smoothed; `fast_waves` has what is sharper.

Of large dots a part of the rim is shown, of checkers the squares that meet in a corner,
of line grids the lines around a sample: these are drawn and transformed (`edges`).

Against discs drawn on sixteenths of a cell, the image of a point of light anywhere
between cells is 5 % off at the worst for a radius of 1.5 cells, 3 % for 2, 1 % for 8;
behind a Gaussian blur of a quarter of a cell 1 % for 1 and .6 % from 2 on.

Wave numbers are radians per cell of the patch, from its middle, right and down.

Reference: J. W. Goodman, Introduction to Fourier Optics (2005), 2.1, the transform of a
disc.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.typing import DTypeLike
from jaxtyping import Array, Complex, Float
from scipy.special import j1, jv

from lensfit.detect.marker_board import MarkerBoard
from lensfit.fitting.wavefront.basis import Basis, Cells
from lensfit.fitting.wavefront.dot_arrays import (
    Broad,
    Numbers,
    are_corners,
    are_lines,
    are_rims,
)
from lensfit.fitting.wavefront.edges import (
    line_transfers,
    rim_transfers,
    square_transfers,
)
from lensfit.psf.spot import FOOTPRINT, Profile, Spot

MARGIN_CELLS = 12
"""Cells on each side of the patch from which broad dots reach into it."""
WAVES = 40
"""From the slowest on, whose period is patch and surroundings, besides the constant:
on 24 cells up to five periods in six cells."""
FASTEST = 96
"""Of the sharpest detail: two periods in a cell, on 24 cells."""
_CUTOFF = 3.5
"""Wave number times the deviation of a Gaussian that leaves 0.2 % of the wave."""
_AT_ONCE = 256
"""Dots whose transfer functions are computed together, limited by memory."""
_TINY = 1e-9


class FastWaves(NamedTuple):
    """Amplitudes of the pattern around each broad dot in waves faster than `WAVES`
    along one axis, up to `FASTEST` (`fast_waves`).

    Attributes
    ----------
    right : Of those that are fast to the right; down both ways.
    down : Of those that are fast downwards, both ways.
    """

    right: Complex[Numbers, "dots down right"]
    down: Complex[Numbers, "dots down right"]


class Transfer(NamedTuple):
    """Transfer function of the discs of a dot and its neighbours, or of the edges
    around a corner, a rim or a line sample.

    Attributes
    ----------
    pattern : Down both ways and to the right.
    size_slope : Its derivative by the share by which discs, bright squares or lines are
        larger; zero for rims, whose position is free.
    width : Standard deviation of that share.
    edges : 1 for edges, 0 for whole discs.
    fast, fast_size_slope : The sharpest detail of both; None where it is not drawn.
    """

    pattern: Complex[Numbers, "dots down right"]
    size_slope: Complex[Numbers, "dots down right"]
    width: Float[Numbers, " dots"]
    edges: Float[Numbers, " dots"]
    fast: FastWaves | None = None
    fast_size_slope: FastWaves | None = None

    def with_size_excess(self, size_excess: Float[Array, ""]) -> "Transfer":
        """That of discs larger by this share."""
        pattern, fast = jax.tree.map(
            lambda of, slope: of + size_excess.astype(slope.dtype) * slope,
            (self.pattern, self.fast),
            (self.size_slope, self.fast_size_slope),
        )
        return self._replace(pattern=pattern, fast=fast)

    @property
    def as_size_slope(self) -> "Transfer":
        """The transfer function with the derivative by size as its pattern."""
        return self._replace(pattern=self.size_slope, fast=self.fast_size_slope)


class Waves(Basis):
    """Cosines and then sines, the constant first among the cosines.

    Attributes
    ----------
    corner_mm, cell_mm, cells : Of the patch; cells along a side.
    transfer : Of discs or edges, down both ways and to the right.
    """

    corner_mm: Float[Array, "2"]
    cell_mm: Float[Array, "2"]
    cells: int = eqx.field(static=True)
    transfer: Complex[Array, "down right"]

    @property
    def size(self) -> int:
        """Twice as many as wave numbers."""
        return 2 * self.transfer.shape[1]

    @property
    def numbers(self) -> Float[np.ndarray, " half_size"]:
        """Wave numbers along one axis, of the cosines and of the sines."""
        return wave_numbers(self.cells, self.size // 2 - 1)[1]

    def of_transfer(self, transfer: Transfer) -> "Waves":
        """The same of another dot."""
        return replace(self, transfer=_slow_part(transfer.pattern, self.size // 2 - 1))

    def profile(self, spot: Spot, variance_mm2: Float[Array, "*axes"]) -> Profile:
        """Amplitudes of every ray, and their change per mm that it moves."""
        own = FOOTPRINT * spot.cell_mm2
        variance_mm2 = jnp.broadcast_to(variance_mm2, (2,))
        (columns, columns_moved), (rows, rows_moved) = (
            self._amplitudes(
                (spot.landing_mm[:, axis] - self.centre_mm[axis]) / self.cell_mm[axis],
                (variance_mm2[axis] + own) / self.cell_mm[axis] ** 2,
            )
            for axis in (0, 1)
        )
        return Profile(
            rows, columns, rows_moved / self.cell_mm[1], columns_moved / self.cell_mm[0]
        )

    def cell_light(
        self, drawn: Float[Array, "*images size size"]
    ) -> Float[Array, "*images cells cells"]:
        """Light of every cell: the waves times the transfer function, summed."""
        waves = _complex_of(drawn)
        transfer = jnp.broadcast_to(self.transfer, waves.shape).astype(waves.dtype)
        # Cosines and sines again: real products take half as long as complex ones.
        at_cells = self._waves_at_cells(drawn.dtype)
        return at_cells @ (_light_of(waves * transfer) @ at_cells.T)

    def cell_light_transpose(
        self, cotangent: Float[Array, "cells cells"]
    ) -> Float[Array, "size size"]:
        """The transpose of `cell_light`."""
        at_cells = self._waves_at_cells(cotangent.dtype)
        waves = jnp.conj(_complex_of(at_cells.T @ cotangent @ at_cells))
        return _real_of(waves * self.transfer.astype(waves.dtype))

    def _amplitudes(
        self, x: Float[Array, " rays"], variance: Float[Array, " rays"]
    ) -> tuple[Float[Array, "size rays"], Float[Array, "size rays"]]:
        """Along one axis, and their derivative by x; in cells."""
        count = self.size // 2
        slowest = _slowest(self.cells)
        k = slowest * jnp.arange(count, dtype=x.dtype)[:, None]
        height = jnp.exp(-(k**2) * variance[None] / 2)
        even, odd = (height * part for part in multiples(slowest * x, count))
        return jnp.concatenate([even, odd]), jnp.concatenate([-k * odd, k * even])

    def _waves_at_cells(self, dtype: DTypeLike) -> Float[Array, "cells size"]:
        """Cosines and sines at the middle of every cell."""
        middle = np.arange(self.cells) + 0.5 - self.cells / 2
        angle = middle[:, None] * self.numbers
        return jnp.asarray(np.hstack([np.cos(angle), np.sin(angle)]), dtype)


def basis_of(
    corner_mm: Float[Array, "2"],
    cell_mm: Float[Array, "2"],
    cells: int,
    transfer: Transfer | None,
    waves: int = WAVES,
) -> Basis:
    """For one patch.

    Parameters
    ----------
    corner_mm, cell_mm : Of the patch.
    cells : Along its side (static).
    transfer : Of one dot; None where rays sample the dot aperture.
    waves : Of them, up to `WAVES` (static).
    """
    if transfer is None:
        return Cells(corner_mm, cell_mm, cells)
    return Waves(corner_mm, cell_mm, cells, _slow_part(transfer.pattern, waves))


def _slow_part(
    pattern: Complex[Array, "down right"], waves: int
) -> Complex[Array, "slow_down slow_right"]:
    """Of the slowest waves only."""
    return pattern[WAVES - waves : WAVES + waves + 1, : waves + 1]


def waves_after_smoothing(smoothing: float, cells: int) -> int:
    """How many waves smoothing leaves.

    Parameters
    ----------
    smoothing : Standard deviation, cells.
    cells : Along a side of the patch.
    """
    if not smoothing:
        return WAVES
    return min(WAVES, math.ceil(_CUTOFF / (smoothing * _slowest(cells))))


def transfers_of(
    broad: Broad,
    cell_mm: Float[np.ndarray, "dots 2"],
    cells: int,
    markers: Sequence[MarkerBoard | None],
    *,
    sharp: bool = False,
) -> Transfer:
    """Transfer functions of all targets, integrated over cells; in single precision.

    Parameters
    ----------
    cell_mm, cells : Of the patches.
    markers : Of the board of every target; None where it has none.
    sharp : Whether the sharpest detail is drawn too, which takes four times as long.
    """
    most = FASTEST if sharp else WAVES
    pattern, size_slope = _patterns_of(broad, cell_mm, cells, markers, most)
    slow = slice(most - WAVES, most + WAVES + 1)

    def fast_of(of: Complex[np.ndarray, "dots down right"]) -> FastWaves:
        down = np.delete(of, np.r_[slow], 1)
        return FastWaves(of[:, slow, WAVES + 1 :], down[..., : WAVES + 1])

    return Transfer(
        pattern[:, slow, : WAVES + 1],
        size_slope[:, slow, : WAVES + 1],
        np.asarray(broad.size_width),
        (are_corners(broad) | are_rims(broad) | are_lines(broad)).astype(float),
        fast_of(pattern) if sharp else None,
        fast_of(size_slope) if sharp else None,
    )


def _patterns_of(
    broad: Broad,
    cell_mm: Float[np.ndarray, "dots 2"],
    cells: int,
    markers: Sequence[MarkerBoard | None],
    most: int,
) -> tuple[
    Complex[np.ndarray, "dots down right"], Complex[np.ndarray, "dots down right"]
]:
    """`Transfer.pattern` and `Transfer.size_slope` of all targets, in single precision.

    Parameters
    ----------
    cell_mm, cells, markers : As for `transfers_of`.
    most : Waves besides the constant.
    """
    corners, rims, lines = are_corners(broad), are_rims(broad), are_lines(broad)
    whole = np.flatnonzero(~(corners | rims | lines))
    pattern = np.zeros((len(cell_mm), 2 * most + 1, most + 1), np.complex64)
    size_slope = np.zeros_like(pattern)
    for start in range(0, len(whole), _AT_ONCE):
        s = whole[start : start + _AT_ONCE]
        pattern[s], size_slope[s] = _disc_transfer(
            broad.disc_mm[s], broad.neighbour_offsets_mm[s], cell_mm[s], cells, most
        )
    waves = _period(cells), most
    seen = _cell_response(*wave_numbers(cells, most))
    square_cells = broad.square_mm / cell_mm[:, :, None]
    bend_cells = broad.bend_mm / cell_mm[:, :, None, None]
    lattice = np.rint(broad.lattice).astype(int)
    about = [
        None if (board := markers[k]) is None else board.about(lattice[k])
        for k in map(int, np.flatnonzero(corners))
    ]
    squares = square_transfers(
        square_cells[corners], bend_cells[corners], about, *waves
    )
    pattern[corners], size_slope[corners] = (seen * part for part in squares)
    around = line_transfers(
        square_cells[lines],
        bend_cells[lines],
        broad.lattice[lines],
        broad.line_width[lines],
        *waves,
    )
    pattern[lines], size_slope[lines] = (seen * part for part in around)
    disc_cells = broad.disc_mm / cell_mm[:, :, None]
    to_middle_cells = broad.rim_mm / cell_mm
    neighbour_offsets_cells = broad.neighbour_offsets_mm / cell_mm[:, None]
    pattern[rims] = seen * rim_transfers(
        disc_cells[rims],
        bend_cells[rims],
        to_middle_cells[rims],
        neighbour_offsets_cells[rims],
        *waves,
    )
    return pattern, size_slope


def _disc_transfer(
    disc_mm: Float[np.ndarray, "dots 2 2"],
    neighbour_offsets_mm: Float[np.ndarray, "dots neighbours 2"],
    cell_mm: Float[np.ndarray, "dots 2"],
    cells: int,
    most: int,
) -> tuple[
    Complex[np.ndarray, "dots down right"], Complex[np.ndarray, "dots down right"]
]:
    """Of some of the dots, and their change by size."""
    period = _period(cells)
    down, right = wave_numbers(cells, most)
    disc = (disc_mm / cell_mm[:, :, None])[..., None, None]
    x = [disc[:, 0, k] * right + disc[:, 1, k] * down[:, None] for k in (0, 1)]
    x = np.maximum(np.hypot(*x), _TINY)
    box = _cell_response(down, right) / period**2
    beside = neighbour_offsets_mm / cell_mm[:, None]
    near = (np.abs(beside) < period / 2).all(-1)
    along_x = np.exp(-1j * np.nan_to_num(beside[..., :1]) * right)
    along_y = np.exp(-1j * np.nan_to_num(beside[..., 1:]) * down)
    discs = 1 + np.einsum("dn,dnr,dnc->drc", near, along_y, along_x, optimize=True)
    each = 2 * j1(x) / x, -2 * jv(2, x)
    disc, size_slope = ((part * box * discs).astype(np.complex64) for part in each)
    return disc, size_slope


def _cell_response(
    down: Float[np.ndarray, " down"], right: Float[np.ndarray, " right"]
) -> Float[np.ndarray, "down right"]:
    """Response of a cell to each wave; waves to the left are omitted, each to the right
    counts twice."""
    box = np.sinc(right / (2 * np.pi)) * np.sinc(down / (2 * np.pi))[:, None]
    return box * np.where(right > 0, 2, 1)


def multiples(
    angle: Float[Array, " rays"], count: int
) -> tuple[Float[Array, "count rays"], Float[Array, "count rays"]]:
    """Cosine and sine of 0, 1, ... times an angle, each from the one before: by the
    function itself they would take four times as long."""
    turn = jnp.cos(angle), jnp.sin(angle)

    def further(at: tuple[Array, Array], _: None):
        even = at[0] * turn[0] - at[1] * turn[1]
        return (even, at[1] * turn[0] + at[0] * turn[1]), at

    start = jnp.ones_like(angle), jnp.zeros_like(angle)
    return lax.scan(further, start, None, length=count)[1]


def _complex_of(
    drawn: Float[Array, "*images size size"],
) -> Complex[Array, "*images down right"]:
    """Amplitudes of exp(-i k x), down both ways and to the right."""
    n = drawn.shape[-1] // 2
    even, odd = drawn[..., :n, :], drawn[..., n:, :]
    ee, eo, oe, oo = even[..., :n], even[..., n:], odd[..., :n], odd[..., n:]
    on = lax.complex(ee - oo, -eo - oe)
    back = lax.complex(ee + oo, oe - eo)
    return jnp.concatenate([back[..., :0:-1, :], on], -2)


def _light_of(
    waves: Complex[Array, "*images down right"],
) -> Float[Array, "*images size size"]:
    """Amplitudes of cosines and sines, of the real part of amplitudes of exp(i k x)."""
    n = waves.shape[-1]
    on = waves[..., n - 1 :, :]
    back = jnp.zeros_like(on).at[..., 1:, :].set(waves[..., : n - 1, :][..., ::-1, :])
    both, apart = on + back, back - on
    even = jnp.concatenate([jnp.real(both), -jnp.imag(both)], -1)
    odd = jnp.concatenate([jnp.imag(apart), jnp.real(apart)], -1)
    return jnp.concatenate([even, odd], -2)


def _real_of(cotangent: Complex[Array, "down right"]) -> Float[Array, "size size"]:
    """The transpose of `_complex_of`: a derivative by cosines and sines."""
    n = cotangent.shape[1]
    on, back = cotangent[n - 1 :], jnp.pad(cotangent[: n - 1][::-1], ((1, 0), (0, 0)))
    real, imaginary = jnp.real(on + back), jnp.imag(on + back)
    return jnp.block([[real, imaginary], [jnp.imag(on - back), jnp.real(back - on)]])


def wave_numbers(
    cells: int, most: int
) -> tuple[Float[np.ndarray, " down"], Float[np.ndarray, " right"]]:
    """Down both ways, and to the right."""
    slowest = _slowest(cells)
    return slowest * np.arange(-most, most + 1), slowest * np.arange(most + 1)


def _slowest(cells: int) -> float:
    return 2 * math.pi / _period(cells)


def _period(cells: int) -> int:
    """Of the slowest wave, cells."""
    return cells + 2 * MARGIN_CELLS
