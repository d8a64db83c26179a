"""Deep OpenEXR pictures: several samples in a pixel, each with its own distance.

Samples are kept as flat arrays, pixel after pixel and row after row, in the order of
the file. Colour is premultiplied; a sample covers what lies behind it by its alpha.
``Z`` is the front of a sample and ``ZBack``, where there is one, its back.
Source: OpenEXR, "Interpreting Deep Pixels".
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenEXR
from jaxtyping import Int

from lensfit.atomic import atomic_path
from lensfit.coords import Window
from lensfit.errors import ImageError, OutputError
from lensfit.io.decoding import refuse_beyond_memory, silenced_libraries
from lensfit.io.exr import ExrPart, part_without_channels, unreadable, window_corners
from lensfit.io.exr_header import PartHeader, attributes_for_writing, check_exr

_REFERENCE_BYTES = 8


@dataclass(frozen=True, eq=False)
class DeepPart:
    """One deep image of a file.

    Attributes
    ----------
    flat : Windows, attributes and name; no channels.
    counts : Samples of each pixel.
    samples : Channel name to the samples of all pixels.
    """

    flat: ExrPart
    counts: Int[np.ndarray, "height width"]
    samples: Mapping[str, np.ndarray]

    @property
    def data_window(self) -> Window:
        return self.flat.data_window


def is_deep(path: str | Path) -> bool:
    """Whether a file holds deep pixels.

    Raises
    ------
    ImageError : It is no whole OpenEXR file.
    """
    return any(header.deep for header in check_exr(path, deep=True))


def read_deep(path: str | Path) -> DeepPart:
    """The first deep part of a file.

    Raises
    ------
    ImageError : There is none, it is damaged, or takes more memory than there is.
    """
    path = Path(path)
    headers = check_exr(path, deep=True)
    refuse_beyond_memory(sum(_least_bytes(header) for header in headers), path)
    try:
        with silenced_libraries():
            file = OpenEXR.File(str(path), separate_channels=True)
        deep = (OpenEXR.deepscanline, OpenEXR.deeptile)
        parts = [p for p in file.parts if p.header.get("type") in deep and p.channels]
        if not parts:
            raise ImageError("holds no deep pixels that can be read", where=path)
        _refuse_views(parts, path)
        part = parts[0]
        channels = {name: channel.pixels for name, channel in part.channels.items()}
    except (RuntimeError, ValueError, TypeError, MemoryError, ArithmeticError) as error:
        raise unreadable(error, path) from error
    counts = _counts(next(iter(channels.values())))
    samples = {name: _flat(pixels) for name, pixels in channels.items()}
    if any(len(flat) != counts.sum() for flat in samples.values()):
        raise ImageError(
            "is damaged: its channels hold different numbers of samples",
            where=path,
            remedy="render or copy it again",
        )
    return DeepPart(part_without_channels(part), counts, samples)


def _least_bytes(header: PartHeader) -> int:
    """Of a deep part, whose header does not hold the number of its samples: what the
    binding takes for a pixel, even if that has none."""
    return header.data_window.area * _REFERENCE_BYTES * (1 + len(header.channels))


def _refuse_views(parts: list[OpenEXR.Part], path: Path) -> None:
    """A deep picture of several views has one depth for each."""
    headers = [part.header for part in parts]
    names = {header["view"] for header in headers if "view" in header}
    listed = max((len(header.get("multiView", [])) for header in headers), default=0)
    if max(len(names), listed) > 1:
        raise ImageError(
            "holds deep pixels of several views",
            where=path,
            remedy="render each view to a file of its own",
        )


def _counts(pixels: np.ndarray) -> np.ndarray:
    sizes = [0 if p is None else len(p) for p in pixels.ravel()]
    return np.array(sizes, np.int64).reshape(pixels.shape)


def _flat(pixels: np.ndarray) -> np.ndarray:
    filled = [p for p in pixels.ravel() if p is not None and len(p)]
    return np.concatenate(filled) if filled else np.zeros(0, np.float32)


def write_deep(path: str | Path, part: DeepPart) -> None:
    """Write one deep image by scan lines, whole or not at all.

    Raises
    ------
    OutputError : The folder cannot be written, or an attribute cannot be stored.
    """
    window = part.flat.data_window
    shown = part.flat.display_window
    header = {
        **attributes_for_writing(part.flat.attributes, Path(path)),
        "type": OpenEXR.deepscanline,
        "compression": OpenEXR.ZIPS_COMPRESSION,
        "dataWindow": window_corners(window),
        "displayWindow": window_corners(shown),
        "pixelAspectRatio": float(part.flat.pixel_aspect),
    }
    channels = {n: _pixels(part.counts, s) for n, s in part.samples.items()}
    with atomic_path(path) as temporary:
        try:
            OpenEXR.File(header, channels).write(str(temporary))
        except (RuntimeError, ValueError, TypeError, OSError) as error:
            raise OutputError(
                f"cannot be written ({error})", where=path, remedy="check the disk"
            ) from error


def _pixels(counts: Int[np.ndarray, "height width"], samples: np.ndarray) -> np.ndarray:
    """Samples of each pixel in an array of their own, None where there is none."""
    pixels = np.empty(counts.size, object)
    end = 0
    for index in np.flatnonzero(counts):
        start, end = end, end + int(counts.flat[index])
        pixels[index] = samples[start:end].copy()
    return pixels.reshape(counts.shape)
