"""Variance of the blur along a direction, at many places of a photograph.

The variance of the blur along a unit vector n is ``n' M n``, M being the second moments
of the point-spread function. Small dots give M itself: the second moments of their
image less those of the hole, known from pose and pitch. Edges of large dots and of
squares give the variance across them, from where the profile passes 16 % and 84 %, two
standard deviations apart for a Gaussian. Lines give it from the second moment of their
profile less that of their width. The pixel's own 1/12 stays in: no camera is sharper.

Positions are pixels of the whole photograph; pixel (0, 0) covers [0, 1) x [0, 1).
"""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float

from lensfit.detect.lattice_map import LatticeMap
from lensfit.detect.observations import POINT, Observations
from lensfit.photograph import Photograph

LARGEST_SMALL_DOT_PX = 12.0
"""Wider dots show their blur at their edges; stated diameters are not exact enough."""
_MOST_POINTS = 360
_STEP_PX = 0.5
_INTERPOLATED_PX2 = 1 / 6
"""Variance that linear interpolation between samples adds."""
_PIXEL_PX2 = 1 / 12
_LEVELS = 0.16, 0.84
_LEAST_CONTRAST = 0.1
_RAYS = np.array([[np.cos(a), np.sin(a)] for a in np.arange(8) * np.pi / 4])
_TENSOR_WAYS = np.array([[1.0, 0.0], [np.sqrt(0.5), np.sqrt(0.5)], [0.0, 1.0]])
_REACH = {"checkerboard": 0.35, "charuco": 0.1}
"""Of a profile across an edge to each side, in pitches: markers stand near edges."""


class DirectionalBlur(NamedTuple):
    """Variance of the blur along unit vectors.

    points_px : Where.
    direction : Along which unit vector.
    variance_px2 : Of the blur, with the pixel's own 1/12.
    """

    points_px: Float[np.ndarray, "samples 2"]
    direction: Float[np.ndarray, "samples 2"]
    variance_px2: Float[np.ndarray, " samples"]


