"""Targets of which only edges are visible, in waves: checker corners, rims, lines.

In sides (a, b) of a square from the corner, the chart there is bright where

    s(a) s(b) > 0,   s the square wave that changes sign at every integer,

and their place x in cells of the patch follows from the geometry of the view, to second
order about the corner,

    x = S (a, b) + B[(a, b), (a, b)] / 2.

Distortion bends edges by some hundredths of a pixel within a patch, which looks like
coma that moves the corner by a tenth. The pattern is drawn on fractions of a cell,
averaged over each along both axes, and transformed. It is tapered to its mean before
the slowest wave's period ends, since the waves repeat it. Ink that spreads takes as
much from every bright square as it adds to the dark ones beside: if squares are larger
by a small share, the pattern changes equally along all edges. The rim of a large dot is
the edge of its image, an ellipse that is bent as well; the neighbouring dots are drawn
with it. Lines of a grid stand at the integers of both sides, so that crossings and the
next lines are drawn with the line that a patch is about.

Reference: J. W. Goodman, Introduction to Fourier Optics (2005), 2.1.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np
import scipy.fft
from jaxtyping import Bool, Complex, Float

from lensfit.detect.marker_board import MarkerBoard, dark_share

_MEAN, _TINY = 0.5, 1e-6
_PER_WAVE = 4
"""Samples in a cell, at least and for the fastest wave's period; twice as many change
images by less than a thousandth of the contrast."""
_ITERATIONS = 2
"""Each leaves a few hundredths of the bend that is left."""
_TAPER_CELLS = 4.0
"""Cells along the edge of the period in which the pattern is tapered to its mean."""


def square_transfers(
    square_cells: Float[np.ndarray, "corners 2 2"],
    bend_cells: Float[np.ndarray, "corners 2 2 2"],
    markers: Sequence[MarkerBoard | None],
    period: int,
    most: int,
) -> tuple[
    Complex[np.ndarray, "corners down right"], Complex[np.ndarray, "corners down right"]
]:
    """Amplitudes of the pattern about every corner, and their change per share by which
    bright squares are larger; down both ways and to the right.

    Parameters
    ----------
    square_cells : S: sides of the square that is bright ahead, in columns; right, down.
    bend_cells : B, the place on its first axis.
    markers : Of the squares around each corner, ahead as the sides are; None where
        squares are plain.
    period : Of the slowest wave, cells.
    most : Waves besides the constant.
    """

    def picture(k: int, sides: np.ndarray, ramp: np.ndarray, kept: np.ndarray):
        wave, line = _across_edges(sides, ramp)
        bright = _MEAN + wave[..., 0] * wave[..., 1] * kept / 2
        larger = (line[..., 0] + line[..., 1]) * kept / 2
        if (board := markers[k]) is None:
            return bright, larger
        dark, edges = _marker_areas(board, sides, ramp)
        return bright - dark * kept, larger + edges * kept / 2

    return _drawn_in_sides(square_cells, bend_cells, picture, period, most)


def line_transfers(
    side_cells: Float[np.ndarray, "samples 2 2"],
    bend_cells: Float[np.ndarray, "samples 2 2 2"],
    lattice: Float[np.ndarray, "samples 2"],
    line_width: Float[np.ndarray, "samples 2"],
    period: int,
    most: int,
) -> tuple[
    Complex[np.ndarray, "samples down right"], Complex[np.ndarray, "samples down right"]
]:
    """Amplitudes of the lines about every sample, and their change per share by which
    lines are wider; down both ways and to the right.

    Parameters
    ----------
    side_cells : S: from line to line along both axes, in columns; right, down.
    bend_cells : B, the place on its first axis.
    lattice : Place of the sample in pitches.
    line_width : Of the lines across both axes in pitches, negative of dark lines.
    period, most : As for `square_transfers`.
    """

    def picture(k: int, sides: np.ndarray, ramp: np.ndarray, kept: np.ndarray):
        inside, edges = _within_lines(sides + lattice[k], np.abs(line_width[k]), ramp)
        beside = (1 - inside) * kept[..., None]
        light = (1 - (1 - inside).prod(-1)) * kept
        wider = edges[..., 0] * beside[..., 1] + edges[..., 1] * beside[..., 0]
        return (light, wider) if (line_width[k] > 0).all() else (1 - light, -wider)

    return _drawn_in_sides(side_cells, bend_cells, picture, period, most)


def _drawn_in_sides(
    side_cells: Float[np.ndarray, "patches 2 2"],
    bend_cells: Float[np.ndarray, "patches 2 2 2"],
    picture: Callable[..., tuple[np.ndarray, np.ndarray]],
    period: int,
    most: int,
) -> tuple[
    Complex[np.ndarray, "patches down right"], Complex[np.ndarray, "patches down right"]
]:
    """Amplitudes of a pattern about every patch, and of its change by size.

    Parameters
    ----------
    side_cells, bend_cells : S and B of the pattern's units.
    picture : Of the patch's number, the places of samples in these units, half the
        width of a sample in them, as wide as the ramp of an edge, and the taper.
    """
    per_cell = _samples_per_cell(period, most)
    size, places = per_cell * period, _places(period, per_cell)
    kept = _taper(places, period).reshape(size, size)
    drawn = np.zeros((2, len(side_cells), 2 * most + 1, most + 1), np.complex64)
    for k, of_patch in enumerate(side_cells):
        ramp = np.hypot(*np.linalg.inv(of_patch).T) / (2 * per_cell)
        sides = _in_units(places, of_patch, bend_cells[k]).reshape(size, size, 2)
        for part, drawing in enumerate(picture(k, sides, ramp, kept)):
            drawn[part, k] = _amplitudes(drawing, most)
    return drawn[0], drawn[1]


def rim_transfers(
    disc_cells: Float[np.ndarray, "rims 2 2"],
    bend_cells: Float[np.ndarray, "rims 2 2 2"],
    to_middle_cells: Float[np.ndarray, "rims 2"],
    neighbour_offsets_cells: Float[np.ndarray, "rims neighbours 2"],
    period: int,
    most: int,
) -> Complex[np.ndarray, "rims down right"]:
    """Amplitudes of a dot about a place on its rim, down both ways and to the right.

    Parameters
    ----------
    disc_cells : S: from the unit disc to the image of the dot, at the rim.
    bend_cells : B, the place on its first axis.
    to_middle_cells : From the rim to the middle of the dot.
    neighbour_offsets_cells : From the middle to dots of the same size; NaN for none.
    period, most : As for `square_transfers`.
    """
    per_cell = _samples_per_cell(period, most)
    size, places = per_cell * period, _places(period, per_cell)
    kept = _taper(places, period).reshape(size, size)
    drawn = np.zeros((len(disc_cells), 2 * most + 1, most + 1), np.complex64)
    for k, disc in enumerate(disc_cells):
        beside = neighbour_offsets_cells[k][
            np.isfinite(neighbour_offsets_cells[k]).all(-1)
        ]
        middles = to_middle_cells[k] + np.concatenate([np.zeros((1, 2)), beside])
        near = np.linalg.norm(middles, axis=-1) < period + np.abs(disc).sum()
        at = _in_units(places, disc, bend_cells[k])
        middles = _in_units(middles[near], disc, bend_cells[k])
        light = sum(_unit_disc(at - middle, disc, per_cell) for middle in middles)
        picture = _MEAN + (np.reshape(light, (size, size)) - _MEAN) * kept
        drawn[k] = _amplitudes(picture, most)
    return drawn


def is_square_ahead_bright(
    light: Float[np.ndarray, "corners rows columns"],
    use: Bool[np.ndarray, "corners rows columns"],
    corner_cells: Float[np.ndarray, "corners 2"],
    square_cells: Float[np.ndarray, "corners 2 2"],
) -> Bool[np.ndarray, " corners"]:
    """Whether the square ahead along both sides is a bright one.

    Parameters
    ----------
    corner_cells : From the corner of the picture, right and down.
    """
    middle = np.arange(light.shape[-1]) + 0.5
    places = np.stack(np.meshgrid(middle, middle), -1)
    away = places[None] - corner_cells[:, None, None]
    sides = np.einsum("nij,nrcj->nrci", np.linalg.inv(square_cells), away)
    ahead = np.sign(np.sin(np.pi * sides)).prod(-1) * use
    light = light - np.mean(light, (1, 2), keepdims=True)
    return np.sum(ahead * light, (1, 2)) > 0


def _samples_per_cell(period: int, most: int) -> int:
    return _PER_WAVE * math.ceil(most / period)


def _places(period: int, per_cell: int) -> Float[np.ndarray, "samples 2"]:
    """Of all samples, cells from the middle."""
    along = (np.arange(per_cell * period) + 0.5) / per_cell - period / 2
    return np.stack(np.meshgrid(along, along), -1).reshape(-1, 2).astype(np.float32)


def _in_units(
    places: Float[np.ndarray, "places 2"],
    sides: Float[np.ndarray, "2 2"],
    bend: Float[np.ndarray, "2 2 2"],
) -> Float[np.ndarray, "places 2"]:
    """The units whose images are there, by fixed-point iteration."""
    inverse = np.linalg.inv(sides)
    straight = places @ inverse.T.astype(places.dtype)
    bent = (inverse @ bend.reshape(2, 4) / 2).astype(places.dtype)
    found = straight
    for _ in range(_ITERATIONS):
        square = found[:, :, None] * found[:, None]
        found = straight - square.reshape(-1, 4) @ bent.T
    return found


def _unit_disc(
    away: Float[np.ndarray, "samples 2"], disc: Float[np.ndarray, "2 2"], per_cell: int
) -> Float[np.ndarray, " samples"]:
    """1 inside a dot, 0 outside, about its middle in units of its radius."""
    inverse = np.linalg.inv(disc)
    reach = np.maximum(np.hypot(*away.T), _TINY)
    # Its slope by the place gives the width of the ramp of a sample.
    slope = np.hypot(*(away @ inverse).T) / reach
    return np.clip((1 - reach) / slope * per_cell + 0.5, 0, 1)


def _taper(
    places: Float[np.ndarray, "samples 2"], period: int
) -> Float[np.ndarray, " samples"]:
    """1 inside, 0 at the edge of the period."""
    inside = (period / 2 - np.abs(places)) / _TAPER_CELLS
    smooth = np.sin(np.pi / 2 * np.clip(inside, 0, 1)) ** 2
    return smooth.prod(-1)


def _across_edges(
    sides: Float[np.ndarray, "*shape 2"], ramp: Float[np.ndarray, "2"]
) -> tuple[Float[np.ndarray, "*shape 2"], Float[np.ndarray, "*shape 2"]]:
    """Square wave along each side, and a line of area 1 along each of its edges."""
    edge = np.round(sides)
    off = sides - edge
    even = 1 - 2 * np.abs(edge % 2)
    wave = even * np.clip(off / ramp, -1, 1)
    return wave, (np.abs(off) < ramp) / (2 * ramp)


def _marker_areas(
    markers: MarkerBoard,
    sides: Float[np.ndarray, "*shape 2"],
    ramp: Float[np.ndarray, "2"],
) -> tuple[Float[np.ndarray, "*shape"], Float[np.ndarray, "*shape"]]:
    """Part of each sample within dark modules, and lines of area 1 along their edges.

    Parameters
    ----------
    sides : From the corner in the middle of the squares.
    """
    places = sides + np.array(markers.dark.shape[:2]) / 2
    steps = np.diag(ramp)

    def dark(moved: np.ndarray) -> np.ndarray:
        return dark_share(markers.dark, markers.ratio, places + moved, 2 * ramp)

    across = np.stack([dark(step) - dark(-step) for step in steps], -1)
    return dark(np.zeros(2)), np.sum(np.abs(across) / (2 * ramp), -1)


def _within_lines(
    sides: Float[np.ndarray, "*shape 2"],
    line_width: Float[np.ndarray, "2"],
    ramp: Float[np.ndarray, "2"],
) -> tuple[Float[np.ndarray, "*shape 2"], Float[np.ndarray, "*shape 2"]]:
    """Part of each sample within a line across each axis, and its change per share by
    which lines are wider."""
    off = np.abs(sides - np.round(sides))
    half = line_width / 2
    overlap = np.minimum(off + ramp, half) - np.maximum(off - ramp, -half)
    inside = np.clip(overlap / (2 * ramp), 0, 1)
    at_edges = (np.abs(off - half) < ramp).astype(float) + (np.abs(off + half) < ramp)
    return inside, half * at_edges / (2 * ramp)


def _amplitudes(
    picture: Float[np.ndarray, "size size"], most: int
) -> Complex[np.ndarray, "down right"]:
    """Of exp(i k x) about the picture's middle."""
    size = len(picture)
    found = np.asarray(scipy.fft.rfft2(picture.astype(np.float32)))
    right, down = np.arange(most + 1), np.arange(-most, most + 1)
    # Samples lie half a step from the edge, half a period from the middle, and are
    # means over themselves.
    at = [(-1.0) ** n * np.exp(-1j * np.pi * n / size) for n in (down, right)]
    sampled = [np.sinc(n / size) for n in (down, right)]
    shift = (at[0] / sampled[0])[:, None] * (at[1] / sampled[1])
    return found[down][:, right] * shift / size**2
