"""A picture of what was found, for a person to check by eye.

The photograph is exposed for display and greyed a little; every detection sits on it at
its sub-pixel position. Colour tells the row j and lightness the parity of the column i
(or the number of the line), so that a detection that was numbered wrongly breaks a
stripe. Clipped detections are crossed out, detections that touch a neighbour are
squared, and a strip at the bottom says how many there are of each.
"""

from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image

from lensfit.atomic import atomic_path
from lensfit.detect.observations import POINT, Observations
from lensfit.detect.overlay_detections import (
    draw_labels,
    draw_points,
    draw_samples,
    with_legend,
)
from lensfit.photograph import Photograph

WIDEST_PX, NARROWEST_PX = 3000, 1000
"""Pictures wider than the first are reduced, narrower than the second enlarged."""
HUES = 7
"""Rows until the colours repeat."""
LIGHTNESS = (0.85, 0.7)
"""OKLab lightness of even and odd columns."""
CHROMA = 0.16
GREYED, DIMMED = 0.6, 0.5
LEAST_OF_MARKS = 0.2
"""Of the usual peak of bright detections: white is no darker, or their veil glares."""


def draw_overlay(
    photograph: Photograph, observations: Observations, path: str | Path
) -> None:
    """Write the overlay of one photograph as a PNG.

    Parameters
    ----------
    photograph : The picture the observations were made on.
    observations : What was found on it.
    path : Where to write; an existing file is replaced as a whole.

    Raises
    ------
    OutputError : the file cannot be written.
    """
    picture = overlay_picture(photograph, observations)
    with atomic_path(path) as temporary:
        picture.save(temporary, format="PNG", compress_level=4)


def overlay_picture(photograph: Photograph, observations: Observations) -> Image.Image:
    """The overlay of one photograph, at most `WIDEST_PX` wide."""
    scale = _scale(photograph.size_px[0])
    canvas = _developed(photograph, observations, scale)
    lines = observations.family != POINT
    if lines.any():
        number = observations.lattice[
            np.arange(len(lines)), np.maximum(observations.family, 0)
        ]
        colours = stripe_colours(number, observations.family.astype(float))
        draw_samples(canvas, observations, colours, scale)
    if not lines.all():
        colours = stripe_colours(observations.lattice[:, 1], observations.lattice[:, 0])
        draw_points(canvas, observations, colours, scale)
    picture = Image.fromarray(canvas)
    draw_labels(picture, observations, scale)
    swatches = stripe_colours(np.arange(HUES, dtype=float), np.zeros(HUES))
    return with_legend(picture, observations, photograph.path.name, swatches)


def stripe_colours(
    row: Float[np.ndarray, " detections"], column: Float[np.ndarray, " detections"]
) -> UInt8[np.ndarray, "detections 3"]:
    """sRGB colour of each detection: hue by row, lightness by parity of the column.

    Equal steps of hue in OKLab (B. Ottosson, "A perceptual color space for image
    processing", 2020), so that no two neighbouring rows look alike.
    """
    hue = 2 * np.pi * (np.mod(row, HUES) * 3 % HUES) / HUES + 0.5
    lightness = np.where(np.mod(column, 2) == 0, *LIGHTNESS)
    lab = np.stack([lightness, CHROMA * np.cos(hue), CHROMA * np.sin(hue)], -1)
    to_lms = np.array(
        [
            [1.0, 0.3963377774, 0.2158037573],
            [1.0, -0.1055613458, -0.0638541728],
            [1.0, -0.0894841775, -1.2914855480],
        ]
    )
    to_rgb = np.array(
        [
            [4.0767416621, -3.3077115913, 0.2309699292],
            [-1.2684380046, 2.6097574011, -0.3413193965],
            [-0.0041960863, -0.7034186147, 1.7076147010],
        ]
    )
    return _encoded((lab @ to_lms.T) ** 3 @ to_rgb.T)


def _encoded(linear: np.ndarray) -> UInt8[np.ndarray, "..."]:
    """sRGB code values of linear light, clipped to 0..1."""
    linear = np.clip(linear, 0, 1)
    curved = 1.055 * np.maximum(linear, 1e-6) ** (1 / 2.4) - 0.055
    return np.round(255 * np.where(linear <= 0.0031308, 12.92 * linear, curved)).astype(
        np.uint8
    )


_CODES = _encoded(np.linspace(0.0, 1.0, 1 << 16))
"""Of all levels of 16 bits: a picture has millions of samples, a power is slow."""


def _scale(width: int) -> float:
    if width > WIDEST_PX:
        return WIDEST_PX / width
    return float(np.ceil(NARROWEST_PX / width)) if width < NARROWEST_PX else 1.0


def _developed(
    photograph: Photograph, observations: Observations, scale: float
) -> UInt8[np.ndarray, "height width 3"]:
    """The photograph exposed so that its highlights just fit, greyed and dimmed.

    Small bright dots are too few to count as highlights, and are looked at as well.
    """
    width, height = (round(side * scale) for side in photograph.size_px)
    way = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    pixels = cv2.resize(photograph.pixels, (width, height), interpolation=way)
    pixels = np.nan_to_num(pixels.reshape(height, width, -1))
    white = max(float(np.percentile(pixels[::2, ::2], 99.7)), 1e-12)
    if observations.bright:
        column, row = np.floor(observations.points_px).astype(int).T
        peak = float(np.median(photograph.pixels[row, column].max(-1)))
        white = max(white, LEAST_OF_MARKS * peak)
    if pixels.shape[2] == 1:
        pixels = cv2.cvtColor(pixels, cv2.COLOR_GRAY2RGB)
    mixed = DIMMED * ((1 - GREYED) * np.eye(3) + GREYED / 3) * (len(_CODES) - 1) / white
    levels = np.clip(cv2.transform(pixels, mixed), 0, len(_CODES) - 1)
    return _CODES[np.rint(levels).astype(np.uint16)]
