"""Line grids: every line's centre, sampled between crossings, with exact line numbers.

Crossings are only used to number the lines and to predict where they run; what is
handed on are samples across the lines, each with its noise, so that nothing is counted
twice. Works for bright lines on black and dark lines on light, curved, cropped and
unevenly lit.

Print beside a grid has places that look like crossings too, some of them where the next
line would be. Those of the grid lie on one lattice and hang together by ridges.
"""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import median_filter
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay

from lensfit.detect.lattice import index_lattice
from lensfit.detect.line_curves import Pieces, cut_pieces, move_crossings
from lensfit.detect.line_measure import (
    LineShape,
    line_shape,
    mean_profiles,
    measure_pieces,
    pieces_on_whole_rows,
    profile_half_width_px,
    read_axis,
)
from lensfit.detect.line_profile import Centres, MeasuredLines, Window
from lensfit.detect.observations import Observations
from lensfit.detect.ridges import RidgeScale, find_crossings, strongest_ridge
from lensfit.errors import DetectionError
from lensfit.photograph import Photograph

FEWEST_CROSSINGS = 9
LEAST_EXPLAINED = 0.4
LEAST_JOINED = 0.6
LEAST_ATTACHED = 0.1
"""Crossings that hang together are of the grid from this part of all of them on."""
BREAK = 0.25
"""A line is broken where its ridge is weaker than this part of that at its ends."""


class Crossings(NamedTuple):
    """The numbered crossings of a grid.

    Attributes
    ----------
    points_px : Where they are.
    indices : Of the two lines that cross, from 0.
    candidates : How many places looked like one.
    """

    points_px: Float[np.ndarray, "crossings 2"]
    indices: Int[np.ndarray, "crossings 2"]
    candidates: int

    @property
    def pitch_px(self) -> float:
        """Median distance between neighbours."""
        start, end = _neighbours(self.indices)
        steps = self.points_px[end] - self.points_px[start]
        return float(np.median(np.linalg.norm(steps, axis=1)))


def numbered_crossings(
    image: Float[np.ndarray, "height width"], scale: RidgeScale, where: Path
) -> Crossings:
    """The crossings of the lines that are ridges of this scale.

    Parameters
    ----------
    image : Samples, channel units.
    where : The photograph, for what is told of a grid that was not found.

    Raises
    ------
    DetectionError : fewer than nine crossings of a connected grid were seen.
    """
    crossings, ridge = find_crossings(image, scale)
    indices, valid = index_lattice(crossings)
    indices, on_grid = indices[valid], crossings[valid]
    start, end = _neighbours(indices)
    joined = _are_joined(on_grid[start], on_grid[end], ridge, scale)
    share = float(joined.mean()) if len(joined) else 0.0
    attached = _are_attached(len(on_grid), start[joined], end[joined])
    indices, on_grid = indices[attached], on_grid[attached]
    if (
        len(on_grid) < FEWEST_CROSSINGS
        or (np.ptp(indices, axis=0) < 2).any()
        or _explained_share(on_grid, crossings) < LEAST_EXPLAINED
        or share < LEAST_JOINED
    ):
        colour = "bright" if scale.sign > 0 else "dark"
        raise DetectionError(
            f"no line grid found: {len(crossings)} places look like crossings of "
            f"{colour} lines, but too few lie in a grid and are joined by lines",
            where=where,
            remedy="check the target's kind and polarity, the focus and the exposure",
        )
    return Crossings(on_grid, indices - indices.min(0), len(crossings))


def _explained_share(on_grid: np.ndarray, crossings: np.ndarray) -> float:
    """Part of the candidates within the grid's outline that belong to it."""
    inside = Delaunay(on_grid).find_simplex(crossings) >= 0
    return len(on_grid) / max(int(inside.sum()), 1)


def _are_joined(
    start: np.ndarray, end: np.ndarray, ridge: np.ndarray, scale: RidgeScale
) -> Bool[np.ndarray, " pairs"]:
    """Which neighbouring crossings a ridge joins without a break."""
    if not len(start):
        return np.zeros(0, bool)
    reach = 2 * round(scale.sigma_px) + 1
    ridge = cv2.dilate(ridge, np.ones((reach, reach), np.uint8))
    fraction = np.linspace(0, 1, 11)[:, None, None]
    path = start + (end - start) * fraction
    x, y = np.moveaxis(path, -1, 0).astype(int)
    strength = ridge[y, x]
    return strength[3:-3].min(0) > BREAK * strength[[0, -1]].mean(0)


