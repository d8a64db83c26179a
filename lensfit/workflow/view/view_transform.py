"""How linear light becomes colours of a screen: a view transform of OpenColorIO.

A config is that of ``$OCIO``, or one of those that OpenColorIO brings along, by its
``ocio://`` name; a page names one of these and no file. Where OpenColorIO is not
installed there are none, and pictures are shown in sRGB.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from jaxtyping import Float32, UInt8
from msgspec import Meta, Struct

from lensfit.errors import LensfitError, SettingsError
from lensfit.plate.camera.settings import file_stamp

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
    forward = _installed().TransformDirection.TRANSFORM_DIR_FORWARD
    with _as_sentences(wanted.config):
        found = config.getProcessor(wanted.space, display, view, forward)
        return found.getDefaultCPUProcessor()


def _config(name: str) -> Any:
    _installed()
    if name not in config_names():
        raise SettingsError(
            f"there is no OpenColorIO config {name!r} here",
            remedy="set $OCIO to yours, or choose one that OpenColorIO brings along",
        )
    path = os.environ["OCIO"] if name == ENVIRONMENT else name
    return _loaded(path, file_stamp(Path(path)))


@lru_cache(maxsize=4)
def _loaded(path: str, stamp: tuple[int, int] | None) -> Any:
    del stamp  # part of the key alone: an edited file has another
    with _as_sentences(path):
        return _installed().Config.CreateFromFile(path)


@contextmanager
def _as_sentences(config: str) -> Iterator[None]:
    """What OpenColorIO cannot do with a config, as an error that names it."""
    ocio = _installed()
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


def _installed() -> Any:
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
