"""How well point-spread functions are known: what the doubt about a blur does to them.

A blur that is known to within some independent moves, each of one standard deviation,
has point-spread functions whose covariance is J C J', to first order: the sum of the
outer products of what every move does to the pixels. Each is a central difference over
half the move, made with the very same rays, so that what rays leave open cancels.

All arrays sum to 1, moved or not: what a pixel gains others lose.

Part of the doubt may be where the light of a point lies about its chief ray, which a
single photograph of dots does not tell; where the picture lies is then known none the
less, since chief rays were fitted to that light. So the error of a function's shape is
told apart: what every move leaves after the best shift.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lensfit.psf.lens_blur import LensBlur
from lensfit.psf.lens_psf import Optics, Points, Raster, lens_psfs, turns_needed

STEP = 0.5
"""Share of a standard deviation by which a blur is moved. Smaller ones follow edges of
light more closely, and the unevenness of the rays with them."""
_STEP_PX = 0.25
"""To both sides, of shifts."""


class MovedBlur(NamedTuple):
    """A blur moved forth and back by a share of a standard deviation, `STEP` or less
    where that would leave what a blur can be."""

    forth: LensBlur
    back: LensBlur
    step: float


MovedBlurs = Iterable[MovedBlur]
"""One for each independent move."""


class KnownPsfs(NamedTuple):
    """Point-spread functions and how well they are known.

    Attributes
    ----------
    deviation : Standard deviation of every pixel.
    shape_deviation : Of each whole, root of the sum of squares over its pixels, of what
        errors leave after the best shift.
    """

    psf: Float[np.ndarray, "points size size"]
    deviation: Float[np.ndarray, "points size size"]
    shape_deviation: Float[np.ndarray, " points"]

    def relative_error(self) -> Float[np.ndarray, " points"]:
        """Expected error of each whole, root mean square, relative (L2)."""
        return _norms(self.deviation) / self._sizes()

    def relative_shape_error(self) -> Float[np.ndarray, " points"]:
        """The same after the best shift of each."""
        return self.shape_deviation / self._sizes()

    def _sizes(self) -> Float[np.ndarray, " points"]:
        """1 where there is no light."""
        size = _norms(self.psf)
        return np.where(size > 0, size, 1.0)


def known_psfs(
    points: Points, optics: Optics, raster: Raster, moved: MovedBlurs
) -> KnownPsfs:
    """Point-spread functions of many points with their standard deviations.

    Parameters
    ----------
    moved : Independent moves of the blur in `optics`.
    """
    turns = turns_needed(points, optics, raster)

    def drawn(
        blur: LensBlur, right_px: float = 0.0, down_px: float = 0.0
    ) -> np.ndarray:
        shifted = raster._replace(shift_px=(right_px, down_px))
        return lens_psfs(points, (blur, *optics[1:]), shifted, turns)

    blur = optics[0]
    psf = drawn(blur)
    across = drawn(blur, right_px=_STEP_PX) - drawn(blur, right_px=-_STEP_PX)
    down = drawn(blur, down_px=_STEP_PX) - drawn(blur, down_px=-_STEP_PX)
    shifts = _orthonormal(across, down)
    variance, of_shape = np.zeros_like(psf), np.zeros(len(psf))
    for one in moved:
        change = (drawn(one.forth) - drawn(one.back)) / (2 * one.step)
        variance += change**2
        along = np.einsum("pkij,pij->pk", shifts, change)
        of_shape += np.sum(change**2, (1, 2)) - np.sum(along**2, 1)
    return KnownPsfs(psf, np.sqrt(variance), np.sqrt(np.maximum(of_shape, 0.0)))


def _norms(
    arrays: Float[np.ndarray, "points size size"],
) -> Float[np.ndarray, " points"]:
    return np.sqrt(np.sum(arrays**2, (1, 2)))


def _orthonormal(
    *changes: Float[np.ndarray, "points size size"],
) -> Float[np.ndarray, "points changes size size"]:
    """Orthogonal arrays of norm 1 that span these changes."""
    points, size, _ = changes[0].shape
    unit, _ = np.linalg.qr(np.stack(changes, -1).reshape(points, size * size, -1))
    return np.swapaxes(unit, 1, 2).reshape(points, -1, size, size)


def fewer_moves(
    moves: Sequence[Sequence[float]], count: int
) -> Float[np.ndarray, "count numbers"]:
    """So many moves that stand for all: sums of them with random signs, always the
    same, whose outer products add up to the same covariance on average.

    Reference: M. F. Hutchinson, Communications in Statistics B 19 (1990) 433.
    """
    signs = np.random.default_rng(0).choice([-1.0, 1.0], (count, len(moves)))
    return signs @ np.asarray(moves, float).reshape(len(moves), -1) / count**0.5
