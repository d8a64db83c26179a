"""The order in which a lens acts on a plate.

chief-ray warp      distortion and lateral colour, for each channel
depth of field      in the distorted picture, on the window with its margin, before any
                    light is lost: each layer blurred by the lens' own kernels
illumination        relative illumination as a gain
looks               filters, reflections, glare, white balance (`look.stack`), on the
                    window with its margin
crop                the margin and the overscan are removed last

Each colour is warped by its own chief-ray map. What belongs to no colour (coverage,
depth, ids) is warped by green's, and so is whatever is decided from colours: lights are
detected on the plate before the warp, outlines are judged by `FlatPlate.guide`. So a
channel's lateral colour moves that channel and no other.
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Float32

from lensfit.coords import Window
from lensfit.preset.knob_groups import LookKnobs
from lensfit.rendering.buffers import aligned_empty, crop
from lensfit.rendering.defocus import blurred_layers, blurred_plate, stays_sharp
from lensfit.rendering.filters import Filter, filter_for
from lensfit.rendering.highlights import Highlights, take_highlights
from lensfit.rendering.layer_stack import (
    LayerStack,
    Mattes,
    check_depth,
    flattened_layers,
)
from lensfit.rendering.look.glare import SharpLayer, sharp_layers
from lensfit.rendering.look.stack import Arrival, light_spreads
from lensfit.rendering.look.white_balance import Chromaticities
from lensfit.rendering.plate_surfaces import FlatPlate
from lensfit.rendering.render_stages import (
    DEFAULT_TOLERANCE,
    Stages,
    Switches,
    apply_gain,
    prepare_stages,
)
from lensfit.rendering.warp import linear, nearest, warp

if TYPE_CHECKING:
    from lensfit.lens import Lens


def render(
    rgb: Float[np.ndarray, "height width channels"] | LayerStack,
    depth_mm: Float[np.ndarray, "height width"] | None,
    lens: "Lens",
    *,
    tolerance: float = DEFAULT_TOLERANCE,
    data_window: Window | None = None,
    display_window: Window | None = None,
    keep_overscan: bool = False,
    sensor_width_mm: float | None = None,
    switches: Switches | None = None,
    method: Filter | None = None,
    mattes: Mattes | None = None,
    look: LookKnobs | None = None,
    chromaticities: Chromaticities | None = None,
    depth_levels: int | None = None,
) -> Float32[np.ndarray, "out_height out_width channels"]:
    """The plate as the lens would have photographed it.

    Parameters
    ----------
    rgb : Undistorted plate, scene-linear: r, g, b, or r, g, b, alpha, premultiplied;
        or the layers of a deep plate.
    depth_mm : Perpendicular distance from the lens' entrance pupil (the pinhole of the
        CG camera) of every pixel; infinite is allowed. None leaves defocus out.
    lens : Lens at the camera state of the plate.
    tolerance : Accepted error of the picture, display-referred.
    data_window : Where the pixels of `rgb` lie; larger than the display window if
        the plate has overscan. The display window if None.
    display_window : The frame, which spans the sensor width; the whole of `rgb` if
        None.
    keep_overscan : Return the data window rather than the display window.
    sensor_width_mm : Width that the display window spans; the lens' own if None.
    switches : Effects of the lens that are wanted; all if None.
    method : Interpolating filter; chosen by the tolerance if None.
    mattes : Coverage of the objects that share a pixel, where the plate knows it.
    look : Bloom, glints, filters, ghosts, white balance; none if None.
    chromaticities : x and y of red, green, blue and white of the plate, for the white
        balance; Rec. 709 if None.
    depth_levels : Levels that depth is cut into; by the tolerance if None.

    Returns
    -------
    The display window, or the data window; four channels for a deep plate.

    Raises
    ------
    ValueError : Shapes do not fit, or a distance is not positive or NaN.
    """
    if isinstance(rgb, LayerStack):
        pixels, (height, width) = rgb, rgb.depth_mm.shape[1:]
    else:
        pixels = np.asarray(rgb, np.float32)
        if pixels.ndim != 3 or pixels.shape[2] not in (3, 4):
            raise ValueError(f"a plate is (height, width, 3 or 4), not {pixels.shape}")
        height, width = pixels.shape[:2]
    if depth_mm is not None:
        depth_mm = np.asarray(depth_mm, np.float32)
    display_window = display_window or Window.of_size(width, height)
    data_window = data_window or display_window
    output = data_window if keep_overscan else display_window
    has_depth = depth_mm is not None or isinstance(rgb, LayerStack)
    spreads = has_depth or light_spreads(look)
    stages = prepare_stages(
        lens,
        display_window,
        window_with_margin(output, data_window, display_window if has_depth else None)
        if spreads
        else output,
        tolerance=tolerance,
        switches=switches,
        sensor_width_mm=sensor_width_mm,
        look=look,
        chromaticities=chromaticities,
        depth_levels=depth_levels,
    )
    return render_stages(
        pixels,
        data_window,
        stages,
        output,
        method=method or filter_for(tolerance),
        depth_mm=depth_mm,
        mattes=mattes,
    )


_REACHED_OF_FRAME = 0.45
"""How far beside the output there is light whose blur comes into it, in the larger side
of the frame. Far beyond the frame a lens was not photographed, and what is fitted leads
light nowhere."""


def window_with_margin(
    output_window: Window,
    data_window: Window,
    blurred_frame: Window | None = None,
) -> Window:
    """The window to prepare stages for when there is depth, or a look that spreads
    light: it comes from beside the output, as far as the plate has any.

    Parameters
    ----------
    blurred_frame : Display window of a plate that is blurred by its depth: the blur of
        what lies farther beside the output than a part of it does not reach that.
    """
    a, b = output_window, data_window
    if blurred_frame is not None:
        side_px = max(blurred_frame.width, blurred_frame.height)
        margin_px = math.ceil(_REACHED_OF_FRAME * side_px)
        b = b.common(a.grown(margin_px, margin_px)) or a
    return Window(
        min(a.x_min, b.x_min),
        min(a.y_min, b.y_min),
        max(a.x_max, b.x_max),
        max(a.y_max, b.y_max),
    )


def render_stages(
    pixels: Float32[np.ndarray, "height width channels"] | LayerStack,
    data_window: Window,
    stages: Stages,
    output_window: Window,
    *,
    method: Filter = "catmull-rom",
    depth_mm: Float32[np.ndarray, "height width"] | None = None,
    mattes: Mattes | None = None,
    in_front: LayerStack | None = None,
) -> Float32[np.ndarray, "out_height out_width channels"]:
    """`render` with everything about the lens prepared already.

    Parameters
    ----------
    pixels : One grey channel, r g b, or r g b alpha; scene-linear, premultiplied; or
        the layers of a deep plate, which are returned as r g b alpha.
    data_window : Where they lie.
    stages : What the lens does; its window holds `output_window` (for a plate with
        depth, or a look that spreads light: `window_with_margin`).
    output_window : Pixels to return.
    method : Interpolating filter.
    depth_mm : As in `render`; None leaves defocus out (of a flat plate).
    mattes : As in `render`.
    in_front : Layers cut out of a flat plate with depth, over the same window.
    """
    look = stages.look
    whole = look is not None and look.spreads
    window = stages.window if whole else output_window
    if isinstance(pixels, LayerStack) and stages.defocus is not None:
        layers, lights = warped_layers(pixels, data_window, stages, method)
        seen = _with_lights(layers, lights) if stages.look else []
        arrival = _arrival(stages, seen, list(layers.depth_mm))
        blurred = blurred_layers(layers, stages.window, window, stages.defocus, lights)
        picture = _with_relative_illumination(blurred, stages, window)
    elif depth_mm is None or stages.defocus is None:
        flat = flattened_layers(pixels) if isinstance(pixels, LayerStack) else pixels
        there = warped_plate(flat, data_window, stages, method)
        arrival = _arrival(stages, [there])
        picture = crop(
            _with_relative_illumination(there, stages), stages.window, window
        )
    else:
        assert isinstance(pixels, np.ndarray)
        check_depth(depth_mm, pixels.shape[:2])
        front, front_lights = None, []
        if in_front is not None:
            front, front_lights = warped_layers(in_front, data_window, stages, method)
        flat = warped_flat_plate(
            pixels, depth_mm, data_window, stages, method, mattes, front
        )
        colours, depths = [], []
        if front is not None:
            colours, depths = _with_lights(front, front_lights), front.depth_mm
        seen = [*colours, flat.picture] if stages.look else []
        arrival = _arrival(stages, seen, [*depths, flat.depth_mm])
        blurred = blurred_plate(
            flat, stages.window, window, stages.defocus, front, front_lights
        )
        picture = _with_relative_illumination(blurred, stages, window)[
            ..., _CHANNELS_OF[pixels.shape[-1]]
        ]
    if look is None:
        return picture
    return crop(look.applied(picture, window, arrival), window, output_window)


def _with_lights(
    layers: LayerStack, lights: Sequence[Highlights | None]
) -> list[Float32[np.ndarray, "height width 4"]]:
    """Layers with the lights that were taken off them."""
    seen = [rgba.copy() for rgba in layers.rgba]
    for rgba, found in zip(seen, lights, strict=True):
        if found is not None:
            rgba[..., :3] += found.light
    return seen


_CHANNELS_OF = {1: slice(1, 2), 3: slice(0, 3), 4: slice(0, 4)}


def _arrival(
    stages: Stages,
    rgba: Sequence[Float32[np.ndarray, "height width channels"]],
    depth_mm: Sequence[Float32[np.ndarray, "height width"]] | None = None,
) -> Arrival:
    """What looks must know of the plate before it is blurred, layers front to back."""
    look = stages.look
    if look is None or not look.wants_arrival:
        return Arrival(None, None)
    if depth_mm is None or stages.defocus is None:
        return look.arrival([SharpLayer(rgba[0][..., :3], None)])
    return look.arrival(sharp_layers(rgba, depth_mm, stages.defocus.circle))


def _with_relative_illumination(
    pixels: Float32[np.ndarray, "height width channels"],
    stages: Stages,
    window: Window | None = None,
) -> Float32[np.ndarray, "height width channels"]:
    """Relative illumination; alpha is coverage, which does not dim."""
    gains = [
        gain if gain is None or window is None else crop(gain, stages.window, window)
        for gain in stages.gains
    ]
    each = {1: gains[1:2], 3: gains, 4: [*gains, None]}
    return apply_gain(pixels, each[pixels.shape[-1]])


def warped_flat_plate(
    pixels: Float32[np.ndarray, "height width channels"],
    depth_mm: Float32[np.ndarray, "height width"],
    data_window: Window,
    stages: Stages,
    method: Filter,
    mattes: Mattes | None = None,
    front: LayerStack | None = None,
) -> FlatPlate:
    """A flat plate over the window of the stages, which have depth of field.

    Parameters
    ----------
    pixels : One grey channel, r g b, or r g b alpha.
    depth_mm : Positive, from the entrance pupil.
    data_window : Where they lie.
    mattes : Coverage of the objects that share a pixel, where the plate knows it.
    front : What was cut out of the plate, as it has landed.
    """
    assert stages.defocus is not None
    circle, green = stages.defocus.circle, stages.maps[1]
    rgba = _with_alpha(pixels)
    there_mm = nearest(depth_mm, data_window, green)
    there_px = circle.radius_px(there_mm)
    ids = _landed_mattes(mattes, data_window, stages)
    if front is None and stays_sharp(there_px, stages.window, stages.defocus):
        there = warped_plate(rgba, data_window, stages, method)
        return FlatPlate(there, there_mm, there_px, mattes=ids, is_sharp=True)
    rgba = np.nan_to_num(rgba, copy=False, nan=0.0, posinf=0.0, neginf=0.0)
    plate_px = circle.radius_px(depth_mm)
    lights = take_highlights(rgba, plate_px)
    there_px = nearest(plate_px, data_window, green)
    if lights is not None:
        lights = _landed_lights(lights, data_window, stages)
    there, guide = warped_plate(rgba, data_window, stages, method), None
    if len({id(m) for m in stages.maps}) > 1:
        guide = warp(rgba, data_window, green, method=method, alpha_channel=3)
    return FlatPlate(there, there_mm, there_px, lights, guide, ids)


def _landed_lights(
    lights: Highlights, data_window: Window, stages: Stages
) -> Highlights:
    """Each colour by its own map, the radius of its blur by green's.

    Linear weights: they keep light and its middle whatever the fraction of a pixel. A
    cubic would put a ring about each light, or more light than there was, and what
    is lost in sharpness the blur takes anyway.
    """
    light = [
        linear(np.ascontiguousarray(lights.light[..., c]), data_window, source_map)
        for c, source_map in enumerate(stages.maps)
    ]
    green = stages.maps[1]
    radius_px = nearest(lights.radius_px, data_window, green)
    mask = linear(lights.mask, data_window, green)
    return Highlights(np.stack(light, -1), radius_px, mask)


def warped_plate(
    pixels: Float32[np.ndarray, "height width channels"],
    data_window: Window,
    stages: Stages,
    method: Filter,
) -> Float32[np.ndarray, "height width channels"]:
    """The plate through the chief-ray maps, over the window of the stages."""
    red, green, blue = stages.maps
    maps = {1: [green], 3: [red, green, blue], 4: [red, green, blue, green]}
    count = pixels.shape[-1]
    alpha_channel = 3 if count == 4 else None
    return warp(
        pixels, data_window, maps[count], method=method, alpha_channel=alpha_channel
    )


def warped_layers(
    stack: LayerStack,
    data_window: Window,
    stages: Stages,
    method: Filter,
) -> tuple[LayerStack, list[Highlights | None]]:
    """Every layer through the maps, without its small bright lights, and these; a
    distance is that of the nearest pixel, since a mean of two is nobody's."""
    colours, found = [], []
    for rgba, depth_mm in zip(stack.rgba, stack.depth_mm, strict=True):
        rgba, lights = rgba.copy(), None
        if stages.defocus is not None:
            rgba = np.nan_to_num(rgba, copy=False, nan=0.0, posinf=0.0, neginf=0.0)
            lights = take_highlights(rgba, stages.defocus.circle.radius_px(depth_mm))
        if lights is not None:
            lights = _landed_lights(lights, data_window, stages)
        found.append(lights)
        colours.append(warped_plate(rgba, data_window, stages, method))
    depth = [nearest(z, data_window, stages.maps[1]) for z in stack.depth_mm]
    return LayerStack(np.stack(colours), np.stack(depth)), found


def _landed_mattes(
    mattes: Mattes | None, data_window: Window, stages: Stages
) -> Mattes | None:
    """Ids are never mixed, so coverage is not either."""
    if mattes is None:
        return None
    green = stages.maps[1]
    bits = [nearest(m.view(np.float32), data_window, green) for m in mattes.ids]
    share = [nearest(m, data_window, green) for m in mattes.coverage]
    return Mattes(np.stack(bits).view(np.uint32), np.stack(share))


def _with_alpha(
    pixels: Float32[np.ndarray, "height width channels"],
) -> Float32[np.ndarray, "height width 4"]:
    """Grey as three channels, and opaque where nothing else is said."""
    rgba = aligned_empty((*pixels.shape[:2], 4))
    rgba[..., 3] = 1
    rgba[..., : max(pixels.shape[-1], 3)] = pixels
    return rgba
