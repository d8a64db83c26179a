"""OpenEXR files as plain records: parts, named channels, windows, attributes.

Channels keep their exact names (``depth.Z``, ``CryptoObject00.r``) and their type
(half, float or unsigned integer), bit for bit. Windows are `lensfit.coords.Window`.
Attributes keep the types of the official Python binding (OpenEXR 3.5), measured: all
survive a round trip except ``double``, which the binding can only write as ``float``.
Tiled files are read at full resolution and written as scan lines. Deep pixels are
refused here; `lensfit.io.exr_deep` reads them.

The colours of a part are one array. A layer is what stands before the last dot of a
channel name: ``beauty.R`` is channel R of layer ``beauty``, plain ``R`` belongs to the
unnamed layer.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import OpenEXR
from jaxtyping import Float

from lensfit.atomic import atomic_path
from lensfit.coords import Window
from lensfit.errors import ImageError, OutputError
from lensfit.io.decoding import refuse_beyond_memory, silenced_libraries
from lensfit.io.exr_header import attributes_for_writing, check_exr

LOSSLESS = ("no", "rle", "zips", "zip", "piz")
"""Compressions that keep every sample; whatever else a file had is written as zip."""

# Fields of the record, or rebuilt by the library from what is written.
_NOT_ATTRIBUTES = {
    "channels",
    "chunkCount",
    "compression",
    "dataWindow",
    "displayWindow",
    "lineOrder",
    "name",
    "pixelAspectRatio",
    "tiles",
    "type",
    "version",
}


@dataclass(frozen=True, eq=False)
class ExrPart:
    """One image of an OpenEXR file.

    Attributes
    ----------
    channels : Exact channel name to samples (float16, float32 or uint32), each of the
        size of the data window.
    data_window : The pixels that are present; may exceed the display window (overscan).
    display_window : The frame; its first corner is the origin of the image.
    attributes : Every other header entry, in the binding's types.
    name : Name of the part; empty in most files of one part.
    pixel_aspect : Width of a pixel over its height when displayed.
    compression : "zip", "zips", "piz", "dwaa", ...
    unread : Names of the channels in the file, of a part read without them.
    """

    channels: Mapping[str, np.ndarray]
    data_window: Window
    display_window: Window
    attributes: Mapping[str, object] = field(default_factory=dict)
    name: str = ""
    pixel_aspect: float = 1.0
    compression: str = "zip"
    unread: tuple[str, ...] = ()

    @property
    def channel_names(self) -> tuple[str, ...]:
        """Of the channels, whether or not they were read."""
        return tuple(self.channels) or self.unread

    def __post_init__(self):
        size = (self.data_window.height, self.data_window.width)
        for name, samples in self.channels.items():
            if samples.shape != size:
                raise ValueError(
                    f"channel {name!r} is {samples.shape}, the data window {size}"
                )
            if samples.dtype not in (np.float16, np.float32, np.uint32):
                raise ValueError(f"channel {name!r} is {samples.dtype}")


@dataclass(frozen=True, eq=False)
class ExrImage:
    """The parts of an OpenEXR file, in its order; at least one."""

    parts: tuple[ExrPart, ...]

    def __post_init__(self):
        if not self.parts:
            raise ValueError("an OpenEXR image has at least one part")


def read_exr(
    path: str | Path, *, header_only: bool = False, working_bytes_per_px: int = 0
) -> ExrImage:
    """Read an OpenEXR file, all parts and channels.

    Parameters
    ----------
    path : The file.
    header_only : Leave the channels out (their mapping is empty).
    working_bytes_per_px : Memory that whoever reads it takes besides, for each pixel of
        the largest part.

    Raises
    ------
    ImageError : The file is missing, empty, truncated, corrupt, not OpenEXR, deep,
        chroma subsampled, claims more pixels than it can hold, or takes more memory
        than there is.
    """
    path = Path(path)
    headers = check_exr(path)
    if not header_only:
        largest_px = max(h.data_window.area for h in headers)
        decoded = sum(h.bytes_uncompressed for h in headers)
        refuse_beyond_memory(decoded + working_bytes_per_px * largest_px, path)
    try:
        with silenced_libraries():
            file = OpenEXR.File(
                str(path), separate_channels=True, header_only=header_only
            )
        parts = tuple(_part_from(part) for part in file.parts)
    except (RuntimeError, ValueError, TypeError, MemoryError, ArithmeticError) as error:
        raise unreadable(error, path) from error
    # The binding leaves parts out whose pixels it could not decode.
    if len(parts) != len(headers):
        raise ImageError(
            "is damaged: its pixels cannot be decoded",
            where=path,
            remedy="render or copy it again",
        )
    return ExrImage(parts)


def write_exr(
    path: str | Path, image: ExrImage, *, compression: str | None = None
) -> None:
    """Write an OpenEXR file, whole or not at all.

    Parameters
    ----------
    path : Destination.
    image : What to write; channels, windows and attributes are kept.
    compression : Of every part, by name; by default each part keeps its own when that
        is lossless, and is written as "zip" otherwise, so that no sample changes.

    Raises
    ------
    OutputError : The folder cannot be written, or an attribute cannot be stored.
    """
    with atomic_path(path) as temporary:
        parts = [
            _binding_part(part, i, len(image.parts), compression, Path(path))
            for i, part in enumerate(image.parts)
        ]
        try:
            OpenEXR.File(parts).write(str(temporary))
        except (RuntimeError, ValueError, TypeError, OSError) as error:
            raise OutputError(
                f"cannot be written ({error})", where=path, remedy="check the disk"
            ) from error


def unreadable(error: Exception, path: Path) -> ImageError:
    """What to say where the binding refuses a file, whose own words may mislead."""
    said, remedy = " ".join(str(error).split()), "render or copy it again"
    if isinstance(error, ZeroDivisionError):
        said = f"an attribute divides by zero: {said}"
    elif "Unable to open" in said or "missing attribute" in said:
        said = "an attribute of its header is missing or malformed"
    elif not _is_utf8(str(path)):
        said, remedy = "its name is not UTF-8", "rename it"
    return ImageError(f"cannot be read ({said})", where=path, remedy=remedy)


def _is_utf8(text: str) -> bool:
    """Python keeps other bytes of a file's name as what has no encoding."""
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


