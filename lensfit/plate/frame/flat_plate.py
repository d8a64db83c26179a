"""Render a flat plate: its colour layers, blurred by its depth channel.

Every other channel, and Cryptomatte whatever its channels are called, keeps its bits:
ids and depths must not be mixed, so they still describe the *undistorted* plate.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float32

from lensfit.coords import Window
from lensfit.errors import ImageError
from lensfit.io.depth_channel import find_depth
from lensfit.io.exr import ExrImage, ExrPart
from lensfit.io.exr_layers import with_channels
from lensfit.plate.camera.plate_state import PlateState
from lensfit.plate.channels import ColourLayer, colour_layers, resized_channels
from lensfit.plate.frame.plate_in_depth import PlateInDepth, plate_in_depth
from lensfit.plate.frame.plate_lens import PlateLens
from lensfit.plate.frame.plate_notes import layer_depth_notes, number_note
from lensfit.plate.frame.tight_window import (
    EmptyRing,
    first_pixel,
    is_tight,
    known_window,
)
from lensfit.rendering.buffers import aligned_empty, crop
from lensfit.rendering.frame import render_stages
from lensfit.rendering.look.stack import light_spreads
from lensfit.rendering.render_stages import Stages

Pixels = Float32[np.ndarray, "height width channels"]


def render_flat(
    lens: PlateLens,
    image: ExrImage,
    path: Path,
    header: ExrImage | None = None,
    picked_in: ExrImage | None = None,
) -> ExrImage:
    """The finished frame of a flat plate of one view.

    Parameters
    ----------
    header : States its camera, if `image` itself does not.
    picked_in : The view with the pixel that is in focus, if not this one.

    Raises
    ------
    ImageError : No part holds colour.
    """
    state = lens.noted_state(header or image, path, picked_in)
    found = layers_to_render(image, lens.options.layers)
    return ExrImage(
        tuple(
            _rendered(lens, part, found.get(id(part), []), state, (image, path))
            for part in image.parts
        )
    )


def layers_to_render(
    image: ExrImage, wanted: Sequence[str] | None
) -> dict[int, list[ColourLayer]]:
    """The layers to render of each part with colour, by the part's `id`; at least one.

    Parameters
    ----------
    wanted : Only these layers; all if None.

    Raises
    ------
    ImageError : There is none.
    """
    found = {id(part): colour_layers(part, wanted) for part in image.parts}
    found = {part: layers for part, layers in found.items() if layers}
    if not found:
        raise _no_colour(image, wanted)
    return found


def _rendered(
    lens: PlateLens,
    part: ExrPart,
    layers: list[ColourLayer],
    state: PlateState,
    plate: tuple[ExrImage, Path],
) -> ExrPart:
    source, display = part.data_window, part.display_window
    tight = is_tight(source, display)
    window = lens.options.written(source, display)
    if not layers:
        part = lens.restated(part, state)
        return resized_channels(part, _own(source, window) if tight else window)
    window = window.joined(display) if tight else window
    deep = plate_in_depth(lens, part, state, *plate)
    if deep is not None:
        depth = find_depth(plate[0], lens.options.depth.channel, part)
        assert depth is not None
        lens.notes.add(*layer_depth_notes(part, layers, depth, plate[1].name))
    spreads = deep is not None or light_spreads(state.knobs.look)
    reach = window
    if spreads:
        reach = lens.reach(window, source, display, blurs=deep is not None)
    stages = lens.stages_for(state, display, reach)
    lens.note_border(stages, window, known_window(source, display))
    made = (
        (layer, _layer(lens, part, layer, stages, window, deep, plate[1].name))
        for layer in layers
    )
    kept = window
    if tight:
        made = list(made)  # what is written is known when all of them are there
        kept = _kept_window(lens, part, state, stages, window, made, deep)
    result = resized_channels(part, kept)
    for layer, pixels in made:
        result = with_channels(result, layer.names, crop(pixels, window, kept))
    return lens.signed(result, state)


def _layer(
    lens: PlateLens,
    part: ExrPart,
    layer: ColourLayer,
    stages: Stages,
    window: Window,
    deep: PlateInDepth | None,
    name: str,
) -> Pixels:
    """One colour layer over the window."""
    pixels = stacked_channels(part, layer.names)
    lens.notes.add(number_note(pixels, name))
    in_front = None
    if deep is not None and deep.cut_out is not None:
        pixels, in_front = deep.cut_out.cut(pixels)
    ring = EmptyRing.about(part.data_window, part.display_window)
    depth_mm, mattes = (None, None) if deep is None else (deep.depth_mm, deep.mattes)
    return render_stages(
        ring.empty(pixels),
        ring.outer,
        stages,
        window,
        method=lens.options.filter,
        depth_mm=None if depth_mm is None else ring.continued(depth_mm),
        mattes=None if mattes is None else ring.about_mattes(mattes),
        in_front=None if in_front is None else ring.about_layers(in_front),
    )


def _own(source: Window, window: Window) -> Window:
    """What a tight plate has of a window."""
    return source.common(window) or first_pixel(window)


def _kept_window(
    lens: PlateLens,
    part: ExrPart,
    state: PlateState,
    stages: Stages,
    window: Window,
    made: list[tuple[ColourLayer, Pixels]],
    deep: PlateInDepth | None,
) -> Window:
    """What is written of a plate that ends inside its frame: as far as its light comes,
    and all that it has of other channels."""
    source, options = part.data_window, lens.options
    depth_mm = None if deep is None else deep.seen_depth_mm
    pictures = [pixels for _, pixels in made]
    lit = lens.lit_window(pictures, stages, source, window, state, depth_mm)
    names = {name for layer, _ in made for name in layer.names}
    if part.channels.keys() - names:
        own = _own(source, options.written(source, part.display_window))
        return own if lit is None else own.joined(lit)
    return lit or first_pixel(window)


def stacked_channels(
    part: ExrPart, names: tuple[str, ...]
) -> Float32[np.ndarray, "height width channels"]:
    """Channels side by side, where JAX can use them without a copy."""
    window = part.data_window
    pixels = aligned_empty((window.height, window.width, len(names)))
    for index, name in enumerate(names):
        pixels[..., index] = part.channels[name]
    return pixels


def _no_colour(image: ExrImage, layers: Sequence[str] | None) -> ImageError:
    names = ", ".join(name for part in image.parts for name in part.channels)
    wanted = "" if layers is None else f" in {', '.join(map(repr, layers))}"
    return ImageError(
        f"holds no R, G, B to render{wanted}",
        remedy=f"a layer needs all three, or Y; its channels are {names}",
    )
