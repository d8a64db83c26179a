"""The file of a plate: its header, its colour channels, the others over a new window.

A layer is colour when it has red, green and blue, or the grey channel Y. Cryptomatte
is not, although its channels are called r, g, b and a: its values are ids and
coverages of ranks (Cryptomatte specification 1.2.0).

A deep plate's header is read as if it were flat.
"""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from lensfit.coords import Window, pixels_over_window
from lensfit.io.exr import ExrImage, ExrPart, colour_channels, layer_names, read_exr
from lensfit.io.exr_deep import is_deep, read_deep


def plate_header(path: Path) -> ExrImage:
    """A plate without its pixels; a deep one as if it were flat."""
    if is_deep(path):
        return ExrImage((read_deep(path).flat,))
    return read_exr(path, header_only=True)


def header_entries(image: ExrImage) -> dict[str, object]:
    """The attributes of all parts; where two differ the first part's count."""
    return {k: v for p in reversed(image.parts) for k, v in p.attributes.items()}


_CRYPTOMATTE_NAME = re.compile(r"(?:.*/)?cryptomatte/[^/]+/name")
_ALPHA = ("A", "a", "alpha")
_GREY = ("Y", "y")


class ColourLayer(NamedTuple):
    """A layer to render: exact channel names, red green blue (alpha), or one grey."""

    layer: str
    names: tuple[str, ...]


def colour_layers(
    part: ExrPart, wanted: Sequence[str] | None = None
) -> list[ColourLayer]:
    """The colour layers of a part.

    Parameters
    ----------
    wanted : Only these layers ("" is the unnamed one); all if None.
    """
    found = []
    for layer in layer_names(part):
        if (wanted is not None and layer not in wanted) or is_cryptomatte(part, layer):
            continue
        names = colour_channels(part, layer)
        grey = len(names) == 1 and names[0].rpartition(".")[2] in _GREY
        if len(names) != 3 and not grey:
            continue
        if any(part.channels[name].dtype == np.uint32 for name in names):
            continue
        prefix = f"{layer}." if layer else ""
        alpha = [f"{prefix}{a}" for a in _ALPHA if f"{prefix}{a}" in part.channels]
        found.append(ColourLayer(layer, names if grey else (*names, *alpha[:1])))
    return found


def is_cryptomatte(part: ExrPart, layer: str) -> bool:
    """Whether a layer is of a Cryptomatte that the header declares, preview included.

    In a part named after the Cryptomatte the layer may be without a name.
    """
    declared = [
        str(value)
        for key, value in part.attributes.items()
        if _CRYPTOMATTE_NAME.fullmatch(key)
    ]
    names = (layer, f"{part.name}.{layer}".rstrip("."), part.name if not layer else "")
    return any(
        re.fullmatch(rf"(?:.*\.)?{re.escape(name)}\d*", own)
        for name in declared
        for own in names
    )


def resized_channels(part: ExrPart, window: Window) -> ExrPart:
    """The part over another window: bits are copied, what lies outside it is zero.

    The standard attribute ``originalDataWindow`` remembers the window it had.
    """
    old = part.data_window
    if window == old:
        return part
    channels = {
        name: pixels_over_window(samples, old, window)
        for name, samples in part.channels.items()
    }
    corners = np.asarray(old, np.int32)
    attributes = {
        "originalDataWindow": (corners[:2], corners[2:]),
        **part.attributes,
    }
    return replace(part, channels=channels, data_window=window, attributes=attributes)
