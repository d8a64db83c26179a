"""Drawings as pixels: PNG for displays and printers, EXR in linear light.

Every pixel holds the mean over its area (`lensfit.chart.coverage`). PNG is sRGB, 8 bit
grey, and says its pixels' size; EXR is float, 1 for white.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float
from PIL import Image

from lensfit.atomic import atomic_path
from lensfit.coords import Window
from lensfit.io.exr import ExrImage, ExrPart, write_exr
from lensfit.io.transfer import encode
from lensfit.units import MILLIMETRES_PER_INCH


def write_png(
    path: str | Path, tones: Float[np.ndarray, "height width"], pixel_mm: float
) -> None:
    """Write tones, scene-linear in 0..1, as sRGB.

    Raises
    ------
    OutputError : The file cannot be written.
    """
    codes = np.empty(tones.shape, np.uint8)
    for row, light in enumerate(tones):  # a row at a time: sheets are large
        codes[row] = np.round(255 * encode(np.clip(light, 0, 1), "srgb"))
    per_inch = MILLIMETRES_PER_INCH / pixel_mm
    with atomic_path(path) as temporary:
        Image.fromarray(codes).save(temporary, format="PNG", dpi=(per_inch, per_inch))


def write_tones_exr(path: str | Path, tones: Float[np.ndarray, "height width"]) -> None:
    """Write tones, scene-linear, as R, G and B of an OpenEXR file.

    Raises
    ------
    OutputError : The file cannot be written.
    """
    window = Window.of_size(tones.shape[1], tones.shape[0])
    plane = np.ascontiguousarray(tones, np.float32)
    part = ExrPart({name: plane for name in "RGB"}, window, window)
    write_exr(path, ExrImage((part,)))
