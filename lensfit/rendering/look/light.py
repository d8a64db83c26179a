"""The light that an effect acts on: that of the whole picture, or above a threshold.

A threshold has a soft knee, so that nothing pops as a light crosses it. With m the
brightest of the three channels and T the threshold, the light above it is

    0 below T/2,     (m - T/2)^2 / 2T  up to 3T/2,     m - T from there on,

in the pixel's own colour. It scales with exposure when the threshold does. A pixel that
is NaN or infinite in any channel gives no light, and negative channels give none.
"""

import numpy as np
from jaxtyping import Float32

Picture = Float32[np.ndarray, "height width channels"]
Plane = Float32[np.ndarray, "height width"]
_KNEE = 0.5
"""Half the width of the knee over the threshold."""


def all_light(colour: Picture) -> Picture:
    """The light of a picture, never negative, always finite."""
    light = np.maximum(colour, np.float32(0))
    if is_finite(colour):
        return light
    return np.where(np.isfinite(colour).all(-1, keepdims=True), light, np.float32(0))


def is_finite(colour: Picture) -> bool:
    """Whether no pixel is NaN or infinite: no finite ones add up to that in double."""
    return bool(np.isfinite(colour.sum(dtype=np.float64)))


def light_above(colour: Picture, threshold: float) -> Picture:
    """The part of the light that is above a threshold; all of it above 0."""
    light = all_light(colour)
    if threshold == 0:
        return light
    brightest = brightest_channel(light)
    share = _above(brightest, threshold)
    share /= np.maximum(brightest, np.finfo(np.float32).tiny)
    light *= share[..., None]
    return light


def brightness_above(colour: Picture, threshold: float) -> Plane:
    """The brightest channel of `light_above`."""
    brightest = brightest_channel(all_light(colour))
    return brightest if threshold == 0 else _above(brightest, threshold)


def brightest_channel(colour: Picture) -> Plane:
    """Of one or three channels."""
    first, *others = np.moveaxis(colour, -1, 0)
    result = first.copy()
    for channel in others:
        np.maximum(result, channel, out=result)
    return result


def _above(brightest: Plane, threshold: float) -> Plane:
    """Along the knee the square, beyond it the line; below it nothing is left."""
    low, width = (1 - _KNEE) * threshold, 2 * _KNEE * threshold
    over = brightest - np.float32(low)
    along = np.clip(over, 0, np.float32(width))
    over -= along
    np.maximum(over, 0, out=over)
    along *= along
    along *= np.float32(1 / (2 * width))
    over += along
    return over


def picture_with_halo(
    colour: Picture, light: Picture, halo: Picture, share: float
) -> Picture:
    """The picture with a share of some light taken away and laid down as its halo."""
    result = halo - light
    result *= np.float32(share)
    result += colour
    return result
