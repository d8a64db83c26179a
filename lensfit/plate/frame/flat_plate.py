"""Render a flat plate: its colour layers, blurred by its depth channel.

Every other channel, and Cryptomatte whatever its channels are called, keeps its bits:
ids and depths must not be mixed, so they still describe the *undistorted* plate.

With depth of field a plate has distances, the objects that share its pixels, and those
that are separated from it.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32

from lensfit.coords import Window
from lensfit.errors import ImageError
from lensfit.io.depth_channel import find_depth
from lensfit.io.exr import ExrImage, ExrPart, with_channels
from lensfit.plate.camera.plate_state import PlateState
from lensfit.plate.cut_out import CutOut
from lensfit.plate.frame.plate_lens import PlateLens
from lensfit.plate.frame.plate_notes import (
    alpha_note,
    layer_depth_notes,
    number_note,
)
from lensfit.plate.frame.tight_window import (
    EmptyRing,
    first_pixel,
    is_tight,
    known_window,
)
from lensfit.plate.plate_depth import plate_depth
from lensfit.plate.plate_file import ColourLayer, colour_layers, resized_channels
from lensfit.plate.plate_mattes import matte_cut_out, named_cut_out, plate_mattes
from lensfit.preset.scaled_look import UNSCALED
from lensfit.rendering.buffers import aligned_empty, crop
from lensfit.rendering.frame import render_stages
from lensfit.rendering.layer_stack import Mattes
from lensfit.rendering.look.stack import light_spreads
from lensfit.rendering.render_stages import Stages


class PlateInDepth(NamedTuple):
    """What is known over the data window of a part with colours.

    Attributes
    ----------
    depth_mm, mattes : Of the plate; without what is cut out of it, if anything is.
    cut_out : The objects of the edge mask.
    """

    depth_mm: Float32[np.ndarray, "height width"]
    mattes: Mattes | None
    cut_out: CutOut | None = None

    @property
    def seen_depth_mm(self) -> Float32[np.ndarray, "height width"]:
        """Of the nearest thing in each pixel."""
        return self.depth_mm if self.cut_out is None else self.cut_out.seen_depth_mm


def plate_in_depth(
    lens: PlateLens, part: ExrPart, state: PlateState, image: ExrImage, path: Path
) -> PlateInDepth | None:
    """The depth of a part with colours; None where depth of field is not wanted.

    Raises
    ------
    ImageError : The plate has no depth, its f-number or focus distance is not known, or
        the edge mask names an object or a channel that the plate does not have.
    """
    if not lens.options.switches.defocus:
        return None
    geometry = lens.geometry(state, part.display_window)
    focal_length_mm = lens.cg_focal_length_mm(state)
    found = plate_depth(image, part, lens.options.depth, geometry, focal_length_mm)
    lens.notes.add(*found.notes)
    state.require_blur()
    depth, unit_mm = found.depth_mm, found.unit_mm
    if state.scaled != UNSCALED:
        depth = depth / np.float32(state.scaled.distances)
        unit_mm /= state.scaled.distances
    lens.note_focus(depth, unit_mm, state, part.display_window, path)
    depth = lens.within_reach(depth, state)
    window, options = part.data_window, lens.options
    if options.edge_matte is not None:
        cut = matte_cut_out(depth, image, path, part, options.edge_matte)
        # The plate's Cryptomatte may hold its objects too, and nobody takes them out.
        return PlateInDepth(cut.rest_depth_mm, None, cut)
    if not options.edge_mask:
        return PlateInDepth(depth, plate_mattes(image, path, window))
    cut = named_cut_out(depth, image, path, window, options.edge_mask)
    return PlateInDepth(cut.rest_depth_mm, cut.rest_mattes, cut)


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
            _rendered_part(lens, part, found.get(id(part), []), state, (image, path))
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


def _rendered_part(
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
    return lens.with_signed_header(result, state)


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
    if deep is not None and pixels.shape[-1] == 4:
        alpha = pixels[..., 3]
        lens.notes.add(alpha_note(alpha, name))
        # Rays divide the light that they read by what covers them: 2 would halve it.
        np.minimum(alpha, 1.0, out=alpha)
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
