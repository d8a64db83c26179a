"""Round marks that stand out from what surrounds them: candidates for dots.

The threshold is local, half-way between the darkest and the brightest sample of a
window (Bernsen, 1986), so that neither fall-off nor shadow moves it; a window as wide
as a few dots is found by trying image scales in octaves and keeping the one on which
most marks have neighbours opposite each other, as in a lattice. Both polarities are
tried on the same threshold.
"""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import KDTree

from lensfit.detect.lattice_growth import neighbourhoods

POLARITIES = ("bright", "dark")

_WINDOW = 31
"""Side of the threshold window in samples of the scale in work."""
_BLOCK = 4
_SMOOTHING = 0.9
"""Blur before thresholding, in samples: no dot is then smaller than a few samples."""
_SCALES = (1, 2, 4)
_MINIMUM_CONTRAST = 0.12
"""Of the brightest sample of the window."""
_AROUND = 49
"""Neighbourhood, in blocks, whose marks set how much contrast a mark must have."""
_OF_CONTRAST_AROUND = 0.2
_NOISE_FACTOR = 8.0
_ENOUGH = 9
_FLAT, _MARKED = 1, 255


class Blobs(NamedTuple):
    """Marks found by thresholding, before any refinement.

    centre_px : Centroid of the mark's mask.
    area_px : Area of the mask, square pixels.
    moment_px2 : Second central moments of the mask.
    cut : The mask touches the border of the picture or of the region of interest.
    """

    centre_px: Float[np.ndarray, "blobs 2"]
    area_px: Float[np.ndarray, " blobs"]
    moment_px2: Float[np.ndarray, "blobs 2 2"]
    cut: Bool[np.ndarray, " blobs"]

    def subset(self, index: np.ndarray) -> "Blobs":
        """The blobs of an index or mask."""
        return Blobs(*(column[index] for column in self))


class BlobSearch(NamedTuple):
    """The best set of blobs over scales and polarities.

    polarity : "bright" or "dark".
    noise : Standard deviation of the picture's finest noise.
    """

    blobs: Blobs
    polarity: str
    noise: float


def find_blobs(
    image: Float[np.ndarray, "height width"], polarities: tuple[str, ...] = POLARITIES
) -> BlobSearch:
    """Compact marks at the scale and polarity that look most like a lattice.

    Parameters
    ----------
    image : Scene-linear picture, float32.
    polarities : Those to try, of "bright" and "dark".
    """
    noise = noise_of(image)
    found = {}
    level = image
    for scale in _SCALES:
        if scale > 1:
            level = cv2.resize(
                level, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA
            )
        if min(level.shape) < 2 * _WINDOW:
            break
        smooth = cv2.GaussianBlur(level, (0, 0), _SMOOTHING)
        for polarity in polarities:
            mask = _half_level_mask(smooth, noise / scale, polarity)
            blobs = _blobs_of(mask, scale)
            found[polarity, scale] = blobs, _lattice_member_count(blobs)
    if not found:
        return BlobSearch(_no_blobs(), polarities[0], noise)
    best = max(found, key=lambda key: found[key][1] * (1 + 0.02 / key[1]))
    polarity, scale = best
    blobs = found[best][0]
    if (polarity, 2 * scale) in found:
        blobs = _with_larger(blobs, found[polarity, 2 * scale][0])
    return BlobSearch(blobs, polarity, noise)


