"""A flat plate with depth as layers: what stands in front, and what lies behind it."""

import numpy as np
from jaxtyping import Float32

from lensfit.render.layer_stack import LayerStack, Mattes, check_depth


def split_layers(
    pixels: Float32[np.ndarray, "height width channels"],
    depth_mm: Float32[np.ndarray, "height width"],
    mattes: Mattes | None = None,
) -> LayerStack:
    """Layers of a flat plate.

    Parameters
    ----------
    pixels : One grey channel, r g b, or r g b alpha; premultiplied.
    depth_mm : Of every pixel; the nearer or the farther of two that share one.
    mattes : Who shares it, where the plate knows.
    """
    check_depth(depth_mm, pixels.shape[:2])
    rgba = np.ones((*pixels.shape[:2], 4), np.float32)
    rgba[..., : max(pixels.shape[-1], 3)] = pixels
    return LayerStack(rgba[None], depth_mm[None])
