"""Whether a plate has what the options name, told by its header alone.

A finished frame is not rendered again, and yet an option that no rendering could follow
is refused there too: a job that is run twice fails, or ends well, both times alike.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from lensfit.coords import Window
from lensfit.errors import ImageError
from lensfit.io.exr import ExrImage, ExrPart, read_exr
from lensfit.io.exr_header import check_exr
from lensfit.workflow.apply_options import ApplyOptions
from lensfit.workflow.frame.flat_plate import layers_to_render
from lensfit.workflow.plate.depth import meant_depth
from lensfit.workflow.plate.mattes import cryptomatte_with, matte_channel

_TYPES = (np.uint32, np.float16, np.float32)
"""Of samples, by the code of the file."""


def check_options(options: ApplyOptions, image: ExrImage, path: Path) -> None:
    """Refuse options that name what a flat plate does not have.

    Parameters
    ----------
    image : The plate, at least its header.

    Raises
    ------
    ImageError : A layer, a channel or an object is not there, or the depth is not what
        the options say.
    """
    if options.output in ("aberration-dots", "filter"):
        return  # of these the plate says only which camera took it
    outline = _outline(image, path)
    if options.output == "result":
        coloured = [p for p, _ in layers_to_render(outline, options.layers)]
    else:
        coloured = list(outline.parts[:1])
    for part in coloured if options.switches.defocus else ():
        if meant_depth(outline, part, options.depth) is None:
            continue
        if options.edge_matte is not None:
            matte_channel(outline, path, part, options.edge_matte)
        elif options.edge_mask:
            _check_objects(options.edge_mask, outline, part.data_window, path)


def _check_objects(
    names: Sequence[str], outline: ExrImage, window: Window, path: Path
) -> None:
    """Objects by the manifest, or else by the ids in the pixels."""
    try:
        cryptomatte_with(outline, path, window, names)
    except ImageError:
        cryptomatte_with(read_exr(path), path, window, names)


def _outline(image: ExrImage, path: Path) -> ExrImage:
    """The plate with all its channels, each black and of no size in memory."""
    return ExrImage(
        tuple(
            _black(part, {name: code for name, (code, _, _) in header.channels.items()})
            for part, header in zip(image.parts, check_exr(path), strict=True)
        )
    )


def _black(part: ExrPart, types: dict[str, int]) -> ExrPart:
    shape = part.data_window.height, part.data_window.width
    channels = {
        name: np.broadcast_to(np.zeros((), _TYPES[code]), shape)
        for name, code in types.items()
    }
    return replace(part, channels=channels)
