"""Relative illumination over a picture: the lens' fall-off as a gain per pixel.

Fall-off happens where the light lands, so it is applied after the warp, in the
distorted picture, and multiplies radiance only: alpha is coverage, which does not dim.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float32

from lensfit.coords import Window
from lensfit.rendering.smooth import PointFunction, smooth_over_window
from lensfit.rendering.uv import Channel, PlateGeometry

if TYPE_CHECKING:
    from lensfit.lens import Lens


def illumination_gain(
    lens: "Lens",
    geometry: PlateGeometry,
    window: Window,
    channel: Channel = "g",
    *,
    tolerance: float = 2.5e-4,
    landing: PointFunction | None = None,
) -> Float32[np.ndarray, "height width"]:
    """Relative illumination at each pixel of `window`, 1 on axis.

    Parameters
    ----------
    lens : Lens at its camera state.
    geometry : How the plate lies on the sensor.
    window : Pixels wanted.
    channel : Colour channel.
    tolerance : Largest error of the interpolation between exact evaluations.
    landing : Where a pixel's light lands, px to px, when the picture itself stays
        undistorted; each pixel is where it lands if None.
    """

    def gain(points_px: np.ndarray) -> np.ndarray:
        landed = points_px if landing is None else landing(points_px)
        value = lens.relative_illumination(geometry.mm(landed), channel)
        return np.asarray(value, float)[:, None]

    return smooth_over_window(gain, window, tolerance)[0].astype(np.float32)


def apply_gain(
    pixels: Float32[np.ndarray, "height width channels"],
    gains: Sequence[Float32[np.ndarray, "height width"] | None],
) -> Float32[np.ndarray, "height width channels"]:
    """Each channel times its gain; None leaves a channel as it is, bit for bit.

    NaN gains (outside what the lens images) give black.
    """
    if all(gain is None for gain in gains):
        return pixels
    return np.asarray(_multiplied(pixels, list(gains)))


@jax.jit
def _multiplied(pixels: Array, gains: list[Array | None]) -> Array:
    """In one pass over the picture; a pure function, for any device."""
    one = jnp.ones(pixels.shape[:2], pixels.dtype)
    planes = [one if gain is None else jnp.nan_to_num(gain, nan=0.0) for gain in gains]
    return pixels * jnp.stack(planes, -1)
