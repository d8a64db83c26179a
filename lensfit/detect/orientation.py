"""Which mark of a chart is which: its orientation marks, read from the photograph.

A detector numbers what it sees as the photograph stands, from the first mark seen. The
four orientation marks near the middle of a chart (`lensfit.chart.pattern`) say how far
the chart is turned and where its own first mark lies. Every site between the marks that
were found is looked up in the picture: is a dot missing, is there a disc in the cell?
The chart's figure of four must then be found once, at one turn, with nothing else
marked around it.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.interpolate import LinearNDInterpolator
from scipy.ndimage import map_coordinates
from scipy.spatial import QhullError

from lensfit.chart.pattern import LINE_END, ORIENTATION_CELLS, Pattern
from lensfit.detect.observations import POINT, Observations, only
from lensfit.photograph import Photograph

_QUARTER = np.array([[0, -1], [1, 0]])
_MISSING_PART = 0.35
"""A dot is missing where no more of its contrast is left."""
_DISC_PART = 0.35
"""A disc is there from this part of the contrast of lines or squares on."""
_RING_PITCHES = 0.29
_RING = np.array([[np.cos(a), np.sin(a)] for a in np.pi / 4 * np.arange(8)])
_CORNERS = 0.5 * np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])
_SMALLEST_PITCH_PX = 5.0
_LINE_PART = 0.7 * LINE_END
"""Samples further beyond the last crossing than this may lie on a line's end."""
_BEYOND = 0.95
"""Lines go on beyond their last crossing, but nothing is a whole pitch away."""


class Numbering(NamedTuple):
    """From lattice coordinates as found to the chart's own.

    turns : Quarter turns from the chart's axes to the found ones, x towards y.
    shift : ``chart = inverse turn (found) + shift``.
    """

    turns: int
    shift: Float[np.ndarray, " 2"]

    def chart(
        self, found: Float[np.ndarray, "marks 2"]
    ) -> Float[np.ndarray, "marks 2"]:
        """Lattice coordinates on the chart."""
        return found @ np.linalg.matrix_power(_QUARTER, self.turns) + self.shift


def numbered_as_on_chart(
    photograph: Photograph, found: Observations, pattern: Pattern
) -> Observations | None:
    """The same marks with the chart's own indices; None if it cannot be told.

    Parameters
    ----------
    photograph : The picture, scene-linear.
    found : What a detector of the pattern's kind found on it.
    pattern : Of the chart; oriented, or nothing can be told.
    """
    numbering = read_numbering(photograph, found, pattern)
    if numbering is None:
        return None
    lattice = numbering.chart(found.lattice)
    points = found.family == POINT
    lattice[points] = np.round(lattice[points])
    family = found.family
    if numbering.turns % 2:
        family = np.where(points, POINT, 1 - family)
    last = np.array(pattern.lattice_size) - 1
    on_line = ((lattice > -_LINE_PART) & (lattice < last + _LINE_PART)).all(1)
    return only(replace(found, lattice=lattice, family=family), points | on_line)


def read_numbering(
    photograph: Photograph, found: Observations, pattern: Pattern
) -> Numbering | None:
    """How the found lattice lies on the chart's; None if its marks are not seen."""
    if not pattern.oriented:
        return None
    marked = _marked_sites(photograph.luminance_channel, found, pattern)
    if marked is None:
        return None
    low, sites = marked
    fits = _placements(sites, low)
    offset = pattern.site_offset
    numberings = []
    for turns, place in fits:
        turn = np.linalg.matrix_power(_QUARTER, turns)
        first = pattern.first_orientation_site + offset
        numbering = Numbering(turns, first - (place + offset) @ turn)
        chart = numbering.chart(found.lattice)
        last = np.array(pattern.lattice_size) - 1
        if (chart > -_BEYOND).all() and (chart < last + _BEYOND).all():
            numberings.append(numbering)
    return numberings[0] if len(numberings) == 1 else None


