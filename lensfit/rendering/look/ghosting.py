"""Ghosts: highlights reflected between glass, on the other side of the centre.

The n-th of N ghosts of a light at p lies at c - reach (n / N) (p - c), with c the
optical centre (the principal point), and is drawn with the shape of the pupil at that
field point, n / N of the size of the last. Each holds the same light. All together hold
`share` of the light above the threshold, *added* to the picture: a lens loses light by
reflections everywhere alike, and exposure compensates that. What falls beside the plate
is lost. The tint keeps the luminance: 1 is green, -1 magenta, as coatings are.

Ghosts are those of the plate before the lens blurs it: a light throws the same ghost
whether it is in focus or not. Light from beyond the plate is unknown, and makes none.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Float32

from lensfit.rendering.look.aperture_shape import ApertureShape, shrunk
from lensfit.rendering.look.light import brightest_channel
from lensfit.rendering.look.pyramid import Picture, doubled, halved, padded

LEVEL = 1
"""Lights are kept at half size."""
_LEAST_LEVELS = 16


@dataclass(frozen=True)
class Ghosts:
    """The ghosts of a point.

    Attributes
    ----------
    count : How many.
    reach : Distance of the last from the centre over that of its light; positive on
        the other side.
    diameter_px : Of the last, in pixels of the whole picture.
    tint : 1 is green, -1 magenta.
    """

    count: int
    reach: float
    diameter_px: float
    tint: float


def ghosts_of(
    small: Picture,
    level: int,
    shape: tuple[int, int],
    centre_px: Float[np.ndarray, "2"],
    ghosts: Ghosts,
    opening: ApertureShape,
    least_px: float,
    luminance: tuple[float, float, float],
) -> Picture:
    """All ghosts of some lights, holding as much light together as those.

    Parameters
    ----------
    small : The lights, halved `level` times.
    shape : Rows and columns of the whole picture.
    centre_px : Optical centre, x and y from the picture's corner.
    opening : Its shape, for lights over the picture.
    least_px : Pixels that a ghost measures at least at the size where it is drawn.
    luminance : Of red, green and blue, for the tint.
    """
    if small.max() <= 0:
        return np.zeros((*shape, small.shape[2]), np.float32)
    drawn: dict[int, Picture] = {}
    for n in range(1, ghosts.count + 1):
        part = n / ghosts.count
        diameter_px = part * ghosts.diameter_px
        own = max(level, _level_of(diameter_px, least_px, shape))
        lights = halved(padded(small, own - level), own - level)
        place = -ghosts.reach * part
        centre = centre_px / 2**own
        made = _drawn(lights, place, centre, diameter_px / 2**own, opening, 2**own)
        drawn[own] = drawn[own] + made if own in drawn else made
    total = _together(drawn)
    if total.shape[2] == 3:
        total *= tint_of(ghosts.tint, luminance)
    total /= np.float32(ghosts.count)
    return total[: shape[0], : shape[1]]


def tint_of(
    tint: float, luminance: tuple[float, float, float]
) -> Float32[np.ndarray, "3"]:
    """Gains of red, green and blue that keep the luminance of a grey."""
    green = luminance[1]
    if tint >= 0:
        others, own = 1 - tint, 1 + tint * (1 - green) / green
    else:
        others, own = 1 - tint * green / (1 - green), 1 + tint
    return np.array([others, own, others], np.float32)


def _together(drawn: dict[int, Picture]) -> Picture:
    """Pictures of several sizes on one of the whole size, from the smallest up."""
    level = max(drawn)
    total = drawn[level]
    while level > 0:
        total, level = doubled(total), level - 1
        if level in drawn:
            height, width = drawn[level].shape[:2]
            total = drawn[level] + total[:height, :width]
    return total


def _level_of(diameter_px: float, least_px: float, shape: tuple[int, int]) -> int:
    level = 0
    while (
        diameter_px / 2 ** (level + 1) >= least_px
        and min(shape) >> (level + 1) >= _LEAST_LEVELS
    ):
        level += 1
    return level


def _drawn(
    lights: Picture,
    place: float,
    centre: Float[np.ndarray, "2"],
    diameter_px: float,
    opening: ApertureShape,
    pixel: int,
) -> Picture:
    """Every light at its place, in the shape of the opening."""
    total = np.zeros_like(lights)
    rows, columns = np.nonzero(brightest_channel(lights) > 0)
    own = np.stack([columns + 0.5, rows + 0.5], -1)
    there = centre + place * (own - centre)
    values = lights[rows, columns]
    for weights, shape in opening.node_shares(own * pixel):
        if not weights.any():
            continue
        points = _splatted(values * weights[:, None], there, lights.shape)
        kernel = shrunk(shape, diameter_px / opening.diameter_px)
        spread = cv2.filter2D(points, -1, kernel, borderType=cv2.BORDER_CONSTANT)
        total += np.maximum(spread.reshape(total.shape), 0)
    return total


def _splatted(
    values: Float32[np.ndarray, "lights channels"],
    points_px: Float[np.ndarray, "lights 2"],
    shape: tuple[int, ...],
) -> Picture:
    """Lights divided among the four pixels around each, keeping sum and place."""
    height, width, channels = shape
    corner = np.floor(points_px - 0.5).astype(int)
    fx, fy = np.moveaxis(points_px - 0.5 - corner, -1, 0)
    result = np.zeros((height * width, channels))
    for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
        x, y = corner[:, 0] + dx, corner[:, 1] + dy
        share = (fx if dx else 1 - fx) * (fy if dy else 1 - fy)
        inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
        index = (y * width + x)[inside]
        for c in range(channels):
            light = (values[:, c] * share)[inside]
            result[:, c] += np.bincount(index, light, height * width)
    return result.reshape(shape).astype(np.float32)
