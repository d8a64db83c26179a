"""Defocus of the light at each pixel of a picture, weighted by that light.

A light's own distance is known where it stands in the plate, but its disc lies over
pixels of other distances. So highlights, and highlights times the radius of their
discs, are each spread by a Gaussian as wide as the disc, and divided:

    r = sum of (light radius) spread / sum of light spread.

This only scales other effects, so it is computed at a small size.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32

from lensfit.rendering.circle import Circle
from lensfit.rendering.look.halo import octave_shares, octaves_spread
from lensfit.rendering.look.light import brightness_above
from lensfit.rendering.look.pyramid import Picture, halved, padded

LEVEL = 2
_LEAST_PX = 1.0
_DISC_SIGMA = 0.5
"""Standard deviation of a disc, along one direction, over its radius."""
_MOST_OCTAVES = 10

Plane = Float32[np.ndarray, "height width"]


class SharpLayer(NamedTuple):
    """What stands in the plate, before the lens blurs it.

    Attributes
    ----------
    colour : Premultiplied, dimmed by what stands before it.
    radius_px : Signed radius of its blur; None where nothing is known of depth.
    """

    colour: Picture
    radius_px: Plane | None


def sharp_layers(
    rgba: Sequence[Float32[np.ndarray, "height width 4"]],
    depth_mm: Sequence[Float32[np.ndarray, "height width"]],
    circle: Circle,
) -> list[SharpLayer]:
    """Layers front to back, each dimmed by what stands before it.

    Parameters
    ----------
    rgba : Premultiplied, front to back.
    depth_mm : Of each, from the entrance pupil.
    circle : Radius of blur of a distance.
    """
    found, through = [], None
    for colour, depth in zip(rgba, depth_mm, strict=True):
        seen = colour[..., :3]
        seen = seen if through is None else seen * through
        found.append(SharpLayer(seen, circle.radius_px(depth)))
        left = np.clip(1 - colour[..., 3:], 0, 1)
        through = left if through is None else through * left
    return found


def blur_of_light(layers: Sequence[SharpLayer], threshold: float) -> Plane:
    """Radius of the discs that highlights arrive in, 0 where there are none.

    Parameters
    ----------
    threshold : As `light_above`.

    Returns
    -------
    In pixels of the whole picture, at a quarter of its size (and what `padded` adds).
    """
    parts = []
    for layer in layers:
        if layer.radius_px is None:
            continue
        light = brightness_above(layer.colour, threshold)
        both = np.stack([light, light * np.abs(layer.radius_px)], -1)
        parts.append(halved(padded(both, LEVEL), LEVEL))
    if not parts:
        height, width = layers[0].colour.shape[:2]
        return np.zeros((-(-height >> LEVEL), -(-width >> LEVEL)), np.float32)
    spread = sum((_as_discs(part) for part in parts), np.zeros_like(parts[0]))
    return spread[..., 1] / np.maximum(spread[..., 0], np.finfo(np.float32).tiny)


def _as_discs(part: Picture) -> Picture:
    """Light and its radius, spread as far as that radius."""
    light = np.maximum(part[..., :1], np.finfo(np.float32).tiny)
    radius_px = np.maximum(part[..., 1:], 0) / light
    smallest_px = float(2**LEVEL)
    square = 1 + (radius_px * np.float32(_DISC_SIGMA / smallest_px)) ** 2
    octaves = int(np.ceil(np.log2(float(square.max())) / 2)) + 1
    shares = octave_shares(square, min(octaves, _MOST_OCTAVES))
    # The smallest is no blur: sizes count in quadrature from one small pixel.
    sigmas = [smallest_px * (4.0**n - 1) ** 0.5 for n in range(len(shares))]
    sigmas = [max(sigma, 1e-3) for sigma in sigmas]
    return octaves_spread(part, LEVEL, sigmas, shares, _LEAST_PX)
