"""Inner corners of checkerboards, whole or cut, and of ChArUco boards.

A checker corner is a saddle of brightness; corners are joined by the edges between
squares, and following those edges numbers them however the board is cut, turned or
distorted. Corners of one board alternate in sign, which weeds out the rest. Positions
come from fitting a blurred corner (`detect.corner_fit`) in each channel. ChArUco
markers, found by OpenCV, only say which corner is which.

Where four sectors of alternating brightness meet, the determinant of the image's
Hessian is strongly negative. Edges, texture and the outer corners of a board have
saddles too; on a small circle around a true one the brightness goes up and down exactly
twice, so that its second harmonic outweighs all others.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import map_coordinates

from lensfit.detect.corner_fit import WINDOW_PER_SQUARE, CornerFit, fit_corners
from lensfit.detect.graph import ROUGHEST_LATTICE, find_links, index_linked, roughness
from lensfit.detect.marker_board import MarkerBoard, marker_board
from lensfit.detect.observations import POINT, Observations
from lensfit.detect.ridges import hessian, subpixel_peaks
from lensfit.errors import DetectionError
from lensfit.photograph import Photograph

RING_SAMPLES = 24
RING_RADIUS = 2.0
"""Radius of the test circle, in smoothing scales."""
LEAST_SECOND_HARMONIC = 0.75
"""Its least part in the power of the circle, the mean left out."""
FAINTEST = 0.02
"""Least amplitude on the circle, as display-referred brightness of full scale 1."""


def display_brightness(
    image: Float[np.ndarray, "height width"],
) -> Float[np.ndarray, "height width"]:
    """Square root of the light, full scale near 1: noise and shade evened out."""
    top = max(float(np.percentile(image[::4, ::4], 99.5)), 1e-12)
    return np.sqrt(np.clip(image / top, 0, 1.5)).astype(np.float32)


def find_saddles(
    brightness: Float[np.ndarray, "height width"], sigma_px: float
) -> Float[np.ndarray, "saddles 2"]:
    """Saddles of four alternating sectors, to a fraction of a pixel.

    Parameters
    ----------
    brightness : As of `display_brightness`.
    sigma_px : Smoothing, pixels; squares should be at least four times wider.

    Returns
    -------
    Positions in pixels, first pixel centre at (0.5, 0.5).
    """
    xx, xy, yy = hessian(brightness, sigma_px)
    peaks = subpixel_peaks(np.maximum(xy**2 - xx * yy, 0), max(2, round(sigma_px)))
    smooth = cv2.GaussianBlur(brightness, (0, 0), sigma_px / 2)
    harmonics = np.abs(np.fft.rfft(_ring(smooth, peaks, RING_RADIUS * sigma_px)))
    power = harmonics[:, 1:7] ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        share = power[:, 1] / power.sum(1)
    amplitude = 2 * harmonics[:, 2] / RING_SAMPLES
    return peaks[(share > LEAST_SECOND_HARMONIC) & (amplitude > FAINTEST)]


def _ring(image: np.ndarray, centres: np.ndarray, radius_px: float) -> np.ndarray:
    """Values on a circle around each centre."""
    angle = 2 * np.pi * np.arange(RING_SAMPLES) / RING_SAMPLES
    x = centres[:, :1] + radius_px * np.cos(angle)
    y = centres[:, 1:] + radius_px * np.sin(angle)
    return map_coordinates(image, [y - 0.5, x - 0.5], order=1, mode="nearest")


SCALES_PX = (1.5, 2.5, 4.0, 7.0)
FEWEST_CORNERS = 9
FAINTEST_EDGE = 0.02
"""Least step of display brightness across an edge that joins two corners."""
EDGE_OFFSET = 0.08
"""How far beside an edge it is probed, in lengths of the edge."""
_PART_OF_MARGIN = 0.9
"""Of the white margin around a marker, which the corner's window may use."""


@dataclass(frozen=True)
class _Corners:
    """Indexed corners before they are fitted."""

    points_px: Float[np.ndarray, "corners 2"]
    indices: Int[np.ndarray, "corners 2"]
    candidates: int


