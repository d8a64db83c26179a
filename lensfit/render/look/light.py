"""The light that an effect acts on: all of a picture's, or what is above a threshold.

A threshold has a soft knee, so that nothing pops as a light crosses it. With m the
brightest of the three channels and T the threshold, the light above it is

    0 below T/2,     (m - T/2)^2 / 2T  up to 3T/2,     m - T from there on,

in the pixel's own colour. It scales with exposure when the threshold does. A pixel that
is NaN or infinite in any channel gives no light, and negative channels give none.
"""

import numpy as np
from jaxtyping import Float32

Picture = Float32[np.ndarray, "height width channels"]
_KNEE = 0.5
"""Half the width of the knee over the threshold."""


def all_light(colour: Picture) -> Picture:
    """The light of a picture, never negative, always finite."""
    known = np.isfinite(colour).all(-1, keepdims=True)
    if known.all():
        return np.maximum(colour, np.float32(0))
    return np.where(known, np.maximum(colour, 0), np.float32(0))


def light_above(colour: Picture, threshold: float) -> Picture:
    """The part of the light that is above a threshold; all of it above 0."""
    light = all_light(colour)
    if threshold == 0:
        return light
    brightest = light.max(-1, keepdims=True)
    t = np.float32(threshold)
    # Along the knee the square, beyond it the line; below it nothing is left.
    rise = np.clip(brightest - t * np.float32(1 - _KNEE), 0, 2 * _KNEE * t)
    above = rise * rise / np.float32(4 * _KNEE * t)
    above += np.maximum(brightest - t * np.float32(1 + _KNEE), 0)
    above /= np.maximum(brightest, np.finfo(np.float32).tiny)
    light *= above
    return light


def moved(colour: Picture, light: Picture, halo: Picture, share: float) -> Picture:
    """The picture with a share of some light taken away and laid down as its halo."""
    result = halo - light
    result *= np.float32(share)
    result += colour
    return result
