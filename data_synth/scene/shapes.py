"""Outlines on a plane: which of its points are covered, in closed form.

Every shape answers exactly for a point; nothing is anti-aliased here. Plane
coordinates in mm, along the plane's two axes. Shapes of many pieces keep a square grid
of cells that lists the pieces near each, so that a point is tested against few.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np
from jaxtyping import Bool, Float, Int

CELLS_ACROSS = 96


class Shape(Protocol):
    """A set of points of a plane."""

    def contains(
        self, place_mm: Float[np.ndarray, "points 2"]
    ) -> Bool[np.ndarray, " points"]:
        """Whether each point belongs to the shape."""
        ...


@dataclass(frozen=True)
class Everywhere:
    """The whole plane."""

    def contains(self, place_mm):
        """All points."""
        return np.ones(len(place_mm), bool)


@dataclass(frozen=True)
class Rectangle:
    """Points between two corners."""

    lower_mm: tuple[float, float]
    upper_mm: tuple[float, float]

    def contains(self, place_mm):
        """Points on the edge belong to it."""
        inside = (place_mm >= np.array(self.lower_mm)) & (
            place_mm <= np.array(self.upper_mm)
        )
        return inside[:, 0] & inside[:, 1]


@dataclass(frozen=True, eq=False)
class Strips:
    """Straight strips of a width: wires and columns.

    Attributes
    ----------
    start_mm, end_mm : Ends of the middle line of each.
    width_mm : Of each, across that line.
    """

    start_mm: Float[np.ndarray, "pieces 2"]
    end_mm: Float[np.ndarray, "pieces 2"]
    width_mm: Float[np.ndarray, " pieces"]

    def contains(self, place_mm):
        """Points of any strip."""
        inside = np.zeros(len(place_mm), bool)
        for start, end, width in zip(
            self.start_mm, self.end_mm, self.width_mm, strict=True
        ):
            length = float(np.hypot(*(end - start)))
            x, y = (end - start) / length
            u, v = place_mm[:, 0] - start[0], place_mm[:, 1] - start[1]
            along = u * x + v * y
            inside |= (
                (np.abs(v * x - u * y) <= width / 2) & (along >= 0) & (along <= length)
            )
        return inside


@dataclass(frozen=True, eq=False)
class Discs:
    """Round discs.

    Attributes
    ----------
    centre_mm, radius_mm : Of each.
    """

    centre_mm: Float[np.ndarray, "pieces 2"]
    radius_mm: Float[np.ndarray, " pieces"]

    def contains(self, place_mm):
        """Points of any disc."""
        return self.piece_at(place_mm) >= 0

    def piece_at(
        self, place_mm: Float[np.ndarray, "points 2"]
    ) -> Int[np.ndarray, " points"]:
        """Number of a disc that holds each point; -1 where there is none."""
        return self._cells.piece_at(place_mm, self._holds)

    @cached_property
    def _cells(self) -> "PieceCells":
        return PieceCells(self.centre_mm, self.radius_mm)

    def _holds(self, piece, place_mm):
        away = place_mm - self.centre_mm[piece]
        return (away**2).sum(axis=1) <= self.radius_mm[piece] ** 2


@dataclass(frozen=True, eq=False)
class Leaves:
    """Pointed leaves: what two equal circles have in common.

    Attributes
    ----------
    centre_mm : Of each.
    half_length_mm, half_width_mm : From the centre to a tip and to the side.
    azimuth_rad : Of the line between the tips.
    """

    centre_mm: Float[np.ndarray, "pieces 2"]
    half_length_mm: Float[np.ndarray, " pieces"]
    half_width_mm: Float[np.ndarray, " pieces"]
    azimuth_rad: Float[np.ndarray, " pieces"]

    def contains(self, place_mm):
        """Points of any leaf."""
        return self._cells.piece_at(place_mm, self._holds) >= 0

    @cached_property
    def _cells(self) -> "PieceCells":
        return PieceCells(self.centre_mm, self.half_length_mm)

    def _holds(self, piece, place_mm):
        u, v = (place_mm - self.centre_mm[piece]).T
        cos, sin = np.cos(self.azimuth_rad[piece]), np.sin(self.azimuth_rad[piece])
        along, across = u * cos + v * sin, np.abs(v * cos - u * sin)
        length, width = self.half_length_mm[piece], self.half_width_mm[piece]
        radius = (length**2 + width**2) / (2 * width)
        return along**2 + (across + radius - width) ** 2 <= radius**2


@dataclass(frozen=True)
class Without:
    """A shape with another cut out of it: a sheet with holes, a ring."""

    whole: Shape
    holes: Shape

    def contains(self, place_mm):
        """Points of the first shape that are not of the second."""
        return self.whole.contains(place_mm) & ~self.holes.contains(place_mm)


@dataclass(frozen=True)
class Union:
    """Several shapes together."""

    shapes: tuple[Shape, ...] = field(default=())

    def contains(self, place_mm):
        """Points of any of them."""
        inside = np.zeros(len(place_mm), bool)
        for shape in self.shapes:
            inside |= shape.contains(place_mm)
        return inside


class PieceCells:
    """A grid over many small pieces that lists those which may reach into each cell."""

    def __init__(
        self,
        centre_mm: Float[np.ndarray, "pieces 2"],
        reach_mm: Float[np.ndarray, " pieces"],
    ):
        reach = reach_mm[:, None]
        low, high = (centre_mm - reach).min(axis=0), (centre_mm + reach).max(axis=0)
        self._low = low
        self._cell = max(float((high - low).max()) / CELLS_ACROSS, 1e-9)
        self._count = np.floor((high - low) / self._cell).astype(int) + 1
        first = np.floor((centre_mm - reach - low) / self._cell).astype(int)
        last = np.floor((centre_mm + reach - low) / self._cell).astype(int)
        listed: list[list[int]] = [[] for _ in range(int(np.prod(self._count)))]
        for piece, ((x0, y0), (x1, y1)) in enumerate(zip(first, last, strict=True)):
            for row in range(y0, min(y1 + 1, self._count[1])):
                for column in range(x0, min(x1 + 1, self._count[0])):
                    listed[row * self._count[0] + column].append(piece)
        most = max(map(len, listed))
        self._table = np.array([row + [-1] * (most - len(row)) for row in listed])

    def piece_at(self, place_mm: Float[np.ndarray, "points 2"], holds):
        """The first listed piece that holds each point; -1 where there is none.

        Parameters
        ----------
        holds : Of numbers of pieces and as many points, whether each holds its point.
        """
        cell = np.floor((place_mm - self._low) / self._cell)
        near = np.flatnonzero(((cell >= 0) & (cell < self._count)).all(axis=1))
        at = cell[near].astype(int)
        flat = at[:, 1] * self._count[0] + at[:, 0]
        found = np.full(len(place_mm), -1)
        for column in self._table.T:
            piece = column[flat]
            some = np.flatnonzero(piece >= 0)
            near, flat, piece = near[some], flat[some], piece[some]
            if not len(near):
                break
            inside = holds(piece, place_mm[near])
            found[near[inside]] = piece[inside]
            near, flat = near[~inside], flat[~inside]
        return found
