"""Render a deep plate to a flat frame, with the background that its samples hold.

The plate becomes layers, front to back: every sample that blurs separately is kept.
Samples of a pixel that blur alike are merged: they are composited, at the mean of their
inverse distances weighted by visible coverage. The k-th layer then holds the k-th
remaining sample of every pixel.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float32, Int

from lensfit.coords import Window
from lensfit.errors import ImageError
from lensfit.io.depth_channel import (
    DepthMeaning,
    FoundDepth,
    perpendicular_mm,
    ray_slant,
)
from lensfit.io.exr import ExrImage
from lensfit.io.exr_deep import DeepPart, read_deep
from lensfit.plate.camera.plate_state import PlateState
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
    reach = window
    if spreads:
        blurs = options.switches.defocus
        reach = lens.reach(window, source, display, blurs=blurs)
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
    return ExrImage((lens.with_signed_header(result, state),))


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


Samples = tuple[
    Float32[np.ndarray, " samples"],
    Float32[np.ndarray, "samples 4"],
    Int[np.ndarray, " samples"],
]
"""Distance, colour, and which pixel, sorted by pixel and distance."""
_INFINITE = np.float32(np.inf)
_LEAST_SHOWN = np.float32(1e-6)


def deep_layers(
    part: DeepPart,
    meaning: DepthMeaning,
    slant: Float32[np.ndarray, "height width"] | float = 1.0,
    *,
    depth_channel: str | None = None,
    slab_of: Callable[[np.ndarray], np.ndarray] | None = None,
) -> LayerStack:
    """The layers of a deep plate.

    Parameters
    ----------
    part : With R, G, B (or Y), Z, and A unless every sample is opaque.
    meaning : What its Z says.
    slant : Length of the ray through each pixel to a plane at distance 1.
    depth_channel : Name of Z, if it has another one.
    slab_of : Number of the slab that distances (mm) lie in; those of one slab blur
        alike. None keeps every sample.

    Raises
    ------
    ImageError : It has no colour or no depth.
    """
    own = np.repeat(np.arange(part.counts.size), part.counts.ravel())
    slants = np.broadcast_to(slant, part.counts.shape).ravel()[own]
    depth = perpendicular_mm(_depth(part, depth_channel), meaning, slants)
    depth = np.where(np.isnan(depth), _INFINITE, depth)
    order = np.lexsort((depth, own))
    depth, rgba, own = depth[order], _colours(part)[order], own[order]
    if slab_of is not None and len(depth):
        depth, rgba, own = _joined_samples((depth, rgba, own), slab_of(depth))
    rank = _rank_in(own)
    layers = int(rank.max(initial=0)) + 1
    size = part.counts.shape
    stack = np.zeros((layers, part.counts.size, 4), np.float32)
    away = np.full((layers, part.counts.size), _INFINITE)
    stack[rank, own], away[rank, own] = rgba, depth
    return LayerStack(stack.reshape(layers, *size, 4), away.reshape(layers, *size))


def _joined_samples(samples: Samples, slab: np.ndarray) -> Samples:
    """One sample for each slab of each pixel."""
    depth, rgba, pixel = samples
    begins = np.ones(len(depth), bool)
    begins[1:] = (pixel[1:] != pixel[:-1]) | (slab[1:] != slab[:-1])
    group = np.cumsum(begins) - 1
    rank = _rank_in(group)
    joined = np.zeros((group[-1] + 1, 4), np.float32)
    weight = np.zeros(len(joined), np.float32)
    vergence = np.zeros(len(joined), np.float32)
    for k in range(int(rank.max()) + 1):
        at = rank == k
        into = group[at]
        shown = (1 - joined[into, 3:]) * rgba[at]
        share = shown[:, 3] + _LEAST_SHOWN
        joined[into] += shown
        weight[into] += share
        vergence[into] += share / depth[at]
    with np.errstate(divide="ignore"):
        return weight / vergence, joined, pixel[begins]


def _rank_in(group: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """Place of each in its group; groups are whole and in rising order."""
    return np.arange(len(group)) - np.searchsorted(group, group)


def _colours(part: DeepPart) -> Float32[np.ndarray, "samples 4"]:
    """Red, green, blue, alpha of every sample; opaque where there is no alpha."""
    total = int(part.counts.sum())
    rgba = np.ones((total, 4), np.float32)
    for names in (("R", "G", "B"), ("r", "g", "b"), ("Y", "Y", "Y")):
        if all(name in part.samples for name in names):
            for index, name in enumerate(names):
                rgba[:, index] = part.samples[name]
            break
    else:
        raise ImageError(
            "holds deep pixels without R, G, B",
            remedy=f"its channels are {', '.join(part.samples)}",
        )
    alpha = next((n for n in ("A", "a", "alpha") if n in part.samples), None)
    if alpha is not None:
        rgba[:, 3] = np.clip(part.samples[alpha], 0, 1)
    return rgba


def _depth(part: DeepPart, name: str | None) -> Float32[np.ndarray, " samples"]:
    """Middle of every sample."""
    name = name or "Z"
    if name not in part.samples:
        raise ImageError(
            f"holds deep pixels without {name}",
            remedy=f"its channels are {', '.join(part.samples)}",
        )
    front = part.samples[name].astype(np.float32)
    if name == "Z" and "ZBack" in part.samples:
        back = part.samples["ZBack"].astype(np.float32)
        return np.where(back > front, (front + back) / 2, front)
    return front
