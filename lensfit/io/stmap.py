"""UV maps (STMaps) in OpenEXR: where in the source each output pixel looks.

A value is an absolute position in the source, normalised by its *display window*, with
(0, 0) at the lower left corner of the frame and (1, 1) at the upper right; the centre
of pixel (column, row from the bottom) is ((column + 0.5)/W, (row + 0.5)/H). Overscan is
a data window larger than the display window, with values below 0 and above 1. This is
the reading of Nuke's STMap (LDPK source, openfx-misc), Natron and Flame's "Data &
Display Windows". Float32 only: half costs up to half a pixel at 2K, measured.

Channels are R = u, G = v and B = 0: the nodes take the first two of a layer, B keeps
the file a picture for readers that know RGB only, and there is no alpha because Nuke
and Natron may divide by it. Where no source position exists the map is NaN in memory.
On disk it is (-1, -1), which lies outside any source and gives black, while a NaN would
spread through the compositor's filter; the attribute ``lensfit/undefinedUV`` says so.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32

from lensfit.coords import Window
from lensfit.errors import ImageError
from lensfit.io.exr import ExrImage, ExrPart, read_exr, write_exr

UNDEFINED_UV = -1.0
"""Both values of a pixel without a source position, on disk."""

_UNDEFINED_KEY = "lensfit/undefinedUV"
_CHANNEL_LAYER = "stmap_{}"
_UV_NAMES = (("R", "G"), ("r", "g"), ("u", "v"), ("U", "V"), ("red", "green"))


@dataclass(frozen=True, eq=False)
class Stmap:
    """A UV map as read from a file.

    Attributes
    ----------
    uv : (u, v) of every pixel of the data window, row 0 on top; NaN where undefined.
    display_window, data_window : Of the file.
    channel_uv : Maps of single colour channels, by "r", "g", "b"; empty when the file
        holds one map for all.
    attributes : Header entries of the file.
    """

    uv: Float32[np.ndarray, "height width 2"]
    display_window: Window
    data_window: Window
    channel_uv: Mapping[str, Float32[np.ndarray, "height width 2"]] = field(
        default_factory=dict
    )
    attributes: Mapping[str, object] = field(default_factory=dict)


def write_stmap(
    path: str | Path,
    uv: Float[np.ndarray, "height width 2"],
    display_window: Window,
    data_window: Window | None = None,
    attributes: Mapping[str, object] | None = None,
    pixel_aspect: float = 1.0,
) -> None:
    """Write one UV map for all colour channels.

    Parameters
    ----------
    path : Destination, an EXR file.
    uv : Positions, row 0 on top, over the data window; NaN where undefined.
    display_window : The frame that values are normalised by.
    data_window : The pixels of `uv`; the display window if None.
    attributes : Header entries to add.
    pixel_aspect : Width of a pixel over its height when displayed, as of the plates.

    Raises
    ------
    ImageError : `uv` is half float.
    OutputError : The file cannot be written.
    """
    channels = _channels(path, "", uv)
    _write(path, channels, display_window, data_window, attributes, pixel_aspect)


def write_channel_stmaps(
    path: str | Path,
    channel_uv: Mapping[str, Float[np.ndarray, "height width 2"]],
    display_window: Window,
    data_window: Window | None = None,
    attributes: Mapping[str, object] | None = None,
    pixel_aspect: float = 1.0,
) -> None:
    """Write one UV map per colour channel, for lateral colour, in one file.

    The unnamed layer holds the green map, so that a compositor that looks no further
    gets the reference channel; layers ``stmap_r``, ``stmap_g`` and ``stmap_b`` hold
    the three.

    Parameters
    ----------
    channel_uv : Maps by "r", "g", "b", as `uv` of `write_stmap`, like the rest.

    Raises
    ------
    ImageError : A map is half float.
    OutputError : The file cannot be written.
    """
    if set(channel_uv) != {"r", "g", "b"}:
        raise ValueError(f"channels are r, g and b, not {', '.join(channel_uv)}")
    channels = _channels(path, "", channel_uv["g"])
    for channel, uv in channel_uv.items():
        channels |= _channels(path, _CHANNEL_LAYER.format(channel), uv)
    _write(path, channels, display_window, data_window, attributes, pixel_aspect)


def read_stmap(path: str | Path) -> Stmap:
    """Read a UV map, lensfit's or another program's.

    Raises
    ------
    ImageError : Not an EXR file, no UV map in it, or values in half float.
    """
    part = read_exr(path).parts[0]
    mark = part.attributes.get(_UNDEFINED_KEY)
    layers = {c: _CHANNEL_LAYER.format(c) for c in "rgb"}
    found = {c: name for c, name in layers.items() if f"{name}.R" in part.channels}
    return Stmap(
        uv=_uv_from(part, "", mark, path),
        display_window=part.display_window,
        data_window=part.data_window,
        channel_uv={c: _uv_from(part, name, mark, path) for c, name in found.items()},
        attributes=part.attributes,
    )


def _channels(
    path: str | Path, layer: str, uv: Float[np.ndarray, "height width 2"]
) -> dict[str, np.ndarray]:
    if uv.dtype == np.float16:
        raise _half(path)
    planes = uv[..., 0], uv[..., 1]
    defined = np.isfinite(planes[0]) & np.isfinite(planes[1])
    u, v = (
        np.where(defined, plane, UNDEFINED_UV).astype(np.float32) for plane in planes
    )
    prefix = f"{layer}." if layer else ""
    return {f"{prefix}R": u, f"{prefix}G": v, f"{prefix}B": np.zeros_like(u)}


def _write(
    path: str | Path,
    channels: Mapping[str, np.ndarray],
    display_window: Window,
    data_window: Window | None,
    attributes: Mapping[str, object] | None,
    pixel_aspect: float,
) -> None:
    header = {**(attributes or {}), _UNDEFINED_KEY: UNDEFINED_UV}
    window = data_window or display_window
    part = ExrPart(channels, window, display_window, header, pixel_aspect=pixel_aspect)
    write_exr(path, ExrImage((part,)), compression="zip")


def _uv_from(
    part: ExrPart, layer: str, mark: object, path: str | Path
) -> Float32[np.ndarray, "height width 2"]:
    prefix = f"{layer}." if layer else ""
    pairs = [tuple(f"{prefix}{name}" for name in pair) for pair in _UV_NAMES]
    pair = next((p for p in pairs if set(p) <= set(part.channels)), None)
    if pair is None:
        raise ImageError(
            f"holds no UV map in {f'layer {layer!r}' if layer else 'its main layer'}",
            where=path,
            remedy=f"its channels are {', '.join(part.channels) or 'none'}",
        )
    u, v = (part.channels[name] for name in pair)
    if u.dtype != np.float32 or v.dtype != np.float32:
        raise _half(path)
    uv = np.stack([u, v], -1)
    if isinstance(mark, float):
        uv[(uv == np.float32(mark)).all(-1)] = np.nan
    return uv


def _half(path: str | Path) -> ImageError:
    return ImageError(
        "is a UV map in less than 32-bit float, which moves pixels by up to half",
        where=path,
        remedy="write it as 32-bit float",
    )
