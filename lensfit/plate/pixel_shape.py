"""The width of a plate's pixels on the sensor, over their height.

The header's ``pixelAspectRatio`` states how a pixel is displayed. Behind a spherical
lens that is its shape on the sensor too. An anamorphic lens squeezes the scene, so that
a plate comes in two forms: *squeezed*, with the sensor's own square pixels, displayed
as wide as the lens squeezes; and *desqueezed*, displayed square, whose pixels are
narrow on the sensor. Some writers leave the ratio at 1 in both cases: then the plate
counts as squeezed if the other form would be taller than the sensor.

Desqueezing uses the lens' engraved squeeze: the nearest of the standard squeezes.
"""

import math
from typing import NamedTuple

from lensfit.coords import Window
from lensfit.errors import ImageError
from lensfit.preset.blur_of_block import section_ratio
from lensfit.preset.schema import Preset

OPTION = "--pixel-aspect"
SQUARE = 1.0
"""What a frame is displayed with where nobody states another ratio."""
_ENGRAVED = (1.25, 1.3, 1.33, 1.5, 1.6, 1.65, 1.75, 1.8, 1.85, 1.9, 2.0)
_LEAST_SQUEEZE = 1.15
"""A spherical lens is measured with less."""
_SAME = 0.1
"""Relative difference from the squeeze; engraved ones are nominal."""
_SPARE = 1.02
"""Of the sensor's height, that a frame may be taller."""
_NARROWEST, _WIDEST = 0.1, 10.0


class PixelShape(NamedTuple):
    """The shape, and what was assumed of it; None if nothing was."""

    ratio: float
    note: str | None = None


def pixel_shape(
    preset: Preset,
    display: Window,
    sensor_width_mm: float,
    header_aspect: float,
    stated_aspect: float | None = None,
) -> PixelShape:
    """Width of a plate's pixels over their height, on the sensor.

    Parameters
    ----------
    preset : The lens, and the sensor that it was photographed on.
    display : Frame of the plate.
    sensor_width_mm : That it spans.
    header_aspect : ``pixelAspectRatio``.
    stated_aspect : By the user, in its place.

    Raises
    ------
    ImageError : It is no ratio, or that of neither form of an anamorphic plate.
    """
    aspect = header_aspect if stated_aspect is None else stated_aspect
    if not _NARROWEST <= aspect <= _WIDEST:
        raise ImageError(
            f"has pixels {aspect:g} times as wide as high",
            remedy=f"state their shape with {OPTION}",
        )
    squeeze = engraved_squeeze(preset)
    if squeeze == 1:
        return PixelShape(aspect)
    if abs(math.log(aspect / squeeze)) < _SAME:
        return PixelShape(1.0)
    if abs(math.log(aspect)) >= _SAME:
        raise ImageError(
            f"has pixels {aspect:g} times as wide as high, and the lens squeezes by "
            f"{squeeze:g}: a squeezed plate has {squeeze:g}, a desqueezed one 1",
            remedy=f"state their shape with {OPTION}",
        )
    if stated_aspect is not None:
        return PixelShape(1 / squeeze)
    height_mm = sensor_width_mm * display.height / display.width * squeeze
    if height_mm > _SPARE * preset.camera.sensor_height_mm:
        taken, ratio, other = "squeezed", 1.0, "1 states a desqueezed one"
    else:
        taken, ratio = "desqueezed", 1 / squeeze
        other = f"{squeeze:g} states a squeezed one"
    return PixelShape(
        ratio,
        f"the plate is taken as {taken} (the lens squeezes by {squeeze:g} and "
        f"pixelAspectRatio is 1); {OPTION} {other}",
    )


def engraved_squeeze(preset: Preset) -> float:
    """By how much a lens squeezes the scene along x, as it is engraved; 1 of a
    spherical one, less than 1 where it squeezes along y."""
    logs = [math.log(section_ratio(entry)) for entry in preset.entries]
    measured = math.exp(sum(logs) / len(logs))
    if max(measured, 1 / measured) < _LEAST_SQUEEZE:
        return 1.0
    size = max(measured, 1 / measured)
    nearest = min(_ENGRAVED, key=lambda engraved: abs(math.log(engraved / size)))
    return nearest if measured > 1 else 1 / nearest