def find_checkerboard(photograph: Photograph) -> Observations:
    """Find the inner corners of a checkerboard, all of it or a part.

    Parameters
    ----------
    photograph : The picture, scene-linear.

    Returns
    -------
    Corners as `POINT`, indices counted from the smallest seen, i to the right and j
    down; flux is the brightness of the white squares around.

    Raises
    ------
    DetectionError : fewer than nine connected corners were seen.
    """
    brightness = display_brightness(photograph.luminance_channel)
    best = _Corners(np.zeros((0, 2)), np.zeros((0, 2), int), 0)
    for scale in SCALES_PX:
        seen = _indexed_corners(brightness, scale)
        if len(seen.points_px) > len(best.points_px):
            best = seen
        best = best if best.candidates else seen
    if len(best.points_px) < FEWEST_CORNERS:
        raise DetectionError(
            f"no checkerboard found: {best.candidates} places look like corners of "
            f"four squares, {len(best.points_px)} of them joined by edges",
            where=photograph.path,
            remedy="check the target's kind, the focus and the exposure",
        )
    return _settled_corners(photograph, best, None)


def find_charuco(photograph: Photograph, board: Mapping[str, Any]) -> Observations:
    """Find the corners of a ChArUco board.

    Parameters
    ----------
    photograph : The picture, scene-linear.
    board : `squares` (columns, rows), `dictionary` ("DICT_5X5_250" and the like) and
        `marker_ratio`, side of a marker over that of its square.

    Returns
    -------
    Corners as `POINT`; (0, 0) is the board's own first inner corner, so that indices
    agree between photographs.

    Raises
    ------
    DetectionError : no or too few markers of that board were seen.
    """
    columns, rows = board["squares"]
    ratio = float(board.get("marker_ratio") or 0.75)
    brightness = display_brightness(photograph.luminance_channel)
    picture = np.clip(brightness * 255, 0, 255).astype(np.uint8)
    best = _Corners(np.zeros((0, 2)), np.zeros((0, 2), int), 0)
    found_on = None
    for legacy in (False, True):
        pattern = cv2.aruco.CharucoBoard(
            (columns, rows), 1.0, ratio, _dictionary(photograph, board["dictionary"])
        )
        pattern.setLegacyPattern(legacy)
        found, numbers, _, markers = cv2.aruco.CharucoDetector(pattern).detectBoard(
            picture
        )
        if found is not None and len(found) > len(best.points_px):
            number = np.asarray(numbers).ravel()
            indices = np.stack([number % (columns - 1), number // (columns - 1)], -1)
            points = np.asarray(found, float).reshape(-1, 2) + 0.5
            best = _Corners(points, indices, len(points))
            found_on = marker_board(pattern)
        if not best.candidates and markers is not None:
            best = _Corners(best.points_px, best.indices, len(markers))
    if len(best.points_px) < 4:
        raise DetectionError(
            f"no ChArUco board of {columns} x {rows} squares found: "
            f"{best.candidates} markers and {len(best.points_px)} corners were seen",
            where=photograph.path,
            remedy="check squares, dictionary and marker_ratio of the target, and that "
            "the markers are sharp and not mirrored",
        )
    return _settled_corners(photograph, best, found_on)


def _dictionary(photograph: Photograph, name: str) -> Any:
    known = getattr(cv2.aruco, name.upper(), None)
    if known is None or not name.upper().startswith("DICT_"):
        raise DetectionError(
            f"'{name}' is not an ArUco dictionary",
            where=photograph.path,
            remedy='use a name such as "DICT_5X5_250"',
        )
    return cv2.aruco.getPredefinedDictionary(known)


def _indexed_corners(brightness: np.ndarray, scale_px: float) -> _Corners:
    """Corners of the largest board seen at one scale."""
    saddles = find_saddles(brightness, scale_px)

    def edge(start: np.ndarray, end: np.ndarray) -> np.ndarray:
        return _edge_strength(brightness, start, end)

    nothing = _Corners(np.zeros((0, 2)), np.zeros((0, 2), int), len(saddles))
    links = find_links(saddles, edge)
    if len(links) < FEWEST_CORNERS:
        return nothing
    indices, valid = index_linked(saddles, links)
    indices, points = indices[valid], saddles[valid]
    if (
        len(points) < FEWEST_CORNERS
        or (np.ptp(indices, axis=0) < 2).any()
        or roughness(indices, points) > ROUGHEST_LATTICE
    ):
        return nothing
    return _Corners(points, indices, len(saddles))


def _edge_strength(
    brightness: np.ndarray, start: np.ndarray, end: np.ndarray
) -> np.ndarray:
    """Least step of brightness, of one sign, all along the way from start to end."""
    along = end - start
    length = np.linalg.norm(along, axis=1, keepdims=True)
    across = np.stack([-along[:, 1], along[:, 0]], -1) / length
    across *= np.maximum(1.5, EDGE_OFFSET * length)
    middle = start + along * np.linspace(0.2, 0.8, 7)[:, None, None]

    def value(points: np.ndarray) -> np.ndarray:
        place = [points[..., 1] - 0.5, points[..., 0] - 0.5]
        return map_coordinates(brightness, place, order=1, mode="nearest")

    step = value(middle + across) - value(middle - across)
    return np.maximum(step.min(0), -step.max(0)) - FAINTEST_EDGE


def _local_steps(corners: _Corners) -> Float[np.ndarray, "corners 2 2"]:
    """Mean step to the neighbours along i and along j, pixels.

    Where a corner has no neighbour along one axis, the step of the nearest that has.
    """
    points, indices = corners.points_px, corners.indices
    at = {tuple(place): k for k, place in enumerate(indices.tolist())}
    steps = np.full((len(points), 2, 2), np.nan)
    for (i, j), k in at.items():
        for axis, (di, dj) in enumerate(((1, 0), (0, 1))):
            ahead, behind = at.get((i + di, j + dj), k), at.get((i - di, j - dj), k)
            span = (ahead != k) + (behind != k)
            if span:
                steps[k, axis] = (points[ahead] - points[behind]) / span
    for axis in (0, 1):
        known = np.flatnonzero(np.isfinite(steps[:, axis, 0]))
        if len(known):
            distance = np.linalg.norm(points[:, None] - points[known], axis=2)
            steps[:, axis] = steps[known[distance.argmin(1)], axis]
    return steps


def _settled_corners(
    photograph: Photograph, corners: _Corners, markers: MarkerBoard | None
) -> Observations:
    """Fit the corners in every channel and keep those that settle.

    Parameters
    ----------
    markers : In the bright squares; None where squares are plain.
    """
    window = window_per_square(markers)
    steps = _local_steps(corners)
    first = fit_corners(photograph.luminance_channel, corners.points_px, steps, window)
    parity = np.where(corners.indices.sum(1) % 2 == 0, 1, -1)
    sign = np.sign(first.contrast) * parity
    kept = first.settled
    if markers is None:
        kept = kept & (sign == np.sign(sign[kept].sum() or 1))
    channels = _all_channels(photograph, first, steps, window)
    short = np.abs(np.linalg.det(steps)) < (4 * 2.5) ** 2
    found = _as_observations(photograph, corners, first, channels, kept, short)
    return replace(found, edge_blur_px=first.blur_px[kept], markers=markers)


def window_per_square(markers: MarkerBoard | None) -> float:
    """Half width of a corner's window, in squares: within the margin of markers."""
    if markers is None:
        return WINDOW_PER_SQUARE
    return _PART_OF_MARGIN * markers.margin


def _all_channels(
    photograph: Photograph, first: CornerFit, steps: np.ndarray, window: float
) -> list[CornerFit]:
    starts = np.nan_to_num(first.points_px)
    return [
        fit_corners(photograph.pixels[..., channel], starts, steps, window)
        for channel in range(photograph.pixels.shape[2])
    ]


def _as_observations(
    photograph: Photograph,
    corners: _Corners,
    first: CornerFit,
    channels: list[CornerFit],
    kept: Bool[np.ndarray, " corners"],
    short: Bool[np.ndarray, " corners"],
) -> Observations:
    count = int(kept.sum())
    places = np.full((3, count, 2), np.nan)
    covariances = np.full((3, count, 2, 2), np.nan)
    if len(channels) == 3:
        for channel, fit in enumerate(channels):
            places[channel] = fit.points_px[kept]
            covariances[channel] = fit.covariance_px2[kept]
    highest = np.max([fit.highest for fit in channels], axis=0)
    return Observations(
        lattice=corners.indices[kept].astype(float),
        points_px=first.points_px[kept],
        covariance_px2=first.covariance_px2[kept],
        family=np.full(count, POINT),
        normal=np.full((count, 2), np.nan),
        saturated=highest[kept] >= photograph.saturation,
        overlapping=short[kept],
        channel_points_px=places,
        channel_covariance_px2=covariances,
        flux=np.stack([fit.white[kept] for fit in channels], -1),
        diameter_px=np.full(count, np.nan),
        image_size_px=photograph.size_px,
        candidates=corners.candidates,
        bright=False,
    )
