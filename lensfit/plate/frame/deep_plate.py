"""Render a deep plate to a flat frame, with the background that its samples hold."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from lensfit.coords import Window
from lensfit.io.depth_channel import DepthMeaning, FoundDepth, ray_slant
from lensfit.io.exr import ExrImage
from lensfit.io.exr_deep import DeepPart, read_deep
from lensfit.plate.camera.plate_state import PlateState
from lensfit.plate.deep_layers import deep_layers
from lensfit.plate.frame.plate_lens import PlateLens
from lensfit.plate.frame.tight_window import (
    EmptyRing,
    first_pixel,
    is_tight,
    known_window,
)
from lensfit.plate.plate_depth import depth_meaning
from lensfit.rendering.buffers import crop
from lensfit.rendering.circle import Circle
from lensfit.rendering.frame import render_stages
from lensfit.rendering.layer_stack import LayerStack, flattened_layers
from lensfit.rendering.look.stack import light_spreads
from lensfit.rendering.plate_defocus import DefocusBudget

DEEP_IS_FLAT = "deep plates are returned flat, as R, G, B, A"
_DEEP_ATTRIBUTES = ("deepImageState", "maxSamplesPerPixel", "version", "chunkCount")


def render_deep(lens: PlateLens, path: Path) -> ExrImage:
    """The finished frame of a deep plate: R, G, B, A over one another.

    Raises
    ------
    ImageError : It has no colour or no depth, or the f-number or focus distance of its
        depth of field is not known.
    """
    deep = read_deep(path)
    flat, options = deep.flat, lens.options
    source, display = flat.data_window, flat.display_window
    image = ExrImage((flat,))
    state = lens.noted_state(image, path)
    found = FoundDepth(flat, options.depth.channel or "Z")
    meaning, notes = depth_meaning(image, found, options.depth)
    meaning = replace(meaning, unit_mm=meaning.unit_mm / state.scaled.distances)
    stack = _stack_of(deep, meaning, lens, state)
    tight = is_tight(source, display)
    window = options.written(source, display)
    window = window.joined(display) if tight else window
    if options.switches.defocus:
        state.require_blur()
        lens.note_focus(stack.depth_mm, meaning.unit_mm, state, display, path)
        depth = lens.within_reach(stack.depth_mm, state)
        pixels, spreads = LayerStack(stack.rgba, depth), True
    else:
        pixels, spreads = flattened_layers(stack), light_spreads(state.knobs.look)
    reach = lens.reach(window, source, display) if spreads else window
    stages = lens.stages_for(state, display, reach)
    lens.note_border(stages, window, known_window(source, display))
    lens.notes.add(*notes, DEEP_IS_FLAT)
    ring = EmptyRing.about(source, display)
    if isinstance(pixels, LayerStack):
        pixels = ring.about_layers(pixels)
    else:
        pixels = ring.empty(pixels)
    rendered = render_stages(pixels, ring.outer, stages, window, method=options.filter)
    kept = {k: v for k, v in flat.attributes.items() if k not in _DEEP_ATTRIBUTES}
    if tight:
        depth = pixels.depth_mm if isinstance(pixels, LayerStack) else None
        lit = lens.lit_window([rendered], stages, source, window, state, depth)
        whole, window = window, lit or first_pixel(window)
        rendered = crop(rendered, whole, window)
    planes = np.ascontiguousarray(np.moveaxis(rendered, -1, 0))
    channels = dict(zip("RGBA", planes, strict=True))
    result = replace(flat, channels=channels, data_window=window, attributes=kept)
    return ExrImage((lens.signed(result, state),))


def _stack_of(
    deep: DeepPart, meaning: DepthMeaning, lens: PlateLens, state: PlateState
) -> LayerStack:
    """Samples that blur by themselves, in layers."""
    display, slant = deep.flat.display_window, 1.0
    if meaning.kind == "ray":
        offsets = lens.geometry(state, display).mm(deep.data_window.pixel_centres())
        slant = ray_slant(offsets, lens.cg_focal_length_mm(state))
    return deep_layers(
        deep,
        meaning,
        slant,
        depth_channel=lens.options.depth.channel,
        slab_of=lambda depth_mm: _slab_of(depth_mm, lens, state, display),
    )


def _slab_of(
    depth_mm: np.ndarray, lens: PlateLens, state: PlateState, display: Window
) -> np.ndarray:
    """Numbers of the slabs that samples lie in: one for all where nothing blurs."""
    if not lens.options.switches.defocus:
        return np.zeros(depth_mm.shape, np.int32)
    state.require_blur()
    circle = Circle.of(lens.lens_at(state), lens.geometry(state, display))
    slabs = DefocusBudget.of(lens.options.tolerance).slabs
    return slabs.number_of(circle.radius_px(depth_mm))
