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
    from lensfit.fitting.chart_view import View
    from lensfit.fitting.lens_states import fit
    from lensfit.lens import Lens
    from lensfit.preset.schema import Preset
    from lensfit.preset.store import load_preset, save_preset
    from lensfit.rendering.frame import render
    from lensfit.workflow.apply import apply as apply
    from lensfit.workflow.calibrate import calibrate
    from lensfit.workflow.shoot.shoot_file import Shoot, load_shoot

__version__ = "0.1.0"

__all__ = [
    "Lens",
    "LensfitError",
    "Preset",
    "Shoot",
    "View",
    "apply",
    "calibrate",
    "fit",
    "load_preset",
    "load_shoot",
    "render",
    "save_preset",
]

_HOME = {
    "Lens": ("lensfit.lens", "Lens"),
    "Preset": ("lensfit.preset.schema", "Preset"),
    "Shoot": ("lensfit.workflow.shoot.shoot_file", "Shoot"),
    "View": ("lensfit.fitting.chart_view", "View"),
    "apply": ("lensfit.workflow.apply", "apply"),
    "calibrate": ("lensfit.workflow.calibrate", "calibrate"),
    "fit": ("lensfit.fitting.lens_states", "fit"),
    "load_preset": ("lensfit.preset.store", "load_preset"),
    "load_shoot": ("lensfit.workflow.shoot.shoot_file", "load_shoot"),
    "render": ("lensfit.rendering.frame", "render"),
    "save_preset": ("lensfit.preset.store", "save_preset"),
}
"""Module and name there of each public name."""

configure_jax()


def __getattr__(name: str) -> Any:
    """Import a public name on first use."""
    if name not in _HOME:
        raise AttributeError(f"module 'lensfit' has no attribute {name!r}")
    home, known_as = _HOME[name]
    value = getattr(importlib.import_module(home), known_as)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
