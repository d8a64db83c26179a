"""Pictures as the screen shows them: exposure in stops, 8 bits, PNG.

They are in sRGB, or as a view transform of OpenColorIO makes them. The sRGB code of
every half float is known beforehand, so that a picture is looked up rather than
computed; half floats resolve light eight times finer than 8 bits do.
"""

from functools import lru_cache

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from lensfit.coords import pixels_over_window
from lensfit.io.exr import ExrImage, ExrPart
from lensfit.io.transfer import encode
from lensfit.plate.channels import ColourLayer, colour_layers
from lensfit.workflow.view.view_transform import ViewTransform, view_codes

_QUICK = [cv2.IMWRITE_PNG_COMPRESSION, 1]


def first_layer(image: ExrImage, wanted: tuple[str, ...] | None) -> str | None:
    """Name of the layer that is shown; None if the plate has no colours."""
    for part in image.parts:
        for layer in colour_layers(part, wanted):
            return layer.layer
    return None


def frame_pixels(image: ExrImage, layer: str) -> Float32[np.ndarray, "height width 3"]:
    """A colour layer over the display window; black where the picture has no pixel."""
    part, found = _part_with(image, layer)
    names = found.names[:3] if len(found.names) >= 3 else found.names[:1] * 3
    planes = [
        pixels_over_window(part.channels[name], part.data_window, part.display_window)
        for name in names
    ]
    return np.stack(planes, axis=-1).astype(np.float32)


def screen_png(
    pixels: Float32[np.ndarray, "height width 3"],
    exposure_stops: float = 0.0,
    view: ViewTransform | None = None,
) -> bytes:
    """The picture as PNG, brighter by some stops.

    Parameters
    ----------
    view : How light is shown; in sRGB if None.

    Raises
    ------
    LensfitError : There is no such view transform here.
    """
    if view is None:
        codes = _srgb_codes(pixels, exposure_stops)
    else:
        with np.errstate(over="ignore", invalid="ignore"):
            codes = view_codes(pixels * np.float32(2.0**exposure_stops), view)
    _, buffer = cv2.imencode(".png", codes[..., ::-1], _QUICK)
    return buffer.tobytes()


def _srgb_codes(
    pixels: Float32[np.ndarray, "height width 3"], exposure_stops: float
) -> UInt8[np.ndarray, "height width 3"]:
    with np.errstate(over="ignore", invalid="ignore"):
        halves = pixels.astype(np.float16).view(np.uint16)
    return _codes(float(exposure_stops))[halves]


@lru_cache(maxsize=32)
def _codes(exposure_stops: float) -> UInt8[np.ndarray, " halves"]:
    halves = np.arange(1 << 16, dtype=np.uint32).astype(np.uint16).view(np.float16)
    light = np.nan_to_num(halves.astype(float), nan=0.0, posinf=1e9, neginf=0.0)
    light = np.clip(light * 2.0**exposure_stops, 0.0, 1.0)
    return np.round(np.clip(encode(light, "srgb"), 0, 1) * 255).astype(np.uint8)


def _part_with(image: ExrImage, layer: str) -> tuple[ExrPart, ColourLayer]:
    return next(
        (part, found) for part in image.parts for found in colour_layers(part, [layer])
    )
