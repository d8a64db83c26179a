"""Line grids: every line's centre, sampled between crossings, with exact line numbers.

Crossings are only used to number the lines and to predict where they run; what is
handed on are samples across the lines, each with its noise, so that nothing is counted
twice. Works for bright lines on black and dark lines on light, curved, cropped and
unevenly lit.
"""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import median_filter
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay

from lensfit.detect.lattice import index_lattice
from lensfit.detect.line_curves import Pieces, cut_pieces, move_crossings
from lensfit.detect.line_measure import (
    measure_pieces,
    on_whole_rows,
    profile_half_width,
    read_axis,
)
from lensfit.detect.line_profile import Centres, Window
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
    crossings, indices, candidates = _numbered_crossings(photograph, image, scale)
    pitch_px = _pitch(indices, crossings)

    def window_of(seen: np.ndarray) -> Window:
        half = profile_half_width(seen, indices, crossings, pitch_px, scale.sign)
        return _window(half, pitch_px)

    window = window_of(image)
    pieces, centres = _refined(image, crossings, indices, window, scale.sign)
    kept = _reliable(pieces, centres)
    if not kept.any():
        raise DetectionError(
            "the lines between the crossings are too short or too uneven to measure",
            where=photograph.path,
            remedy="use a grid of thinner lines or move the camera closer",
        )
    # Red and blue may be far more blurred than green.
    channels = np.moveaxis(photograph.pixels, -1, 0)
    own = tuple(max(window, window_of(channel), key=_reach) for channel in channels)
    return _as_observations(
        photograph, _Measured(pieces, centres, own, scale.sign), kept, candidates
    )


def _window(half_width_px: float, pitch_px: float) -> Window:
    """What is read of lines so wide and so far apart."""
    piece_px = int(np.clip(round(pitch_px / PIECES_PER_PITCH), *PIECE_PX))
    fade_px = max(1.0, FADE * half_width_px)
    flank_px = float(np.clip(half_width_px, 2, pitch_px / 8))
    return Window(half_width_px, fade_px, flank_px, piece_px)


def _reach(window: Window) -> float:
    return window.reach_px


def _numbered_crossings(
    photograph: Photograph, image: np.ndarray, scale: RidgeScale
) -> tuple[np.ndarray, np.ndarray, int]:
    """Positions and lattice indices of the crossings, and how many looked like one."""
    crossings, ridge = find_crossings(image, scale)
    indices, valid = index_lattice(crossings)
    indices, on_grid = indices[valid], crossings[valid]
    start, end = _neighbours(indices)
    joined = _joined(on_grid[start], on_grid[end], ridge, scale)
    share = float(joined.mean()) if len(joined) else 0.0
    attached = _attached(len(on_grid), start[joined], end[joined])
    indices, on_grid = indices[attached], on_grid[attached]
    if (
        len(on_grid) < FEWEST_CROSSINGS
        or (np.ptp(indices, axis=0) < 2).any()
        or _explained(on_grid, crossings) < LEAST_EXPLAINED
        or share < LEAST_JOINED
    ):
        colour = "bright" if scale.sign > 0 else "dark"
        raise DetectionError(
            f"no line grid found: {len(crossings)} places look like crossings of "
            f"{colour} lines, but too few lie in a grid and are joined by lines",
            where=photograph.path,
            remedy="check the target's kind and polarity, the focus and the exposure",
        )
    return on_grid, indices - indices.min(0), len(crossings)


def _refined(
    image: np.ndarray,
    crossings: np.ndarray,
    indices: np.ndarray,
    window: Window,
    sign: int,
) -> tuple[Pieces, Centres]:
    """Pieces along well-predicted lines, and their centres."""
    for last in reversed(range(REFINEMENTS)):
        pieces = on_whole_rows(cut_pieces(indices, crossings, window), window.rows)
        centres = measure_pieces(image, pieces, window, sign)
        if last:
            shift_px = centres.dx_px[:, None] * read_axis(pieces)
            crossings = move_crossings(indices, crossings, pieces, shift_px)
    return pieces, centres


def _explained(on_grid: np.ndarray, crossings: np.ndarray) -> float:
    """Part of the candidates within the grid's outline that belong to it."""
    inside = Delaunay(on_grid).find_simplex(crossings) >= 0
    return len(on_grid) / max(int(inside.sum()), 1)


def _joined(
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


def _attached(
    count: int, start: np.ndarray, end: np.ndarray
) -> Bool[np.ndarray, " crossings"]:
    """Crossings that hang together, by ridges, with a good part of all others.

    Print beside a grid has places that look like crossings, some of them where the
    next line would be.
    """
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


def _pitch(indices: np.ndarray, crossings: np.ndarray) -> float:
    """Median distance in pixels between neighbouring crossings."""
    start, end = _neighbours(indices)
    return float(np.median(np.linalg.norm(crossings[end] - crossings[start], axis=1)))


class _Measured(NamedTuple):
    pieces: Pieces
    centres: Centres
    windows: tuple[Window, ...]
    """Of every channel."""
    sign: int


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
        covariance_px2=_covariance(variance, normal, measured.windows[0])[kept],
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
                own.variance_px2 * slant**2, normal, window
            )
    return places, covariances, np.stack(fluxes, -1)


def _covariance(
    across_px2: Float[np.ndarray, " samples"],
    normal: Float[np.ndarray, "samples 2"],
    window: Window,
) -> Float[np.ndarray, "samples 2 2"]:
    """The given variance across the line, that of a piece's length along it."""
    outer = normal[:, :, None] * normal[:, None, :]
    along_px2 = window.rows**2 / 12
    return across_px2[:, None, None] * outer + along_px2 * (np.eye(2) - outer)