def _marked_sites(
    image: Float[np.ndarray, "height width"], found: Observations, pattern: Pattern
) -> tuple[Int[np.ndarray, " 2"], Bool[np.ndarray, "rows columns"]] | None:
    """First site (column, row), and which sites from there on are marked."""
    low = np.floor(found.lattice.min(0) + 1e-6).astype(int)
    high = np.ceil(found.lattice.max(0) - 1e-6).astype(int)
    columns, rows = high - low + 1
    if min(columns, rows) < 3 or columns * rows > 4 * (len(found) + 100):
        return None
    try:
        place = LinearNDInterpolator(found.lattice, found.points_px)
    except QhullError:
        return None
    if _pitch_px(place, (low + high) / 2) < _SMALLEST_PITCH_PX:
        return None
    j, i = np.mgrid[:rows, :columns]
    at = np.stack([i, j], -1) + low + pattern.site_offset

    def light(lattice: np.ndarray) -> np.ndarray:
        x, y = np.moveaxis(place(lattice), -1, 0)
        seen = map_coordinates(
            image, [np.nan_to_num(y) - 0.5, np.nan_to_num(x) - 0.5], order=1,
            mode="nearest",
        )  # fmt: skip
        return np.where(np.isfinite(x), seen, np.nan)

    if pattern.kind == "dot-grid":
        return low, _without_dot(light, at)
    return low, _with_disc(light, at, pattern)


def _without_dot(light, at: np.ndarray) -> Bool[np.ndarray, "rows columns"]:
    """Sites where far less than the neighbours' contrast is left."""
    corners = light(at[..., None, :] + _CORNERS)
    contrast = np.abs(light(at) - _mean(corners))
    usual = np.full(contrast.shape, np.nan)
    for row, column in np.argwhere(np.isfinite(contrast)):
        around = contrast[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
        usual[row, column] = np.nanmedian(around)
    with np.errstate(invalid="ignore"):
        return contrast < _MISSING_PART * usual


def _with_disc(light, at: np.ndarray, pattern: Pattern) -> np.ndarray:
    """Cells whose middle differs from what surrounds it."""
    ring = _mean(light(at[..., None, :] + _RING_PITCHES * _RING))
    if pattern.kind == "line-grid":
        # the middle of a cell's sides
        sides = light(at[..., None, :] + np.array([[0.5, 0.0], [0.0, 0.5]]))
        step = np.abs(_mean(sides) - ring)
    else:
        step = np.abs(np.diff(ring, axis=1, append=np.nan))
    if not np.isfinite(step).any():
        return np.zeros(ring.shape, bool)
    with np.errstate(invalid="ignore"):
        return np.abs(light(at) - ring) > _DISC_PART * np.nanmedian(step)


def _mean(values: np.ndarray) -> np.ndarray:
    """Over what is known of the last axis; NaN where nothing is."""
    known = np.isfinite(values)
    with np.errstate(invalid="ignore"):
        return np.where(known, values, 0).sum(-1) / np.where(
            known.any(-1), known.sum(-1), np.nan
        )


def _pitch_px(place: LinearNDInterpolator, middle: np.ndarray) -> float:
    corners = place(middle + _CORNERS)
    steps = np.linalg.norm(corners[[0, 0]] - corners[[1, 2]], axis=1)
    return float(np.nan_to_num(steps, nan=np.inf).min())


def _placements(
    marked: Bool[np.ndarray, "rows columns"], low: Int[np.ndarray, " 2"]
) -> list[tuple[int, np.ndarray]]:
    """Turns and first sites at which the figure, and nothing else, is seen."""
    sites = np.argwhere(marked)[:, ::-1]
    known = {(int(i), int(j)) for i, j in sites}
    fits = []
    for turns in range(4):
        turn = np.linalg.matrix_power(_QUARTER, turns)
        figure = ORIENTATION_CELLS @ turn.T
        least, most = figure.min(0) - 1, figure.max(0) + 1
        for site in sites:
            cells = {(int(i), int(j)) for i, j in figure + site}
            if not cells <= known:
                continue
            near = ((sites >= site + least) & (sites <= site + most)).all(1)
            if int(near.sum()) == len(cells):
                fits.append((turns, site + low))
    return fits