def noise_of(image: Float[np.ndarray, "height width"]) -> float:
    """Standard deviation of the finest noise, from the median second difference."""
    sample = image[:: max(1, image.shape[0] // 512)]
    second = sample[:, :-2] - 2 * sample[:, 1:-1] + sample[:, 2:]
    return float(1.4826 * np.median(np.abs(second)) / np.sqrt(6))


def _half_level_mask(level: np.ndarray, noise: float, polarity: str) -> np.ndarray:
    """Samples on the dots' side of half-level, or without contrast about them.

    The background follows gradients: it is the morphological closing (opening for
    bright dots) at block resolution, and half-level lies half the window's greatest
    depth below it. Samples without contrast count in, so that a mark is complete only
    where samples of the other kind surround it, and keeps its inside if it is wide.
    """
    dark = polarity == "dark"
    brightest, darkest = _block_extremes(level)
    window = np.ones((_WINDOW // _BLOCK | 1,) * 2, np.uint8)
    if dark:
        background = cv2.morphologyEx(brightest, cv2.MORPH_CLOSE, window)
        depth = background - darkest
        contrast = cv2.dilate(depth / np.maximum(background, 1e-9), window)
        depth = cv2.dilate(depth, window)
        top = background
    else:
        background = cv2.morphologyEx(darkest, cv2.MORPH_OPEN, window)
        contrast = depth = cv2.dilate(brightest - background, window)
        top = background + depth
    around = cv2.blur(cv2.dilate(contrast, np.ones((_AROUND,) * 2, np.uint8)), (9, 9))
    lively = contrast > _OF_CONTRAST_AROUND * around
    lively &= depth > np.maximum(_NOISE_FACTOR * noise, _MINIMUM_CONTRAST * top)
    half = cv2.blur(background + (-depth if dark else depth) / 2, (3, 3))
    shape = level.shape[::-1]
    half = cv2.resize(half, shape)
    flat = cv2.resize((~lively).view(np.uint8), shape, interpolation=cv2.INTER_NEAREST)
    marked = cv2.compare(level, half, cv2.CMP_LT if dark else cv2.CMP_GT)
    return np.where(flat > 0, np.uint8(_FLAT), marked)


def _block_extremes(level: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Largest and smallest sample of each block."""
    kernel = np.ones((_BLOCK, _BLOCK), np.uint8)
    largest, smallest = (
        np.ascontiguousarray(operator(level, kernel, anchor=(0, 0))[::_BLOCK, ::_BLOCK])
        for operator in (cv2.dilate, cv2.erode)
    )
    return largest, smallest


def _blobs_of(mask: np.ndarray, scale: int) -> Blobs:
    """Compact components of a mask with their moments."""
    _, labels, stats, centre = cv2.connectedComponentsWithStats(
        mask, connectivity=4, ltype=cv2.CV_32S
    )
    area = stats[:, cv2.CC_STAT_AREA]
    wide, high = stats[:, cv2.CC_STAT_WIDTH], stats[:, cv2.CC_STAT_HEIGHT]
    largest = (1.6 * _WINDOW) ** 2
    fits = (area >= 4) & (area < largest) & (np.maximum(wide, high) < 2 * _WINDOW)
    fits &= area > 0.25 * wide * high
    fits[0] = False
    if not fits.any():
        return _no_blobs()
    moment, marked = _second_moments(mask, labels, fits, centre)
    fits &= marked > 0.25
    moment = moment[fits]
    left, top = stats[fits, cv2.CC_STAT_LEFT], stats[fits, cv2.CC_STAT_TOP]
    bottom, right = mask.shape
    cut = (left == 0) | (top == 0)
    cut |= (left + wide[fits] == right) | (top + high[fits] == bottom)
    blobs = Blobs((centre[fits] + 0.5) * scale, area[fits] * scale**2, moment, cut)
    blobs = blobs._replace(moment_px2=moment * scale**2)
    return blobs.subset(_is_compact(area[fits], moment))


def _second_moments(mask, labels, wanted, centre) -> tuple[np.ndarray, np.ndarray]:
    """Central second moments of the wanted components, with the pixels' own extent.

    Also the fraction of each that is past half-level rather than without contrast.
    """
    row, column = np.nonzero(wanted[labels])
    label = labels[row, column]
    x = column - centre[label, 0]
    y = row - centre[label, 1]
    n = len(wanted)
    count = np.maximum(np.bincount(label, minlength=n), 1)
    xx, xy, yy = (np.bincount(label, v, n) / count for v in (x * x, x * y, y * y))
    moment = np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -2)
    marked = np.bincount(label, mask[row, column] == _MARKED, n) / count
    return moment + np.eye(2) / 12, marked


def _is_compact(area: np.ndarray, moment: np.ndarray) -> np.ndarray:
    """Whether a component fills the ellipse of its moments, and is not a streak."""
    determinant = np.linalg.det(moment)
    ellipse = 4 * np.pi * np.sqrt(np.maximum(determinant, 1e-12))
    half_trace = np.trace(moment, axis1=1, axis2=2) / 2
    spread = np.sqrt(np.maximum(half_trace**2 - determinant, 0))
    aspect2 = (half_trace + spread) / np.maximum(half_trace - spread, 1e-9)
    return (area > 0.8 * ellipse - 1) & (aspect2 < 5.0**2)


def _lattice_member_count(blobs: Blobs) -> int:
    """How many blobs have neighbours of their own kind in two opposite pairs."""
    if len(blobs.centre_px) < _ENOUGH:
        return 0
    hood = neighbourhoods(blobs.centre_px, KDTree(blobs.centre_px))
    alike = hood.regular.copy()
    area = blobs.area_px
    ratio = area[hood.cross] / area[:, None]
    alike &= (np.abs(np.log(ratio)) < np.log(2.0)).all(1)
    return int(np.count_nonzero(alike))


def _with_larger(blobs: Blobs, larger: Blobs) -> Blobs:
    """Add marks too large for the finer scale, in place of fragments inside them."""
    if not len(blobs.centre_px) or not len(larger.centre_px):
        return blobs
    larger = larger.subset(larger.area_px > 2 * np.median(blobs.area_px))
    if not len(larger.centre_px):
        return blobs
    distance, nearest = map(np.asarray, KDTree(larger.centre_px).query(blobs.centre_px))
    within = distance < np.sqrt(larger.area_px / np.pi)[nearest]
    covered = np.bincount(nearest[within], blobs.area_px[within], len(larger.area_px))
    new = covered < 0.25 * larger.area_px
    fragment = within & new[nearest]
    pairs = zip(blobs.subset(~fragment), larger.subset(new), strict=True)
    return Blobs(*(np.concatenate(pair) for pair in pairs))


def _no_blobs() -> Blobs:
    empty = np.zeros(0)
    return Blobs(np.zeros((0, 2)), empty, np.zeros((0, 2, 2)), empty.astype(bool))