def directional_blur(
    photograph: Photograph,
    found: Observations,
    mapped: LatticeMap,
    kind: str,
    feature_pitches: float | None,
) -> DirectionalBlur | None:
    """The blur where the target shows it.

    Parameters
    ----------
    found : Detected points of the target.
    mapped : Their lattice on the photograph.
    kind : As in a shoot file.
    feature_pitches : Diameter of a dot or width of a line, in pitches; None if unknown.

    Returns
    -------
    None where nothing can be measured.
    """
    image = np.ascontiguousarray(photograph.luminance_channel, np.float32)
    usable = np.flatnonzero(~found.saturated & ~found.overlapping)
    if len(usable) < 9:
        return None
    some = usable[:: max(1, len(usable) // _MOST_POINTS)]
    if kind in ("checkerboard", "charuco"):
        return _blur_of_squares(image, found, some, _REACH[kind])
    jacobian = mapped.jacobians_px(found.lattice[some])
    if (found.family != POINT).any():
        return _blur_of_lines(image, found, some, jacobian, feature_pitches)
    diameter_px = found.diameter_px[some]
    if not np.isfinite(diameter_px).any():
        return None
    if float(np.nanmedian(diameter_px)) > LARGEST_SMALL_DOT_PX or not found.bright:
        return _blur_of_large_dots(image, found, some, jacobian)
    return _blur_of_small_dots(image, found, some, jacobian, feature_pitches or 0.0)


def _blur_of_small_dots(
    image: np.ndarray,
    found: Observations,
    some: np.ndarray,
    jacobian: np.ndarray,
    hole_pitches: float,
) -> DirectionalBlur | None:
    """Second moments of whole dots, less those of the hole as its pose has it."""
    largest = float(np.nanquantile(found.diameter_px[some], 0.9))
    pitch_px = np.sqrt(np.abs(np.linalg.det(jacobian)))
    half = int(min(np.ceil(0.75 * largest + 3), max(0.48 * pitch_px.min(), 2)))
    patch, x, y, inside = _patches(image, found.points_px[some], half)
    some, jacobian = some[inside], jacobian[inside]
    if len(some) < 9:
        return None
    away = np.hypot(x, y)
    ring = away > half - 1
    level = np.array([np.median(one[r]) for one, r in zip(patch, ring, strict=True)])
    spread = np.array([np.std(one[r]) for one, r in zip(patch, ring, strict=True)])
    light = patch - level[:, None, None]
    light = np.where((light > 3 * spread[:, None, None]) & (away < half), light, 0.0)
    total = light.sum((1, 2))
    mean = [(light * axis).sum((1, 2)) / total for axis in (x, y)]
    u, v = x - mean[0][:, None, None], y - mean[1][:, None, None]
    xx, xy, yy = ((light * p).sum((1, 2)) / total for p in (u * u, u * v, v * v))
    moments = np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -2)
    hole = hole_pitches**2 / 16 * jacobian @ jacobian.swapaxes(1, 2)
    tensor = moments - hole
    along = np.einsum("da,nab,db->nd", _TENSOR_WAYS, tensor, _TENSOR_WAYS)
    good = np.isfinite(along).all(1) & (total > 0)
    return _joined_samples(found.points_px[some][good], _TENSOR_WAYS, along[good])


def _patches(image: np.ndarray, points_px: np.ndarray, half: int):
    """Samples around points whose patch lies inside the frame, and pixels from them."""
    middle = np.floor(points_px).astype(int)
    size = np.array(image.shape[::-1])
    inside = ((middle >= half) & (middle < size - half)).all(1)
    offset = np.arange(-half, half + 1)
    column = middle[inside, :1] + offset
    row = middle[inside, 1:] + offset
    patch = image[row[:, :, None], column[:, None, :]].astype(float)
    x = column + 0.5 - points_px[inside, :1]
    y = row + 0.5 - points_px[inside, 1:]
    x, y = np.broadcast_arrays(x[:, None, :], y[:, :, None])
    return patch, x, y, inside


def _blur_of_large_dots(
    image: np.ndarray, found: Observations, some: np.ndarray, jacobian: np.ndarray
) -> DirectionalBlur | None:
    """Across the rim of each dot, in eight directions."""
    pitch_px = np.sqrt(np.abs(np.linalg.det(jacobian)))
    radius = float(np.nanmedian(found.diameter_px[some])) / 2
    reach = min(radius, float(np.median(pitch_px)) / 2 - radius)
    if reach < 2:
        return None
    away = np.arange(radius - reach, radius + reach, _STEP_PX)
    starts = np.repeat(found.points_px[some], len(_RAYS), 0)
    ways = np.tile(_RAYS, (len(some), 1))
    profile = _profiles(image, starts, ways, away)
    variance = _edge_variance_px2(profile, _STEP_PX)
    return _finite_samples(starts + radius * ways, ways, variance)


def _blur_of_squares(
    image: np.ndarray, found: Observations, some: np.ndarray, reach_pitches: float
) -> DirectionalBlur | None:
    """Across the sides of squares, between neighbouring corners."""
    cells = {
        (int(i), int(j)): k for k, (i, j) in enumerate(np.round(found.lattice).tolist())
    }
    pairs = [
        (k, cells[i + di, j + dj])
        for k in some.tolist()
        for i, j in [np.round(found.lattice[k]).astype(int).tolist()]
        for di, dj in ((1, 0), (0, 1))
        if (i + di, j + dj) in cells
    ]
    if len(pairs) < 9:
        return None
    first, second = found.points_px[np.array(pairs).T]
    side = second - first
    length = np.linalg.norm(side, axis=1)
    normal = np.stack([-side[:, 1], side[:, 0]], -1) / length[:, None]
    reach = reach_pitches * float(np.median(length))
    if reach < 2:
        return None
    away = np.arange(-reach, reach, _STEP_PX)
    along = (0.35, 0.425, 0.5, 0.575, 0.65)
    profile = np.mean(
        [_profiles(image, first + part * side, normal, away) for part in along], 0
    )
    variance = _edge_variance_px2(profile, _STEP_PX)
    return _finite_samples(first + side / 2, normal, variance)


def _blur_of_lines(
    image: np.ndarray,
    found: Observations,
    some: np.ndarray,
    jacobian: np.ndarray,
    width_pitches: float | None,
) -> DirectionalBlur | None:
    """Second moments of profiles across lines, less those of their width."""
    if width_pitches is None:
        return None
    family = np.maximum(found.family[some], 0)
    normal = found.normal[some]
    step = jacobian[np.arange(len(some)), :, family]
    pitch_px = np.abs((step * normal).sum(1))
    reach = 0.45 * float(np.median(pitch_px))
    away = np.arange(-reach, reach, _STEP_PX)
    profile = _profiles(image, found.points_px[some], normal, away)
    outside = np.abs(away) > 0.7 * reach
    light = profile - np.median(profile[:, outside], 1, keepdims=True)
    light *= 1 if found.bright else -1
    noise = np.std(light[:, outside], 1, keepdims=True)
    floor = np.maximum(3 * noise, 0.02 * light.max(1, keepdims=True))
    light = np.where(light > floor, light, 0.0)
    total = np.maximum(light.sum(1), 1e-12)
    mean = light @ away / total
    variance = (light * (away - mean[:, None]) ** 2).sum(1) / total
    variance -= (width_pitches * pitch_px) ** 2 / 12 + _INTERPOLATED_PX2
    return _finite_samples(found.points_px[some], normal, variance)


def _profiles(
    image: np.ndarray, starts: np.ndarray, ways: np.ndarray, away: np.ndarray
) -> np.ndarray:
    """Samples from each start along its way."""
    at = (starts[:, None] + away[:, None] * ways[:, None] - 0.5).astype(np.float32)
    return cv2.remap(
        image, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT,
        borderValue=float("nan"),
    ).astype(float)  # fmt: skip


def _edge_variance_px2(profile: np.ndarray, step_px: float) -> np.ndarray:
    """Variance of the blur across an edge; NaN where the profile is none."""
    quarter = max(profile.shape[1] // 4, 1)
    first, last = profile[:, :quarter].mean(1), profile[:, -quarter:].mean(1)
    rise = last - first
    flat = np.abs(rise) < _LEAST_CONTRAST * np.nanmax(np.abs(profile), initial=1e-12)
    share = (profile - first[:, None]) / np.where(flat, np.nan, rise)[:, None]
    share = np.maximum.accumulate(np.nan_to_num(share, nan=-1.0), 1)
    ends = []
    for level in _LEVELS:
        after = (share >= level).argmax(1)
        before = np.maximum(after - 1, 0)
        row = np.arange(len(share))
        low, high = share[row, before], share[row, after]
        part = (level - low) / np.where(high > low, high - low, 1.0)
        ends.append(np.where(after > 0, before + part, np.nan))
    width = (ends[1] - ends[0]) * step_px
    known = np.isfinite(profile).all(1) & ~flat
    return np.where(known, (width / 2) ** 2 - _INTERPOLATED_PX2, np.nan)


def _finite_samples(
    points_px: np.ndarray, ways: np.ndarray, variance_px2: np.ndarray
) -> DirectionalBlur | None:
    good = np.isfinite(variance_px2) & np.isfinite(ways).all(1)
    if np.count_nonzero(good) < 9:
        return None
    least = np.maximum(variance_px2[good], _PIXEL_PX2)
    return DirectionalBlur(points_px[good], ways[good], least)


def _joined_samples(
    points_px: np.ndarray, ways: np.ndarray, along: np.ndarray
) -> DirectionalBlur | None:
    """One sample of each point and direction."""
    count = len(ways)
    everywhere = np.repeat(points_px, count, 0)
    return _finite_samples(
        everywhere, np.tile(ways, (len(points_px), 1)), along.ravel()
    )