def _are_attached(
    count: int, start: np.ndarray, end: np.ndarray
) -> Bool[np.ndarray, " crossings"]:
    """Crossings that hang together, by ridges, with a good part of all others."""
    if not count:
        return np.zeros(0, bool)
    links = coo_matrix((np.ones(len(start)), (start, end)), (count, count))
    _, part = connected_components(links, directed=False)
    return np.bincount(part)[part] >= LEAST_ATTACHED * count


def _neighbours(indices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of crossings one step apart along i or along j."""
    at = {tuple(place): k for k, place in enumerate(indices.tolist())}
    pairs = [
        (k, at[ahead])
        for (i, j), k in at.items()
        for ahead in ((i + 1, j), (i, j + 1))
        if ahead in at
    ]
    start, end = np.array(pairs, int).reshape(-1, 2).T
    return start, end


PIECE_PX = (6, 16)
"""Shortest and longest piece that makes one sample: about the correlation length of
compression noise and blur."""
PIECES_PER_PITCH = 10
REFINEMENTS = 2
"""Rounds of measuring; each predicts the lines better for the next."""
FADE = 0.25
"""Width of the profile window's soft edge, in half widths."""
OUTLIER_SIGMAS = 6.0
OUTLIER_PX = 0.05
FLUX_TOLERANCE = 0.3
"""Largest departure of a sample's flux from its neighbours' on the line."""


def find_lines(photograph: Photograph, *, polarity: str | None = None) -> Observations:
    """Find a line grid and measure its lines.

    Parameters
    ----------
    photograph : The picture, scene-linear.
    polarity : "bright" lines on black, "dark" lines on light, None: by the image.

    Returns
    -------
    Samples of `LINE_OF_CONSTANT_I` and `LINE_OF_CONSTANT_J`; integers across the line,
    interpolated along it. The covariance along the line is that of a piece's length.

    Raises
    ------
    DetectionError : fewer than nine crossings of a connected grid were seen.
    """
    image = np.ascontiguousarray(photograph.luminance_channel, np.float32)
    scale = strongest_ridge(image, polarity)
    crossings = numbered_crossings(image, scale, photograph.path)
    windows, shape = _windows_and_shape(photograph, crossings, scale.sign)
    window = windows[photograph.luminance_index]
    pieces, centres = _refined_pieces(image, crossings, window, scale.sign)
    kept = _reliable(pieces, centres)
    if not kept.any():
        raise DetectionError(
            "the lines between the crossings are too short or too uneven to measure",
            where=photograph.path,
            remedy="use a grid of thinner lines or move the camera closer",
        )
    measured = _Measured(pieces, centres, windows, scale.sign)
    found = _as_observations(photograph, measured, kept, crossings.candidates)
    if shape is None:
        return found
    width = shape.width_px / crossings.pitch_px if shape.is_resolved else None
    return replace(
        found,
        edge_blur_px=np.full(len(found), shape.deviation_px),
        lines=MeasuredLines(width, windows),
    )


def _windows_and_shape(
    photograph: Photograph, crossings: Crossings, sign: int
) -> tuple[tuple[Window, ...], LineShape | None]:
    """What is read of the lines in every channel: no less than where they are found;
    and their shape in the channel that positions refer to.

    Red and blue may be far more blurred than green.
    """
    pitch_px = crossings.pitch_px
    profiles = [
        mean_profiles(channel, crossings.indices, crossings.points_px, pitch_px, sign)
        for channel in np.moveaxis(photograph.pixels, -1, 0)
    ]
    half_widths_px = [profile_half_width_px(one, pitch_px) for one in profiles]
    least_px = half_widths_px[photograph.luminance_index]
    windows = tuple(_window(max(own, least_px), pitch_px) for own in half_widths_px)
    return windows, line_shape(profiles[photograph.luminance_index])


def _window(half_width_px: float, pitch_px: float) -> Window:
    """What is read of lines so wide and so far apart."""
    piece_px = int(np.clip(round(pitch_px / PIECES_PER_PITCH), *PIECE_PX))
    fade_px = max(1.0, FADE * half_width_px)
    flank_px = float(np.clip(half_width_px, 2, pitch_px / 8))
    return Window(half_width_px, fade_px, flank_px, piece_px)


def _refined_pieces(
    image: np.ndarray, crossings: Crossings, window: Window, sign: int
) -> tuple[Pieces, Centres]:
    """Pieces along well-predicted lines, and their centres."""
    indices, points_px = crossings.indices, crossings.points_px
    for last in reversed(range(REFINEMENTS)):
        pieces = pieces_on_whole_rows(
            cut_pieces(indices, points_px, window), window.rows
        )
        centres = measure_pieces(image, pieces, window, sign)
        if last:
            shift_px = centres.dx_px[:, None] * read_axis(pieces)
            points_px = move_crossings(indices, points_px, pieces, shift_px)
    return pieces, centres


class _Measured(NamedTuple):
    pieces: Pieces
    centres: Centres
    windows: tuple[Window, ...]
    """Of every channel."""
    sign: int

    @property
    def rows(self) -> int:
        """Of a piece, the same in every channel."""
        return self.windows[0].rows


def _reliable(pieces: Pieces, centres: Centres) -> Bool[np.ndarray, " pieces"]:
    """Samples that agree in place and in flux with their neighbours on the line."""
    kept = centres.measured & np.isfinite(centres.variance_px2)
    number = pieces.number.astype(float)
    order = np.lexsort([pieces.along, number, pieces.family])
    order = order[kept[order]]
    if not len(order):
        return kept
    line = np.stack([pieces.family, pieces.number], -1)[order]
    breaks = np.flatnonzero((np.diff(line, axis=0) != 0).any(1)) + 1
    for own in np.split(order, breaks):
        place, flux = centres.dx_px[own], centres.flux_per_row[own]
        usual = median_filter(place, 7, mode="nearest")
        usual_flux = median_filter(flux, 15, mode="nearest")
        scatter = 1.4826 * np.median(np.abs(place - usual))
        limit = max(OUTLIER_SIGMAS * scatter, OUTLIER_PX)
        kept[own] = np.abs(place - usual) < limit
        kept[own] &= np.abs(flux - usual_flux) < FLUX_TOLERANCE * usual_flux
    return kept


def _as_observations(
    photograph: Photograph,
    measured: _Measured,
    kept: Bool[np.ndarray, " pieces"],
    candidates: int,
) -> Observations:
    """The kept samples in the shared record, measured in every channel."""
    pieces, centres = measured.pieces, measured.centres
    axis = read_axis(pieces)
    tangent = pieces.tangent_px
    tangent = tangent / np.linalg.norm(tangent, axis=1, keepdims=True)
    normal = np.stack([tangent[:, 1], -tangent[:, 0]], -1)
    normal *= np.where((normal * axis).sum(1, keepdims=True) < 0, -1, 1)
    slant = (normal * axis).sum(1)
    points = pieces.points_px + centres.dx_px[:, None] * axis
    channel_points, channel_covariance, flux = _channels(
        photograph, measured, points, normal, slant
    )
    lattice = np.empty((len(points), 2))
    rows = np.arange(len(points))
    lattice[rows, pieces.family] = pieces.number
    lattice[rows, 1 - pieces.family] = pieces.along
    variance = centres.variance_px2 * slant**2
    saturated = centres.highest >= photograph.saturation
    return Observations(
        lattice=lattice[kept],
        points_px=points[kept],
        covariance_px2=_covariance(variance, normal, measured.rows)[kept],
        family=pieces.family[kept],
        normal=normal[kept],
        saturated=saturated[kept],
        overlapping=np.zeros(int(kept.sum()), bool),
        channel_points_px=channel_points[:, kept],
        channel_covariance_px2=channel_covariance[:, kept],
        flux=flux[kept],
        diameter_px=np.full(int(kept.sum()), np.nan),
        image_size_px=photograph.size_px,
        candidates=candidates,
        bright=measured.sign > 0,
    )


def _channels(
    photograph: Photograph,
    measured: _Measured,
    points: np.ndarray,
    normal: np.ndarray,
    slant: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions, covariances and fluxes per channel; across the line only."""
    pieces, centres, windows, sign = measured
    places = np.full((3, *points.shape), np.nan)
    covariances = np.full((3, len(points), 2, 2), np.nan)
    colours = photograph.pixels.shape[2]
    fluxes = []
    for channel, window in enumerate(windows):
        image = photograph.pixels[..., channel]
        own = measure_pieces(image, pieces, window, sign, centres.dx_px)
        bright = own.flux_per_row * slant if sign > 0 else own.background
        fluxes.append(np.where(own.measured, bright, np.nan))
        if colours == 3:
            across = (own.dx_px - centres.dx_px) * slant
            places[channel] = points + across[:, None] * normal
            covariances[channel] = _covariance(
                own.variance_px2 * slant**2, normal, measured.rows
            )
    return places, covariances, np.stack(fluxes, -1)


def _covariance(
    across_px2: Float[np.ndarray, " samples"],
    normal: Float[np.ndarray, "samples 2"],
    rows: int,
) -> Float[np.ndarray, "samples 2 2"]:
    """The given variance across the line, that of a piece's length along it."""
    outer = normal[:, :, None] * normal[:, None, :]
    along_px2 = rows**2 / 12
    return across_px2[:, None, None] * outer + along_px2 * (np.eye(2) - outer)
