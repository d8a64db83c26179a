"""A flat plate through the lens: its colour layers, blurred by its depth channel.

Every other channel, and Cryptomatte whatever its channels are called, keeps its bits:
ids and depths must not be mixed, so they still describe the *undistorted* plate.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float32

from lensfit.errors import ImageError
from lensfit.io.exr import ExrImage, ExrPart
from lensfit.io.exr_layers import with_channels
from lensfit.render.buffers import aligned_empty
from lensfit.render.frame import render_stages
from lensfit.render.look.stack import light_spreads
from lensfit.workflow.camera.plate_state import PlateState
from lensfit.workflow.frame.plate_in_depth import plate_in_depth
from lensfit.workflow.frame.plate_lens import PlateLens
from lensfit.workflow.frame.plate_notes import number_note
from lensfit.workflow.frame.signature import signed
from lensfit.workflow.plate.channels import ColourLayer, colour_layers, resized_channels


def render_flat(
    lens: PlateLens, image: ExrImage, path: Path, header: ExrImage | None = None
) -> ExrImage:
    """The finished frame of a flat plate of one view.

    Parameters
    ----------
    header : States its camera, if `image` itself does not.

    Raises
    ------
    ImageError : No part holds colour.
    """
    state = lens.noted_state(header or image, path)
    found = dict(
        (id(part), layers)
        for part, layers in layers_to_render(image, lens.options.layers)
    )
    return ExrImage(
        tuple(
            _rendered(lens, part, found.get(id(part), []), state, (image, path))
            for part in image.parts
        )
    )


def layers_to_render(
    image: ExrImage, wanted: Sequence[str] | None
) -> list[tuple[ExrPart, list[ColourLayer]]]:
    """Parts with colour and the layers of each that are rendered; at least one.

    Parameters
    ----------
    wanted : Only these layers; all if None.

    Raises
    ------
    ImageError : There is none.
    """
    found = [(part, colour_layers(part, wanted)) for part in image.parts]
    found = [(part, layers) for part, layers in found if layers]
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
    window = lens.options.written(source, display)
    result = resized_channels(part, window)
    if not layers:
        return result
    deep = plate_in_depth(lens, part, state, *plate)
    spreads = deep is not None or light_spreads(state.knobs.look)
    reach = lens.reach(window, source, display) if spreads else window
    stages = lens.stages_for(state, display, reach)
    lens.note_border(stages, window, source)
    for layer in layers:
        pixels = _stacked(part, layer.names)
        lens.notes.add(number_note(pixels, plate[1].name))
        in_front = None
        if deep is not None and deep.cut_out is not None:
            pixels, in_front = deep.cut_out.cut(pixels)
        rendered = render_stages(
            pixels,
            source,
            stages,
            window,
            method=lens.options.filter,
            depth_mm=deep and deep.depth_mm,
            mattes=deep and deep.mattes,
            in_front=in_front,
        )
        result = with_channels(result, layer.names, rendered)
    return signed(result, lens.signature(state))


def _stacked(
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
