"""Squares that meet in a corner, drawn finely: what edges in waves are held against."""

import numpy as np
from scipy.ndimage import gaussian_filter

CELLS = 24
"""Along a side of a patch."""
FLAT = np.zeros((2, 2, 2))
"""Second derivatives of an image whose edges are straight."""


def units_of(places, sides, bend):
    """The pattern's units that land on these places, by fixed-point iteration."""
    inverse = np.linalg.inv(sides)
    found = places @ inverse.T
    for _ in range(8 if bend.any() else 0):
        bent = np.einsum("kij,...i,...j->...k", bend, found, found) / 2
        found = (places - bent) @ inverse.T
    return found


def whole_chart(
    sides, blur_cells, around, *, wider=0.0, bend=FLAT, at_cells=(0.0, 0.0), fine=16
):
    """Means over cells of the chart behind a Gaussian, of a patch and so many cells
    around it.

    Parameters
    ----------
    wider : Share by which bright squares are wider than dark ones would have it.
    at_cells : Of the corner, from the middle, right and down.
    """
    wide = CELLS + 2 * around
    along = (np.arange(wide * fine) + 0.5) / fine - wide / 2
    places = np.stack(np.meshgrid(along, along), -1) - np.asarray(at_cells)
    places = units_of(places, sides, bend)
    square = np.floor(places)
    off = np.abs(places - np.round(places)).min(-1)
    bright = square.sum(-1) % 2 == 0
    bright |= off < wider / 2
    if wider < 0:
        bright &= off >= -wider / 2
    blurred = gaussian_filter(bright.astype(float), blur_cells * fine, truncate=6)
    return blurred.reshape(wide, fine, wide, fine).mean((1, 3))
