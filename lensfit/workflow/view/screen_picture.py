"""Pictures and plates as the screen shows them: exposure, view transform, 8 bits, PNG.

They are in sRGB, or as a view transform of OpenColorIO makes them. The sRGB code of
every half float is known beforehand, so that a picture is looked up rather than
computed; half floats resolve light eight times finer than 8 bits do.

A config of OpenColorIO is that of ``$OCIO``, or one of those that OpenColorIO brings
along, by its ``ocio://`` name; a page names one of these and no file. Where OpenColorIO
is not installed there are none, and pictures are shown in sRGB.

In a smaller plate (a proxy) blocks of pixels become one: colours are averaged, and of
everything that may not be mixed (depth, ids) the middle sample is taken. Blocks are
counted from the corner of the display window; incomplete blocks at its right and lower
border are left out, so that the frame may lose a part of a proxy's pixel there.
"""

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import cv2
import numpy as np
from jaxtyping import Float32, UInt8
from msgspec import Meta, Struct

from lensfit.coords import Window, pixels_over_window
from lensfit.errors import ImageError, LensfitError, SettingsError
from lensfit.io.exr import ExrImage, ExrPart, read_exr
from lensfit.io.exr_deep import is_deep
from lensfit.io.transfer import encode
from lensfit.plate.apply_options import ApplyOptions
from lensfit.plate.camera.settings import file_stamp
from lensfit.plate.plate_file import ColourLayer, colour_layers, plate_views

ENVIRONMENT = "$OCIO"
SCENE_LINEAR = "scene_linear"
"""Role of the colour space that plates are taken to be in."""
_BUILT_IN = "ocio://"
_MOST_LIGHT = 65504.0
"""The largest half float: infinite light has no colour."""
_Name = Annotated[str, Meta(min_length=1, max_length=200)]


class ViewTransform(Struct, frozen=True, forbid_unknown_fields=True):
    """A display and a view of a config.

    Attributes
    ----------
    config : ``$OCIO``, or the ``ocio://`` name of one that OpenColorIO brings along.
    display : The config's default if None.
    view : The display's default if None.
    space : Colour space of the plate, by its name or role.
    """

    config: _Name
    display: _Name | None = None
    view: _Name | None = None
    space: _Name = SCENE_LINEAR


def config_names() -> list[str]:
    """Configs that a page may choose: that of ``$OCIO`` first, if it is set, then those
    that OpenColorIO brings along and recommends; none where it is not installed."""
    ocio = _opencolorio()
    if ocio is None:
        return []
    known = [*ocio.BuiltinConfigRegistry().getBuiltinConfigs()]
    ordered = sorted(reversed(known), key=lambda one: not one[2])
    own = [ENVIRONMENT] if os.environ.get("OCIO") else []
    return own + [_BUILT_IN + one[0] for one in ordered]


def config_choices(name: str) -> dict[str, Any]:
    """What a config offers: displays with their views and linear colour spaces, each
    with the default first.

    Raises
    ------
    SettingsError : There is no such config, or it cannot be read.
    LensfitError : OpenColorIO is not installed.
    """
    config = _config(name)
    with _as_sentences(name):
        displays = {
            display: _first([*config.getViews(display)], config.getDefaultView(display))
            for display in _first([*config.getDisplays()], config.getDefaultDisplay())
        }
        linear = [
            one.getName()
            for one in config.getColorSpaces()
            if one.getEncoding() == "scene-linear"
        ]
        working = config.getColorSpace(SCENE_LINEAR)
    spaces = linear if working is None else _first(linear, working.getName())
    return {"displays": displays, "spaces": spaces}


def view_codes(
    light: Float32[np.ndarray, "height width 3"], wanted: ViewTransform
) -> UInt8[np.ndarray, "height width 3"]:
    """Linear light as the display of a config shows it, in 8 bits.

    Raises
    ------
    SettingsError : The config cannot be read, or has no such display, view or space.
    LensfitError : OpenColorIO is not installed.
    """
    config = _config(wanted.config)
    shown = np.nan_to_num(light, nan=0.0, posinf=_MOST_LIGHT, neginf=-_MOST_LIGHT)
    shown = np.clip(shown, -_MOST_LIGHT, _MOST_LIGHT).astype(np.float32)
    _processor(config, wanted).applyRGB(shown)  # in place
    shown = np.clip(np.nan_to_num(shown), 0, 1)
    return np.round(shown * 255).astype(np.uint8)


