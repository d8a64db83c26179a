"""A colour mosaic on the sensor: which channel each photosite measured.

A word of four letters names the colours of the top left 2 x 2 photosites, row by row
("rggb": red, green; green, blue), and the pattern repeats over the picture (B. E.
Bayer, US patent 3971065, 1976). A picture interpolated from a mosaic keeps what was
measured; the other two values of each pixel are interpolated from neighbours, which
widens spots of one or two pixels and has noise of its own.
"""

from typing import Literal, get_args

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int

Mosaic = Literal["rggb", "bggr", "grbg", "gbrg"]
MOSAICS: tuple[Mosaic, ...] = get_args(Mosaic)
PIXELS_PER_PHOTOSITE = (4.0, 2.0, 4.0)
"""Of red, green and blue."""
_TENT = np.outer([1.0, 2.0, 1.0], [1.0, 2.0, 1.0]) / 4


def photosites(
    mosaic: Mosaic, size_px: tuple[int, int]
) -> Bool[np.ndarray, "height width 3"]:
    """Where red, green and blue were measured on a picture of that width, height."""
    width, height = size_px
    return photosites_at(mosaic, np.arange(width), np.arange(height)[:, None])


def photosites_at(
    mosaic: Mosaic, columns: Int[np.ndarray, "*places"], rows: Int[np.ndarray, "*other"]
) -> Bool[np.ndarray, "*both 3"]:
    """Where red, green and blue were measured, at pixels of these columns and rows.

    Arrays that go together; pixels may lie beyond the picture.
    """
    letters = _tile(mosaic)[rows % 2, columns % 2]
    return letters[..., None] == np.array(list("rgb"))


def cropped_mosaic(mosaic: Mosaic, columns: int, rows: int) -> Mosaic:
    """The mosaic of a picture without its first so many columns and rows."""
    return mosaic_of(np.roll(_tile(mosaic), (-rows, -columns), (0, 1)))


def mosaic_of(letters: np.ndarray) -> Mosaic:
    """The word for the top left of a picture of letters "r", "g" and "b".

    Raises
    ------
    ValueError : They are no such mosaic.
    """
    word = "".join(letters[:2, :2].ravel())
    for mosaic in MOSAICS:
        if mosaic == word:
            return mosaic
    raise ValueError(f"{word} is no mosaic of {', '.join(MOSAICS)}")


def letters_of(mosaic: Mosaic, size_px: tuple[int, int]) -> np.ndarray:
    """The colours of the top left of a picture, as letters.

    At least two rows and two columns, of as odd or even a number as the picture's: what
    turns and mirrors a picture turns and mirrors them to those of the result.
    """
    width, height = size_px
    return np.tile(_tile(mosaic), (2, 2))[: 2 + height % 2, : 2 + width % 2]


def filled_in(
    pixels: Float[np.ndarray, "height width 3"], mosaic: Mosaic
) -> Float32[np.ndarray, "height width 3"]:
    """What was measured, and between the photosites its linear interpolation.

    Parameters
    ----------
    pixels : Only the values at each channel's own photosites matter.
    """
    own = photosites(mosaic, (pixels.shape[1], pixels.shape[0]))
    found = np.empty(pixels.shape, np.float32)
    for k in range(3):
        mask = own[..., k].astype(np.float32)
        light = np.where(own[..., k], pixels[..., k], 0).astype(np.float32)
        between = _spread(light) / _spread(mask)
        found[..., k] = np.where(own[..., k], light, between)
    return found


def _spread(channel: np.ndarray) -> np.ndarray:
    return cv2.filter2D(channel, -1, _TENT, borderType=cv2.BORDER_REFLECT_101)


def _tile(mosaic: Mosaic) -> np.ndarray:
    return np.array(list(mosaic)).reshape(2, 2)
