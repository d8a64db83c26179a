"""Depth of field: every layer blurred by the lens' own kernels, near over far."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.fft
from jaxtyping import Float32

from lensfit.coords import Window
from lensfit.render.layer_stack import LayerStack
from lensfit.render.uv import PlateGeometry

if TYPE_CHECKING:
    from lensfit.lens import Lens

_SLICES = 12


@dataclass(frozen=True, eq=False)
class Defocus:
    """A lens on a plate, ready to blur it.

    Attributes
    ----------
    lens : At the camera state of the plate.
    geometry : How the plate lies on the sensor.
    tolerance : Accepted error of the picture, display-referred.
    """

    lens: "Lens"
    geometry: PlateGeometry
    tolerance: float


def defocused(
    layers: LayerStack, window: Window, output_window: Window, defocus: Defocus
) -> Float32[np.ndarray, "out_height out_width 4"]:
    """The layers as the lens shows them, composited.

    Parameters
    ----------
    layers : Over `window`, in the distorted picture.
    output_window : Pixels to return; inside `window`.
    """
    vergence = 1 / layers.depth_mm
    low, high = float(vergence.min()), float(vergence.max())
    levels = np.linspace(low, high, _SLICES if high > low else 1)
    nearest = np.abs(vergence[..., None] - levels).argmin(-1)
    offset = float(defocus.lens.entrance_pupil_offset_mm)
    pitch = defocus.geometry.area_mm[0] / defocus.geometry.size_px[0]
    size = 65
    kernels = np.asarray(
        defocus.lens.psfs(
            np.zeros((len(levels), 2)),
            1 / np.maximum(levels, 1e-12) + offset,
            ("g",),
            pixel_pitch_mm=pitch,
            size_px=size,
        )
    )[:, 0]
    pad = size // 2
    shape = [scipy.fft.next_fast_len(n + 2 * pad) for n in vergence.shape[1:]]
    inside = np.s_[pad : pad + vergence.shape[1], pad : pad + vergence.shape[2]]
    result = np.zeros((*vergence.shape[1:], 4))
    behind = np.zeros(vergence.shape[1:])
    for k, kernel in enumerate(kernels):
        here = layers.rgba * (nearest == k)[..., None]
        light = here.sum(0)
        behind = np.clip(behind + light[..., 3], 0, 1)
        planes = np.concatenate([light, behind[..., None]], -1)
        padded = np.zeros((*shape, 5))
        padded[inside] = planes
        otf = scipy.fft.rfft2(kernel, shape)[..., None]
        spread = scipy.fft.irfft2(
            scipy.fft.rfft2(padded, axes=(0, 1)) * otf, shape, axes=(0, 1)
        )
        spread = np.roll(spread, (-pad, -pad), (0, 1))[inside]
        reach = np.maximum(spread[..., 4:], 1e-6)
        seen = np.where(spread[..., 4:] > 1e-4, spread[..., :4] / reach, 0)
        result = seen + result * (1 - np.clip(seen[..., 3:], 0, 1))
    top, left = output_window.y_min - window.y_min, output_window.x_min - window.x_min
    cut = result[top : top + output_window.height, left : left + output_window.width]
    return cut.astype(np.float32)
