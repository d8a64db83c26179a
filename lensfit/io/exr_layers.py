"""Colour channels of an OpenEXR part as one array, and back.

A layer is what stands before the last dot of a channel name: ``beauty.R`` is channel R
of layer ``beauty``, plain ``R`` belongs to the unnamed layer.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from lensfit.errors import ImageError
from lensfit.io.exr import ExrImage, ExrPart

_COLOURS = (("R", "G", "B"), ("r", "g", "b"), ("red", "green", "blue"))
_GREYS = ("Y", "y", "L", "V", "grey", "gray")
_NEVER_COLOUR = ("A", "a", "Z", "z")


def layer_names(part: ExrPart) -> list[str]:
    """The layers of a part, in the order of its channels; "" is the unnamed one."""
    return list(dict.fromkeys(_split(name)[0] for name in part.channels))


def colour_channels(part: ExrPart, layer: str = "") -> tuple[str, ...]:
    """Exact names of the colour channels of a layer.

    Returns
    -------
    Three names in the order red, green, blue; one name when the layer is grey; none
    when it holds no colour.
    """
    leaves = {_split(n)[1]: n for n in part.channels if _split(n)[0] == layer}
    for names in _COLOURS:
        if all(name in leaves for name in names):
            return tuple(leaves[name] for name in names)
    greys = [leaves[name] for name in _GREYS if name in leaves]
    if not greys and len(leaves) == 1 and not leaves.keys() & set(_NEVER_COLOUR):
        greys = list(leaves.values())
    return tuple(greys[:1])


def find_colour(image: ExrImage, layer: str = "") -> tuple[int, tuple[str, ...]]:
    """Index of the first part that holds colour in `layer`, and its channel names.

    Raises
    ------
    ImageError : No part does.
    """
    for index, part in enumerate(image.parts):
        if names := colour_channels(part, layer):
            return index, names
    available = ", ".join(n for part in image.parts for n in part.channels)
    raise ImageError(
        f"has no colour in {f'layer {layer!r}' if layer else 'its unnamed layer'}",
        remedy=f"its channels are {available or 'none'}",
    )


def stack_channels(
    part: ExrPart, names: tuple[str, ...]
) -> Float[np.ndarray, "height width channels"]:
    """The named channels as one float32 array over the data window."""
    return np.stack([part.channels[n].astype(np.float32) for n in names], -1)


def with_channels(
    part: ExrPart,
    names: tuple[str, ...],
    pixels: Float[np.ndarray, "height width channels"],
) -> ExrPart:
    """The part with the named channels replaced, each in the type it had before.

    Half channels are clipped to the largest half, so that no highlight turns infinite.
    All others are passed on untouched.
    """
    channels = dict(part.channels)
    for name, plane in zip(names, np.moveaxis(pixels, -1, 0), strict=True):
        dtype = channels[name].dtype if name in channels else np.dtype(np.float32)
        if dtype == np.float16:
            largest = np.finfo(np.float16).max
            plane = np.clip(plane, -largest, largest)
        channels[name] = plane.astype(dtype)
    return replace(part, channels=channels)


def _split(name: str) -> tuple[str, str]:
    layer, _, leaf = name.rpartition(".")
    return layer, leaf
