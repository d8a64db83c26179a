"""The figures of one photograph: coverage, exposure and sharpness of its target."""

import math

import numpy as np

from lensfit.detect.blobs import noise_of
from lensfit.detect.directional_blur import DirectionalBlur
from lensfit.detect.observations import Observations
from lensfit.photograph import Photograph
from lensfit.report.frame_coverage import cell_counts, empty_places
from lensfit.workflow.check.check_records import Coverage, Exposure, Sharpness

CORNERS = ("top left", "top right", "bottom left", "bottom right")
_ZONES = (0.0, 0.4, 0.75, 1.01)
"""Radii that part centre, middle and edge, in half diagonals."""
_FEWEST = 6


def coverage_of(found: Observations) -> Coverage:
    """Where on the frame detected points are."""
    width, height = found.image_size_px
    counts = cell_counts(found.points_px, (float(width), float(height)))
    ends = [counts[row, column] for row in (0, -1) for column in (0, -1)]
    reached = tuple(n for n, c in zip(CORNERS, ends, strict=True) if c)
    return Coverage(float(np.mean(counts > 0)), tuple(empty_places(counts)), reached)


def exposure_of(photograph: Photograph, found: Observations) -> Exposure:
    """How far the target's own light is from clipping and from the noise.

    That of bright dots and lines is their brightest sample; of dark ones and of
    squares, the white around them.
    """
    pixels = photograph.pixels
    if found.bright:
        light = _brightest_samples(pixels, found.points_px)
    else:
        light = np.nanmax(found.flux, axis=1)
    light = light[np.isfinite(light) & (light > 0)]
    below = above = None
    if len(light) and math.isfinite(photograph.saturation):
        below = math.log2(photograph.saturation / float(np.quantile(light, 0.98)))
    noise = noise_of(photograph.luminance_channel)
    if len(light) and noise > 0:
        above = math.log2(float(np.median(light)) / noise)
    every = np.ascontiguousarray(pixels[::4, ::4])
    clipped = (every >= photograph.saturation).any(-1)
    return Exposure(
        below_clipping_stops=below,
        above_noise_stops=above,
        clipped_points=int(found.saturated.sum()),
        points=len(found),
        clipped_share=float(clipped.mean()),
    )


def _brightest_samples(pixels: np.ndarray, points_px: np.ndarray) -> np.ndarray:
    """Largest sample of any channel in the 3 x 3 pixels about each point."""
    height, width = pixels.shape[:2]
    column, row = np.floor(points_px).astype(int).T
    offset = np.arange(-1, 2)
    columns = np.clip(column[:, None] + offset, 0, width - 1)
    rows = np.clip(row[:, None] + offset, 0, height - 1)
    return pixels[rows[:, :, None], columns[:, None, :]].max((1, 2, 3))


def sharpness_of(
    blur: DirectionalBlur, image_size_px: tuple[int, int], holds_feature: bool
) -> Sharpness:
    """Medians of the blur's diameter over zones of the frame."""
    size = np.asarray(image_size_px, float)
    diameter = 4 * np.sqrt(np.maximum(blur.variance_px2, 0.0))
    place = blur.points_px / size
    radius = np.linalg.norm(blur.points_px - size / 2, axis=1)
    radius /= np.linalg.norm(size) / 2
    zone = np.digitize(radius, _ZONES) - 1
    centre, middle, edge = (_median(diameter[zone == k]) for k in range(3))
    ninth = np.clip((3 * place).astype(int), 0, 2)
    zones = tuple(
        tuple(_median(diameter[(ninth == [column, row]).all(1)]) for column in range(3))
        for row in range(3)
    )
    return Sharpness(centre, middle, edge, zones, holds_feature)


def _median(values: np.ndarray) -> float | None:
    return float(np.median(values)) if len(values) >= _FEWEST else None
