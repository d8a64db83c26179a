"""The plate before the lens blurs it, layer by layer, for looks."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float32

from lensfit.rendering.circle import Circle
from lensfit.rendering.look.blur_of_light import SharpLayer


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
