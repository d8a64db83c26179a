"""What a plane looks like: scene-linear radiance in r, g, b at each of its points.

A white surface in full light has radiance 1. Plane coordinates in mm.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Float

Colour = tuple[float, float, float]


class Paint(Protocol):
    """Radiance over a plane."""

    def radiance(
        self, place_mm: Float[np.ndarray, "points 2"]
    ) -> Float[np.ndarray, "points 3"]:
        """Radiance at each point."""
        ...


@dataclass(frozen=True)
class Plain:
    """One colour."""

    colour: Colour

    def radiance(self, place_mm):
        """The same everywhere."""
        return np.tile(np.array(self.colour), (len(place_mm), 1))


@dataclass(frozen=True)
class Checker:
    """Two colours in rectangles; stripes where one side is infinite.

    Attributes
    ----------
    even, odd : Colours.
    side_mm : Sides of a rectangle, along the plane's axes.
    """

    even: Colour
    odd: Colour
    side_mm: tuple[float, float]

    def radiance(self, place_mm):
        """By the parity of the rectangle's column plus row."""
        number = np.floor(place_mm / np.array(self.side_mm)).sum(axis=1)
        return np.where((number % 2 == 0)[:, None], self.even, self.odd)


@dataclass(frozen=True)
class Star:
    """Dark and bright sectors about a point: detail of every size.

    Attributes
    ----------
    sectors : Bright ones.
    """

    centre_mm: tuple[float, float]
    sectors: int
    bright: Colour = (0.9, 0.88, 0.85)
    dark: Colour = (0.04, 0.04, 0.05)

    def radiance(self, place_mm):
        """By the azimuth about the centre."""
        x, y = (place_mm - np.array(self.centre_mm)).T
        turn = np.arctan2(y, x) / (2 * np.pi) * self.sectors
        return np.where((turn % 1 < 0.5)[:, None], self.bright, self.dark)


@dataclass(frozen=True, eq=False)
class Windows:
    """A facade: rectangles of seeded colours with gaps between them.

    Attributes
    ----------
    pitch_mm : From one to the next, along the plane's axes.
    filled : Part of the pitch that a window takes, each way.
    palette : Colours; which one, follows from the window's column and row.
    """

    pitch_mm: tuple[float, float]
    filled: float
    wall: Colour
    palette: Float[np.ndarray, "colours 3"]

    def radiance(self, place_mm):
        """The wall, or the window's colour."""
        place = place_mm / np.array(self.pitch_mm)
        number = np.floor(place)
        inside = (place - number < self.filled).all(axis=1)
        column, row = number.astype(np.int64).T
        mixed = (column * 73856093) ^ (row * 19349663)
        colour = self.palette[(mixed ^ (mixed >> 7)) % len(self.palette)]
        return np.where(inside[:, None], colour, self.wall)


@dataclass(frozen=True, eq=False)
class Waves:
    """A colour with smooth seeded variation: a sum of plane waves.

    Attributes
    ----------
    colour : The mean.
    wave_vector_per_mm : Of each wave, radians per mm.
    phase_rad : Of each wave.
    amplitude : Of each wave in r, g, b; their sum stays below the mean.
    """

    colour: Colour
    wave_vector_per_mm: Float[np.ndarray, "waves 2"]
    phase_rad: Float[np.ndarray, " waves"]
    amplitude: Float[np.ndarray, "waves 3"]

    def radiance(self, place_mm):
        """The sum of the waves."""
        turn = place_mm @ self.wave_vector_per_mm.T + self.phase_rad
        return np.array(self.colour) + np.cos(turn) @ self.amplitude


@dataclass(frozen=True)
class Product:
    """One paint lit through another."""

    paint: Paint
    light: Paint

    def radiance(self, place_mm):
        """The product of both."""
        return self.paint.radiance(place_mm) * self.light.radiance(place_mm)
