"""A plate in depth: layers of premultiplied colour, each pixel with its own distance.

A flat plate is one layer. A deep plate has several, and those behind hold what the
front ones hide. Distances are perpendicular ones from the pinhole of the CG camera,
which is the lens' entrance pupil, in millimetres; the sky is at infinity. Where a
layer is empty (alpha 0) its distance means nothing, but is a number all the same.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, UInt32


@dataclass(frozen=True, eq=False)
class LayerStack:
    """Layers front to back.

    Attributes
    ----------
    rgba : Scene-linear, premultiplied.
    depth_mm : Of each pixel of each layer; positive, may be infinite, never NaN.
    """

    rgba: Float32[np.ndarray, "layers height width 4"]
    depth_mm: Float32[np.ndarray, "layers height width"]

    def __post_init__(self):
        if self.rgba.ndim != 4 or self.rgba.shape[3] != 4:
            raise ValueError(
                f"layers are (layers, height, width, 4), not {self.rgba.shape}"
            )
        check_depth(self.depth_mm, self.rgba.shape[:3])


@dataclass(frozen=True, eq=False)
class Mattes:
    """Which objects share a pixel, and how much of it each covers (Cryptomatte).

    Attributes
    ----------
    ids : Object of each rank, as bits; 0 where there is none.
    coverage : Share of the pixel, 0 to 1; ranks fall in coverage.
    """

    ids: UInt32[np.ndarray, "ranks height width"]
    coverage: Float32[np.ndarray, "ranks height width"]

    def __post_init__(self):
        if self.ids.ndim != 3 or self.ids.shape != self.coverage.shape:
            raise ValueError(
                f"ids {self.ids.shape} and coverage {self.coverage.shape} are no mattes"
            )


def check_depth(depth_mm: np.ndarray, shape: tuple[int, ...]) -> None:
    """Raise ValueError unless these are distances of pixels of this shape."""
    if depth_mm.shape != shape:
        raise ValueError(f"depth is {depth_mm.shape} and the picture {shape}")
    if not (depth_mm > 0).all():
        raise ValueError("depth_mm holds a distance that is not positive, or NaN")


def flattened_layers(stack: LayerStack) -> Float32[np.ndarray, "height width 4"]:
    """All layers over one another, as a pinhole sees them."""
    result = stack.rgba[-1].copy()
    for layer in stack.rgba[-2::-1]:
        result *= 1 - layer[..., 3:]
        result += layer
    return result