@lru_cache(maxsize=8)
def _processor(config: Any, wanted: ViewTransform) -> Any:
    display = wanted.display or config.getDefaultDisplay()
    view = wanted.view or config.getDefaultView(display)
    forward = _required_opencolorio().TransformDirection.TRANSFORM_DIR_FORWARD
    with _as_sentences(wanted.config):
        found = config.getProcessor(wanted.space, display, view, forward)
        return found.getDefaultCPUProcessor()


def _config(name: str) -> Any:
    _required_opencolorio()
    if name not in config_names():
        raise SettingsError(
            f"there is no OpenColorIO config {name!r} here",
            remedy="set $OCIO to yours, or choose one that OpenColorIO brings along",
        )
    path = os.environ["OCIO"] if name == ENVIRONMENT else name
    return _loaded_config(path, file_stamp(Path(path)))


@lru_cache(maxsize=4)
def _loaded_config(path: str, stamp: tuple[int, int] | None) -> Any:
    del stamp  # part of the key alone: an edited file has another
    with _as_sentences(path):
        return _required_opencolorio().Config.CreateFromFile(path)


@contextmanager
def _as_sentences(config: str) -> Iterator[None]:
    """What OpenColorIO cannot do with a config, as an error that names it."""
    ocio = _required_opencolorio()
    # A missing file is no kind of the first; names may be no text.
    known = ocio.Exception, ocio.ExceptionMissingFile, UnicodeError
    try:
        yield
    except known as error:
        raise SettingsError(
            f"OpenColorIO cannot use this ({error})",
            where=config,
            remedy="choose another config, display, view or space",
        ) from error


def _required_opencolorio() -> Any:
    found = _opencolorio()
    if found is None:
        raise LensfitError(
            "OpenColorIO is not installed", remedy="pip install 'lensfit[view]'"
        )
    return found


@lru_cache(maxsize=1)
def _opencolorio() -> Any:
    """The module, which takes a while to import; None where there is none."""
    try:
        return import_module("PyOpenColorIO")
    except ImportError:
        return None


def _first(names: list[str], default: str) -> list[str]:
    """The same with the default in front."""
    return sorted(names, key=lambda name: name != default)


_QUICK = [cv2.IMWRITE_PNG_COMPRESSION, 1]


def first_layer(image: ExrImage, wanted: tuple[str, ...] | None) -> str | None:
    """Name of the layer that is shown; None if the plate has no colours."""
    for part in image.parts:
        for layer in colour_layers(part, wanted):
            return layer.layer
    return None


def frame_pixels(image: ExrImage, layer: str) -> Float32[np.ndarray, "height width 3"]:
    """A colour layer over the display window; black where the picture has no pixel."""
    part, found = _part_with(image, layer)
    names = found.names[:3] if len(found.names) >= 3 else found.names[:1] * 3
    planes = [
        pixels_over_window(part.channels[name], part.data_window, part.display_window)
        for name in names
    ]
    return np.stack(planes, axis=-1).astype(np.float32)


def screen_png(
    pixels: Float32[np.ndarray, "height width 3"],
    exposure_stops: float = 0.0,
    view: ViewTransform | None = None,
) -> bytes:
    """The picture as PNG, brighter by some stops.

    Parameters
    ----------
    view : How light is shown; in sRGB if None.

    Raises
    ------
    LensfitError : There is no such view transform here.
    """
    if view is None:
        codes = _srgb_codes(pixels, exposure_stops)
    else:
        with np.errstate(over="ignore", invalid="ignore"):
            codes = view_codes(pixels * np.float32(2.0**exposure_stops), view)
    _, buffer = cv2.imencode(".png", codes[..., ::-1], _QUICK)
    return buffer.tobytes()


def _srgb_codes(
    pixels: Float32[np.ndarray, "height width 3"], exposure_stops: float
) -> UInt8[np.ndarray, "height width 3"]:
    with np.errstate(over="ignore", invalid="ignore"):
        halves = pixels.astype(np.float16).view(np.uint16)
    return _codes(float(exposure_stops))[halves]


@lru_cache(maxsize=32)
def _codes(exposure_stops: float) -> UInt8[np.ndarray, " halves"]:
    halves = np.arange(1 << 16, dtype=np.uint32).astype(np.uint16).view(np.float16)
    light = np.nan_to_num(halves.astype(float), nan=0.0, posinf=1e9, neginf=0.0)
    light = np.clip(light * 2.0**exposure_stops, 0.0, 1.0)
    return np.round(np.clip(encode(light, "srgb"), 0, 1) * 255).astype(np.uint8)


def _part_with(image: ExrImage, layer: str) -> tuple[ExrPart, ColourLayer]:
    return next(
        (part, found) for part in image.parts for found in colour_layers(part, [layer])
    )


