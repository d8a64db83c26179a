"""How the kernels of a lens vary over a window, with place and with colour, measured.

Along the diagonal of the window the mixture of two neighbours is compared with the
kernel between them, and the grid is refined until they agree. A lens whose kernel is
one and the same has one node; one whose colours do not differ visibly has one kernel
for three channels.
"""

import math

import numpy as np

from lensfit.coords import Window
from lensfit.render.field_grid import FieldGrid
from lensfit.render.kernel_bank import RGB, KernelBank

_MOST_CELLS = 30
_MIDWAY = 1.6
"""Error of a mixture midway between nodes over its mean over a cell."""


def mixing_error(bank: KernelBank, window: Window, level: float, cells: int) -> float:
    """Relative error, rms along the diagonal, of the mixture of two neighbours."""
    low, high = np.array(window[:2], float), np.array(window[2:], float) + 1
    t = np.linspace(0.0, 1.0, 2 * cells + 1)[:, None]
    found = bank.at(low + t * (high - low), level, ("g",))[:, 0]
    exact, between = found[1::2], (found[:-1:2] + found[2::2]) / 2
    away = np.linalg.norm(exact - between, axis=(1, 2))
    error = away / np.linalg.norm(exact, axis=(1, 2))
    seen = error[np.isfinite(error)]
    return float(np.sqrt(np.mean(seen**2))) if seen.size else 0.0


def field_grid(bank: KernelBank, window: Window, levels: list[int]) -> FieldGrid:
    """The coarsest grid whose mixtures are good enough at all these levels.

    Parameters
    ----------
    levels : At least the two extremes that occur.
    """
    ends = sorted({min(levels), max(levels), min(levels, key=abs)})
    centre = FieldGrid(window, 0, 0)
    if bank.is_scaled or all(
        _field_change(bank, window, n) <= bank.needs.error for n in ends
    ):
        return centre
    cells = 2
    while cells < _MOST_CELLS:
        if all(
            mixing_error(bank, window, n, cells) <= _MIDWAY * bank.needs.error
            for n in ends
        ):
            break
        cells = math.ceil(1.5 * cells)
    # Cells along the diagonal, spread over two sides.
    diagonal = math.hypot(window.width, window.height)
    return FieldGrid(
        window,
        max(1, math.ceil(cells * window.width / diagonal)),
        max(1, math.ceil(cells * window.height / diagonal)),
    )


def colours_differ(bank: KernelBank, window: Window, levels: list[int]) -> bool:
    """Whether red's or blue's kernel differs visibly from green's anywhere."""
    if bank.is_grey:
        return False
    points = _cross(window)
    for n in {min(levels), max(levels), min(levels, key=abs)}:
        found = bank.at(points, n, RGB)
        away = np.linalg.norm(found - found[:, 1:2], axis=(-2, -1))
        change = away / np.linalg.norm(found[:, 1:2], axis=(-2, -1))
        if np.nanmax(change, initial=0.0) > bank.needs.error:
            return True
    return False


def _field_change(bank: KernelBank, window: Window, level: int) -> float:
    """Largest relative difference between the centre's kernel and others."""
    found = bank.at(_cross(window), level, ("g",))[:, 0]
    away = np.linalg.norm(found - found[:1], axis=(1, 2))
    return float(np.nanmax(away / np.linalg.norm(found[0]), initial=0.0))


def _cross(window: Window) -> np.ndarray:
    """Centre, two corners, the middles of two sides."""
    t = np.array([[0.5, 0.5], [1, 1], [0, 0], [1, 0.5], [0.5, 0]])
    return np.array(window[:2]) + t * [window.width, window.height]