def part_without_channels(part: OpenEXR.Part) -> ExrPart:
    """The record of a part's header."""
    header = part.header
    return ExrPart(
        channels={},
        data_window=_window(header["dataWindow"]),
        display_window=_window(header["displayWindow"]),
        attributes={
            k: _plain(v) for k, v in header.items() if k not in _NOT_ATTRIBUTES
        },
        name=str(header.get("name", "")),
        pixel_aspect=float(header.get("pixelAspectRatio", 1.0)),
        compression=header["compression"].name.removesuffix("_COMPRESSION").lower(),
        unread=tuple(channel.name for channel in header.get("channels", ())),
    )


def _plain(value: object) -> object:
    """A ``double``, which the binding returns as an array of one number."""
    if isinstance(value, np.ndarray) and value.shape == (1,):
        return float(value[0])
    return value


def _part_from(part: OpenEXR.Part) -> ExrPart:
    channels = part.channels or {}
    pixels = {name: channel.pixels for name, channel in channels.items()}
    return replace(part_without_channels(part), channels=pixels, unread=())


def _window(corners: tuple[np.ndarray, np.ndarray]) -> Window:
    (x_min, y_min), (x_max, y_max) = corners
    return Window(int(x_min), int(y_min), int(x_max), int(y_max))


def window_corners(window: Window) -> tuple[np.ndarray, np.ndarray]:
    """A window as the binding takes it."""
    corners = np.asarray(window, np.int32)
    return corners[:2], corners[2:]


def _binding_part(
    part: ExrPart, index: int, count: int, compression: str | None, path: Path
) -> OpenEXR.Part:
    kept = part.compression if part.compression in LOSSLESS else "zip"
    header = {
        **attributes_for_writing(part.attributes, path),
        "type": OpenEXR.scanlineimage,
        "compression": _compression(compression or kept),
        "dataWindow": window_corners(part.data_window),
        "displayWindow": window_corners(part.display_window),
        "pixelAspectRatio": float(part.pixel_aspect),
    }
    channels = {n: np.ascontiguousarray(s) for n, s in part.channels.items()}
    name = part.name or (f"part{index}" if count > 1 else "")
    return OpenEXR.Part(header, channels, name)


def _compression(name: str) -> OpenEXR.Compression:
    try:
        return getattr(OpenEXR, f"{name.upper()}_COMPRESSION")
    except AttributeError:
        raise ValueError(f"unknown OpenEXR compression {name!r}") from None


_COLOURS = (("R", "G", "B"), ("r", "g", "b"), ("red", "green", "blue"))
_GREYS = ("Y", "y", "L", "V", "grey", "gray")
_NEVER_COLOUR = ("A", "a", "Z", "z")


def layer_names(part: ExrPart) -> list[str]:
    """The layers of a part, in the order of its channels; "" is the unnamed one."""
    return list(dict.fromkeys(_layer_and_leaf(name)[0] for name in part.channels))


def colour_channels(part: ExrPart, layer: str = "") -> tuple[str, ...]:
    """Exact names of the colour channels of a layer.

    Returns
    -------
    Three names in the order red, green, blue; one name when the layer is grey; none
    when it holds no colour.
    """
    leaves = _leaves(part, layer)
    for names in _COLOURS:
        if all(name in leaves for name in names):
            return tuple(leaves[name] for name in names)
    if is_vector(part, layer):  # whose y is no light
        return ()
    greys = [leaves[name] for name in _GREYS if name in leaves]
    if not greys and len(leaves) == 1 and not leaves.keys() & set(_NEVER_COLOUR):
        greys = list(leaves.values())
    return tuple(greys[:1])


def is_vector(part: ExrPart, layer: str) -> bool:
    """Whether a layer holds positions, normals or motion: its z is no depth, nor is its
    y light."""
    return {"x", "y"} <= {leaf.lower() for leaf in _leaves(part, layer)}


def _leaves(part: ExrPart, layer: str) -> dict[str, str]:
    """Exact names of the channels of a layer, by what follows its name."""
    split = {name: _layer_and_leaf(name) for name in part.channel_names}
    return {leaf: name for name, (own, leaf) in split.items() if own == layer}


def find_colour(image: ExrImage) -> tuple[int, tuple[str, ...]]:
    """Index of the first part that holds colour in its unnamed layer, and its channels.

    Raises
    ------
    ImageError : No part does.
    """
    for index, part in enumerate(image.parts):
        if names := colour_channels(part):
            return index, names
    available = ", ".join(n for part in image.parts for n in part.channels)
    raise ImageError(
        "has no colour in its unnamed layer",
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


def _layer_and_leaf(name: str) -> tuple[str, str]:
    layer, _, leaf = name.rpartition(".")
    return layer, leaf
