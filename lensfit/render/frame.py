"""The order in which a lens acts on a plate.

chief-ray warp      where each channel's light lands (distortion, lateral colour)
[depth of field]    not yet in this version: it goes here, in the distorted picture,
                    on the window with its margin, before any light is lost
illumination        how much of it arrives
crop                the margin and the overscan go last
"""

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Float32

from lensfit.coords import Window
from lensfit.render.falloff import apply_gain
from lensfit.render.filters import Filter
from lensfit.render.stages import (
    DEFAULT_TOLERANCE,
    Stages,
    Switches,
    prepare_stages,
)
from lensfit.render.warp import warp

if TYPE_CHECKING:
    from lensfit.lens import Lens


def render(
    rgb: Float[np.ndarray, "height width channels"],
    depth_mm: Float[np.ndarray, "height width"] | None,
    lens: "Lens",
    *,
    tolerance: float = DEFAULT_TOLERANCE,
    data_window: Window | None = None,
    display_window: Window | None = None,
    keep_overscan: bool = False,
    sensor_width_mm: float | None = None,
    switches: Switches | None = None,
    method: Filter = "catmull-rom",
) -> Float32[np.ndarray, "out_height out_width channels"]:
    """The plate as the lens would have photographed it.

    Parameters
    ----------
    rgb : Undistorted plate, scene-linear: r, g, b, or r, g, b, alpha, premultiplied.
    depth_mm : Must be None: this version does not model defocus.
    lens : Lens at the camera state of the plate.
    tolerance : Accepted error of the picture, display-referred.
    data_window : Where the pixels of `rgb` lie; larger than the display window if
        the plate has overscan. The display window if None.
    display_window : The frame, which spans the sensor width; the whole of `rgb` if
        None.
    keep_overscan : Return the data window rather than the display window.
    sensor_width_mm : Width that the display window spans; the lens' own if None.
    switches : Effects of the lens that are wanted; all if None.
    method : Interpolating filter.

    Returns
    -------
    The display window, or the data window.

    Raises
    ------
    ValueError : Depth is given, or shapes do not fit.
    """
    if depth_mm is not None:
        raise ValueError(
            "defocus is not modelled by this version of lensfit: pass depth_mm=None"
        )
    pixels = np.asarray(rgb, np.float32)
    if pixels.ndim != 3 or pixels.shape[2] not in (3, 4):
        raise ValueError(f"a plate is (height, width, 3 or 4), not {pixels.shape}")
    display_window = display_window or Window.of_size(pixels.shape[1], pixels.shape[0])
    data_window = data_window or display_window
    output = data_window if keep_overscan else display_window
    stages = prepare_stages(
        lens,
        display_window,
        output,
        tolerance=tolerance,
        switches=switches,
        sensor_width_mm=sensor_width_mm,
    )
    return render_stages(pixels, data_window, stages, output, method=method)


def render_stages(
    pixels: Float32[np.ndarray, "height width channels"],
    data_window: Window,
    stages: Stages,
    output_window: Window,
    *,
    method: Filter = "catmull-rom",
) -> Float32[np.ndarray, "out_height out_width channels"]:
    """`render` with everything about the lens prepared already.

    Parameters
    ----------
    pixels : One grey channel, r g b, or r g b alpha; scene-linear, premultiplied.
    data_window : Where they lie.
    stages : What the lens does; its window holds `output_window`.
    output_window : Pixels to return.
    method : Interpolating filter.
    """
    red, green, blue = stages.maps
    maps = {1: [green], 3: [red, green, blue], 4: [red, green, blue, green]}
    gains = {1: stages.gains[1:2], 3: stages.gains, 4: (*stages.gains, None)}
    count = pixels.shape[-1]
    alpha_channel = 3 if count == 4 else None

    landed = warp(
        pixels, data_window, maps[count], method=method, alpha_channel=alpha_channel
    )
    lit = apply_gain(landed, gains[count])
    return crop(lit, stages.window, output_window)


def crop(
    pixels: Float32[np.ndarray, "height width channels"],
    window: Window,
    wanted: Window,
) -> Float32[np.ndarray, "out_height out_width channels"]:
    """The part of `pixels`, which lie on `window`, that lies on `wanted`.

    Raises
    ------
    ValueError : `wanted` reaches beyond `window`.
    """
    top, left = wanted.y_min - window.y_min, wanted.x_min - window.x_min
    inside = wanted.x_max <= window.x_max and wanted.y_max <= window.y_max
    if min(top, left) < 0 or not inside:
        raise ValueError(f"{wanted} is not inside {window}")
    return pixels[top : top + wanted.height, left : left + wanted.width]