Quality = Literal["proxy", "finer", "full"]
"""In the order of their pixels."""
MOST_PIXELS, MOST_PIXELS_OF_RAYS = 140_000, 60_000
"""Of an ideal lens, and of one whose blur is made of rays, which costs six times as
much a pixel."""
_FINER = 4
"""Times as many pixels along a side as a proxy's: some ten times its seconds."""
_MOST_FACTOR = 16


class Plate(NamedTuple):
    """One frame that was read.

    Attributes
    ----------
    image, header : Its first view, and what states its camera.
    smaller : The same with fewer pixels, by quality; none where it is small itself.
    layer : The colours that are shown.
    """

    path: Path
    image: ExrImage
    header: ExrImage
    smaller: Mapping[Quality, ExrImage]
    layer: str

    @property
    def qualities(self) -> tuple[Quality, ...]:
        """In which it can be shown, the quickest first."""
        return (*self.smaller, "full")


def read_plate(
    path: Path, options: ApplyOptions, most_pixels: int = MOST_PIXELS
) -> Plate:
    """A frame with what is shown of it.

    Parameters
    ----------
    most_pixels : Of its proxy.

    Raises
    ------
    ImageError : It cannot be read, is deep, or has no colours.
    """
    if is_deep(path):
        raise ImageError(
            "is a deep plate, which the view does not show",
            where=path,
            remedy='render it with "lensfit apply", or view a flat one',
        )
    view = plate_views(read_exr(path), path)[0]
    image = view.view.image
    wanted = None if options.layers is None else tuple(options.layers)
    layer = first_layer(image, wanted)
    if layer is None:
        raise ImageError(
            "holds no R, G, B to render", where=path, remedy="give a colour plate"
        )
    # A map from outside has the size of the plate.
    smaller = {} if options.stmap else smaller_plates(image, most_pixels)
    return Plate(path, image, view.header, smaller, layer)


def smaller_plates(image: ExrImage, most_pixels: int) -> dict[Quality, ExrImage]:
    """A plate for a quick look, and one between it and the plate, if there is room."""
    factor = proxy_factor(image.parts[0].display_window, most_pixels)
    factors: dict[Quality, int] = {"proxy": factor, "finer": factor // _FINER}
    found: dict[Quality, ExrImage] = {}
    for name, n in factors.items():
        proxy = proxy_of(image, n) if n > 1 else None
        if proxy is not None:
            found[name] = proxy
    return found


def proxy_factor(display: Window, most_pixels: int = MOST_PIXELS) -> int:
    """How many pixels of a plate lie along the side of one of its proxy; 1 where the
    plate is as small as a proxy."""
    factor = 1
    while display.area / factor**2 > most_pixels and factor < _MOST_FACTOR:
        factor *= 2
    return factor


def proxy_of(image: ExrImage, factor: int) -> ExrImage | None:
    """The plate with blocks of `factor` x `factor` pixels as one; None where a part has
    no whole block."""
    parts = [_smaller(part, factor) for part in image.parts]
    return None if None in parts else ExrImage(tuple(p for p in parts if p is not None))


def _smaller(part: ExrPart, factor: int) -> ExrPart | None:
    display, data = part.display_window, part.data_window
    low = [
        -(-(start - corner) // factor)
        for start, corner in zip(data[:2], display[:2], strict=True)
    ]
    high = [
        (end + 1 - corner) // factor - 1
        for end, corner in zip(data[2:], display[:2], strict=True)
    ]
    window = Window(*low, *high)
    if window.width < 1 or window.height < 1:
        return None
    left = low[0] * factor + display.x_min - data.x_min
    top = low[1] * factor + display.y_min - data.y_min
    rows = slice(top, top + window.height * factor)
    columns = slice(left, left + window.width * factor)
    mixed = {name for layer in colour_layers(part) for name in layer.names}
    channels = {
        name: (_mean if name in mixed else _middle)(samples[rows, columns], factor)
        for name, samples in part.channels.items()
    }
    size = Window.of_size(
        max(display.width // factor, 1), max(display.height // factor, 1)
    )
    return replace(part, channels=channels, data_window=window, display_window=size)


def _mean(samples: np.ndarray, factor: int) -> np.ndarray:
    rows, columns = (side // factor for side in samples.shape)
    blocks = samples.reshape(rows, factor, columns, factor).astype(np.float32)
    return blocks.mean(axis=(1, 3)).astype(samples.dtype)


def _middle(samples: np.ndarray, factor: int) -> np.ndarray:
    return np.ascontiguousarray(samples[factor // 2 :: factor, factor // 2 :: factor])
