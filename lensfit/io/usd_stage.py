"""A stage of USD, opened by ``usd-core`` where that is installed.

Payloads stay unloaded: a camera needs none. Millimetres of the stage's unit follow from
its ``metersPerUnit``, a hundredth where it states none.
"""

import math
from importlib import import_module
from pathlib import Path
from typing import Any

from lensfit.errors import LensfitError
from lensfit.io.library_output import silenced_libraries
from lensfit.units import MILLIMETRES_PER_METRE

STARTS = (b"#usda", b"PXR-USDC")
"""How files of USD begin; packed ones (``.usdz``) are archives."""
USD_NOMINAL = "lensfit:nominalFocalLengthMm"
"""What lensfit writes beside USD's own attributes of a camera: focal length as on the
zoom ring, mm. A preset goes by it, and USD has no attribute for it."""
_MOST_BYTES = 1 << 28


def pxr(name: str) -> Any:
    """A module of usd-core, of which only some versions state types."""
    return import_module(f"pxr.{name}")


def open_stage(path: Path, error: type[LensfitError]) -> Any:
    """The stage in a file.

    Parameters
    ----------
    error : What is raised.

    Raises
    ------
    LensfitError : ``usd-core`` is missing, or the file cannot be read.
    """
    try:
        tf, usd = pxr("Tf"), pxr("Usd")
    except ImportError as failure:
        raise error(
            "is a USD file, which needs usd-core to be read",
            where=path,
            remedy="pip install 'lensfit[usd]'",
        ) from failure
    if not path.is_file() or path.stat().st_size > _MOST_BYTES:
        raise error(
            f"is no file of up to {_MOST_BYTES >> 20} MiB",
            where=path,
            remedy="export the camera alone",
        )
    try:
        with silenced_libraries():
            return usd.Stage.Open(str(path), usd.Stage.LoadNone)
    except tf.ErrorException as failure:
        raise error(
            "is a USD file that cannot be read", where=path, remedy="export it again"
        ) from failure


def millimetres_per_unit(stage: Any, path: Path, error: type[LensfitError]) -> float:
    """Of lengths in the scene; cameras count in tenths of it.

    Raises
    ------
    LensfitError : The stage states a unit that is none.
    """
    metres = stage.GetMetadata("metersPerUnit")
    unit = 0.01 if metres is None else float(metres)
    if not 0 < unit < math.inf:
        raise error(f"metersPerUnit = {unit:g} is no length", where=path)
    return unit * MILLIMETRES_PER_METRE
