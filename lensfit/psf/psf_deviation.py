"""How well point-spread functions are known: what the doubt about a blur does to them.

A blur that is known to within some independent moves, each of one standard deviation,
has point-spread functions whose covariance is J C J', to first order: the sum of the
outer products of what every move does to the pixels. Each is a central difference over
half the move, made with the very same rays, so that what rays leave open cancels.

All arrays sum to 1, moved or not: what a pixel gains others lose.
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


class MovedBlur(NamedTuple):
    """A blur moved forth and back by a share of a standard deviation, `STEP` or less
    where that would leave what a blur can be."""

    forth: LensBlur
    back: LensBlur
    step: float


MovedBlurs = Iterable[MovedBlur]
"""One for each independent move."""


class KnownPsfs(NamedTuple):
    """Point-spread functions and the standard deviation of every pixel."""

    psf: Float[np.ndarray, "points size size"]
    deviation: Float[np.ndarray, "points size size"]

    def relative_error(self) -> Float[np.ndarray, " points"]:
        """Expected error of each whole, root mean square, relative (L2)."""
        norm, error = (np.sqrt(np.sum(a**2, (1, 2))) for a in self)
        return error / np.where(norm > 0, norm, 1.0)


def known_psfs(
    points: Points, optics: Optics, raster: Raster, moved: MovedBlurs
) -> KnownPsfs:
    """Point-spread functions of many points with their standard deviations.

    Parameters
    ----------
    moved : Independent moves of the blur in `optics`.
    """
    turns = turns_needed(points, optics, raster)

    def drawn(blur: LensBlur) -> np.ndarray:
        return lens_psfs(points, (blur, *optics[1:]), raster, turns)

    psf = drawn(optics[0])
    variance = np.zeros_like(psf)
    for one in moved:
        variance += ((drawn(one.forth) - drawn(one.back)) / (2 * one.step)) ** 2
    return KnownPsfs(psf, np.sqrt(variance))


def fewer_moves(
    moves: Sequence[Sequence[float]], count: int
) -> Float[np.ndarray, "count numbers"]:
    """So many moves that stand for all: sums of them with random signs, always the
    same, whose outer products add up to the same covariance on average.

    Reference: M. F. Hutchinson, Communications in Statistics B 19 (1990) 433.
    """
    signs = np.random.default_rng(0).choice([-1.0, 1.0], (count, len(moves)))
    return signs @ np.asarray(moves, float).reshape(len(moves), -1) / count**0.5
