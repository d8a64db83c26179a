"""The lens that a camera shader for Cycles holds: rays as series, and what clips them.

Series are sums of Chebyshev polynomials over the picture and the stop (`ray_series`
fits them, `cycles_osl` writes them).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from numpy.polynomial.chebyshev import chebvander

from lensfit.optics.stop_places import StopArcs

Points = Float[np.ndarray, "rays 2"]
WAVELENGTHS = (-1, 0, 1)
"""Of a band, of equal weight: how many times the change counts."""


class Series(NamedTuple):
    """A sum of products of Chebyshev's polynomials, several values at once.

    Attributes
    ----------
    degrees : In x and y of the position, then of the place.
    values : Coefficients.
    """

    degrees: Int[np.ndarray, "terms 4"]
    values: Float[np.ndarray, "terms columns"]

    def at(
        self, positions: Points, places: Points
    ) -> Float[np.ndarray, "rays columns"]:
        """The sums of rays; positions in halves of the frame."""
        field, place, dense = self._parts(positions, places)
        return np.einsum("npc,np->nc", np.tensordot(field, dense, 1), place)

    def on_grid(self, positions: Points, places: Points) -> np.ndarray:
        """The sums of every position with every place, (positions, places, columns)."""
        field, place, dense = self._parts(positions, places)
        return np.einsum("npc,mp->nmc", np.tensordot(field, dense, 1), place)

    def _parts(self, positions: Points, places: Points) -> tuple[np.ndarray, ...]:
        """Products of position and of place, and the coefficients of both."""
        found, index = [], []
        for at, degrees in zip(
            (positions, places), np.split(self.degrees, 2, 1), strict=True
        ):
            pairs, which = np.unique(degrees, axis=0, return_inverse=True)
            table = chebvander(at, int(pairs.max(initial=0)))
            found.append(table[:, 0, pairs[:, 0]] * table[:, 1, pairs[:, 1]])
            index.append(which.reshape(-1))
        dense = np.zeros((*(part.shape[1] for part in found), self.values.shape[1]))
        dense[index[0], index[1]] = self.values
        return *found, dense


class ChannelSeries(NamedTuple):
    """Rays of one channel.

    Attributes
    ----------
    x, y : Columns: direction (tangent), its change with the wavelength, crossing of the
        pupil's plane in mm, its change.
    brightness : Of the position alone.
    """

    x: Series
    y: Series
    brightness: Series


@dataclass(frozen=True, eq=False)
class LensOpening:
    """What stops rays.

    Attributes
    ----------
    axis_mm : Where the axis meets the sensor.
    field_radius_mm, stop_radius : Units, as in `lensfit.optics.pupil`.
    stop_shift, rim_shift, rim_radius : As there.
    arcs : The blades.
    """

    axis_mm: tuple[float, float]
    field_radius_mm: float
    stop_radius: float
    stop_shift: tuple[float, float]
    rim_shift: tuple[tuple[float, float], ...]
    rim_radius: tuple[tuple[float, float], ...]
    arcs: StopArcs

    def passes(self, positions_mm: Points, places: Points) -> np.ndarray:
        """Whether a ray of each position comes through; places in `arcs.reach`."""
        h = (positions_mm - np.array(self.axis_mm)) / self.field_radius_mm
        square = np.sum(h * h, -1, keepdims=True)
        place = places * self.arcs.reach
        shift = self.stop_shift[0] + self.stop_shift[1] * square
        s = h * shift * self.stop_radius**2 + self.stop_radius * place
        found = self.arcs.passes(place)
        for (a0, a1), (r0, r1) in zip(self.rim_shift, self.rim_radius, strict=True):
            away = s - h * (a0 + a1 * square)
            found &= np.sum(away**2, -1) <= (r0 + r1 * square[:, 0]) ** 2
        return found


@dataclass(frozen=True, eq=False)
class CyclesLens:
    """A lens as the shader holds it.

    Attributes
    ----------
    width_mm : Of the sensor that the frame spans.
    half_mm : Half width and height over which the sums hold.
    channels : Red, green and blue; or one for all.
    weight : Light of a place against that of others of its position.
    """

    width_mm: float
    half_mm: tuple[float, float]
    channels: tuple[ChannelSeries, ...]
    weight: Series
    opening: LensOpening

    def rays(
        self, positions_mm: Points, places: Points, channel: int, wavelength: int
    ) -> tuple[Points, Points]:
        """Tangents of rays in the scene, and where they cross the pupil's plane, mm.

        Parameters
        ----------
        places : In units of the reach of the stop.
        wavelength : One of `WAVELENGTHS`.
        """
        series = self.channels[min(channel, len(self.channels) - 1)]
        positions = positions_mm / np.array(self.half_mm)
        both = [one.at(positions, places) for one in (series.x, series.y)]
        found = np.stack(
            [part[:, ::2] + wavelength * part[:, 1::2] for part in both], 1
        )
        return found[..., 0], found[..., 1]

    def light(self, positions_mm: Points, places: Points, channel: int) -> np.ndarray:
        """Throughput of rays, the mean over all places being the brightness."""
        positions = positions_mm / np.array(self.half_mm)
        series = self.channels[min(channel, len(self.channels) - 1)]
        weight = self.weight.at(positions, places)[:, 0]
        brightness = series.brightness.at(positions, places)[:, 0]
        return self.opening.passes(positions_mm, places) * weight * brightness
