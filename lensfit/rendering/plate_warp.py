"""Warp a plate's layers, lights and depth by the chief-ray maps.

Each colour is warped by its own map. What belongs to no colour (coverage, depth, ids)
is warped by green's, and so is whatever is decided from colours: lights are detected on
the plate before the warp, outlines are judged by `FlatPlate.guide`. So a channel's
lateral colour moves that channel and no other.
"""

import numpy as np
from jaxtyping import Float32

from lensfit.coords import Window
from lensfit.rendering.buffers import aligned_empty
from lensfit.rendering.defocus import stays_sharp
from lensfit.rendering.filters import Filter
from lensfit.rendering.flat_plate import FlatPlate
from lensfit.rendering.highlights import Highlights, take_highlights
from lensfit.rendering.layer_stack import LayerStack, Mattes
from lensfit.rendering.nearest import linear, nearest
from lensfit.rendering.render_stages import Stages
from lensfit.rendering.warp import warp


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
