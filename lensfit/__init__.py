"""lensfit: calibrate cinema lenses from photographs, and put them on CG plates.

The public names below are imported on first use, so that ``import lensfit`` and
``lensfit --help`` are instant. Importing any part of lensfit switches JAX to float64
for the whole process (`lensfit._jax` says why and how).
"""

import importlib
from typing import TYPE_CHECKING, Any

from lensfit._jax import configure_jax
from lensfit.errors import LensfitError

if TYPE_CHECKING:
    from lensfit.preset.schema import Preset
    from lensfit.preset.store import load_preset, save_preset
    from lensfit.render.frame import render
    from lensfit.workflow.calibrate import calibrate
    from lensfit.workflow.shoot.file import Shoot, load_shoot

__version__ = "0.1.0"

__all__ = [
    "LensfitError",
    "Preset",
    "Shoot",
    "calibrate",
    "load_preset",
    "load_shoot",
    "render",
    "save_preset",
]

_HOME = {
    "Preset": "lensfit.preset.schema",
    "Shoot": "lensfit.workflow.shoot.file",
    "calibrate": "lensfit.workflow.calibrate",
    "load_preset": "lensfit.preset.store",
    "load_shoot": "lensfit.workflow.shoot.file",
    "save_preset": "lensfit.preset.store",
}
_ROOMS = ("fit", "render")
"""Rooms that are also verbs; `lensfit._callable` says how."""

configure_jax()


def __getattr__(name: str) -> Any:
    """Import a public name when it is first asked for."""
    if name in _ROOMS:
        return importlib.import_module(f"lensfit.{name}")
    if name not in _HOME:
        raise AttributeError(f"module 'lensfit' has no attribute {name!r}")
    value = getattr(importlib.import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__, *_ROOMS])
