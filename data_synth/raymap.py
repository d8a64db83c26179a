"""Smooth maps over the frame, from values known at traced field nodes.

Chart positions are Chebyshev polynomials in pixel position (total degree 13), fitted to
exactly traced pairs; quantities with kinks, such as how far a pupil cell is open, are
interpolated linearly between the nodes. Both are evaluated on whole pixel grids.
"""

import numpy as np
from jaxtyping import Float
from numpy.polynomial import chebyshev

FIELD_NODES = (25, 19)
"""Columns and rows of the field nodes."""
DEGREE = 13
OVERSHOOT = 1.06
"""The outermost nodes lie this far out, in half frames."""
REACH = 1.1 * OVERSHOOT
"""Half-width of the polynomials' interval, in half frames."""
STEP_PX = 16
REFINEMENTS = 12
GOOD_ENOUGH_MM = 1e-9


def node_places(count: int) -> Float[np.ndarray, " nodes"]:
    """Chebyshev nodes in ascending order, in half frames."""
    return -np.cos(np.pi * (np.arange(count) + 0.5) / count) * OVERSHOOT


def hats(nodes: int, at_px, size_px: int) -> Float[np.ndarray, "places nodes"]:
    """Weights of linear interpolation from the field nodes to places in pixels."""
    at = at_px / size_px * 2 - 1
    places = node_places(nodes)
    return np.stack([np.interp(at, places, row) for row in np.eye(nodes)], -1)


def basis(at_px, size_px: int):
    """Chebyshev polynomials at places in pixels, and their derivatives per pixel."""
    places = at_px / size_px * 2 - 1
    values = chebyshev.chebvander(places / REACH, DEGREE)
    derivative = chebyshev.chebder(np.eye(DEGREE + 1))
    slopes = chebyshev.chebvander(places / REACH, DEGREE - 1) @ derivative
    return values, slopes * 2 / size_px / REACH


def evaluated(
    coefficients: Float[np.ndarray, "maps orders_y orders_x"],
    basis_rows: Float[np.ndarray, "rows orders_y"],
    basis_columns: Float[np.ndarray, "columns orders_x"],
) -> Float[np.ndarray, "maps rows columns"]:
    """Products of one-dimensional polynomials, summed at every place."""
    return np.stack([basis_rows @ c @ basis_columns.T for c in coefficients])


class RayMap:
    """Fits chart positions over the frame for many pupil points of one field.

    All pupil points see the field nodes at nearly the same pixels, so one factorisation
    at the chief rays' pixels serves them all: the error made by that is fitted again,
    shrinking each time by about (displacement / frame).
    """

    def __init__(self, at_px: Float[np.ndarray, "nodes 2"], size_px: tuple[int, int]):
        self._size_px = np.array(size_px)
        orders = np.arange(DEGREE + 1)
        self._terms = (orders[:, None] + orders <= DEGREE).reshape(-1)
        self._inverse = np.linalg.pinv(self._vander(at_px)[:, self._terms])

    def fit(
        self,
        at_px: Float[np.ndarray, "nodes 2"],
        chart_mm: Float[np.ndarray, "nodes 2"],
    ) -> tuple[Float[np.ndarray, "2 orders_y orders_x"], float]:
        """Coefficients of the maps through these pairs, and the worst misfit, px."""
        vander = self._vander(at_px)[:, self._terms]
        if not np.isfinite(vander).all():
            good = np.isfinite(vander).all(axis=1)
            solution, *_ = np.linalg.lstsq(vander[good], chart_mm[good], rcond=None)
            misfit_mm = np.abs(vander[good] @ solution - chart_mm[good]).max()
        else:
            solution, misfit_mm = self._refined(vander, chart_mm)
        per_px = np.ptp(chart_mm, axis=0).max() / self._size_px.max() / OVERSHOOT
        coefficients = np.zeros((2, (DEGREE + 1) ** 2))
        coefficients[:, self._terms] = solution.T
        maps = coefficients.reshape(2, DEGREE + 1, DEGREE + 1)
        return np.swapaxes(maps, 1, 2), float(misfit_mm / per_px)

    def _refined(self, vander, chart_mm):
        # einsum, since threaded matrix products cost more than they give here.
        solution = np.einsum("tn,nc->tc", self._inverse, chart_mm)
        misfit_mm = np.inf
        for _ in range(REFINEMENTS):
            residual = chart_mm - np.einsum("nt,tc->nc", vander, solution)
            step = np.einsum("tn,nc->tc", self._inverse, residual)
            solution = solution + step
            misfit_mm = np.abs(residual).max()
            if np.abs(step).max() < GOOD_ENOUGH_MM:
                break
        return solution, misfit_mm

    def _vander(self, at_px):
        x, y = ((at_px / self._size_px * 2 - 1) / REACH).T
        return chebyshev.chebvander2d(x, y, [DEGREE, DEGREE])


class Steps:
    """Every `STEP_PX`-th pixel along one side, and the way back to all pixels."""

    def __init__(self, size_px: int, nodes: int):
        count = int(np.ceil(size_px / STEP_PX)) + 1
        at_px = np.arange(count) * STEP_PX
        self.basis, _ = basis(at_px, size_px)
        self.hats = hats(nodes, at_px, size_px)
        place = (np.arange(size_px) + 0.5) / STEP_PX
        self._left = np.minimum(place.astype(int), count - 2)
        self._part = place - self._left

    def between(self, coarse, axis: int, some: slice = slice(None)):
        """Linear interpolation to some of the pixels along an axis of three."""
        left = self._left[some]
        shape = [1, 1, 1]
        shape[axis] = -1
        part = self._part[some].reshape(shape)
        below, above = coarse.take(left, axis), coarse.take(left + 1, axis)
        return below + part * (above - below)
