"""A stage of USD, and a camera in it with its samples over time.

Stages are opened by ``usd-core`` where that is installed. Payloads stay unloaded: a
camera needs none. Millimetres of the stage's unit follow from its ``metersPerUnit``, a
hundredth where it states none.

``focalLength``, ``horizontalAperture`` and ``verticalAperture`` are tenths of a scene
unit (millimetres where the stage counts in centimetres), ``focusDistance`` is a length
of the scene from the pinhole, ``fStop`` 0 means no depth of field and tells nothing.
The time of a sample is the frame number. An attribute that was never written is at
USD's default, and is not taken from there. ``focalLength`` is that of the pinhole;
cameras that lensfit wrote also state that of the zoom ring.

Reference: OpenUSD, UsdGeomCamera."""

import math
from collections.abc import Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, final

import numpy as np

from lensfit.errors import CameraError, LensfitError
from lensfit.io.camera.quantity import Reading, checked_quantity
from lensfit.io.camera.table import CameraFile, FrameKey, Readings
from lensfit.io.decoding import silenced_libraries
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


KIND = "USD camera"
_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
_TENTH = 0.1
_ATTRIBUTES = {
    USD_NOMINAL: ("focal_length_mm", None),
    "focalLength": ("pinhole_focal_length_mm", _TENTH),
    "horizontalAperture": ("sensor_width_mm", _TENTH),
    "verticalAperture": ("sensor_height_mm", _TENTH),
    "fStop": ("f_number", None),
    "focusDistance": ("focus_from_pupil_mm", 1.0),
}
"""Quantities, and scene units in which they count; None for a plain number."""
_NOTHING_AT_0 = ("fStop", "focusDistance")
Samples = tuple[tuple[float, ...], tuple[float, ...]]


def is_usd(path: Path) -> bool:
    """By the name of the file."""
    return path.suffix.lower() in _SUFFIXES


@final
class UsdShotCamera(CameraFile):
    """One camera of a stage, its samples taken out of it.

    Attributes
    ----------
    samples : Times and values of each attribute, joined by straight lines as USD does.
    """

    def __init__(
        self, path: Path, place: str, samples: Mapping[str, Samples], unit_mm: float
    ):
        self.path, self.kind, self.notes = path, KIND, ()
        self.place, self.samples, self.unit_mm = place, dict(samples), unit_mm

    def lacks(self, frame: FrameKey, first_frame: int | None) -> frozenset[str]:
        """None: an attribute has a value at every time."""
        return frozenset()

    def at(self, frame: FrameKey, first_frame: int | None) -> tuple[Readings, str]:
        """What is known at a frame, by quantity, and which camera it is.

        Raises
        ------
        CameraError : It changes over time and the frame is not known, or holds what
            cannot be.
        """
        found = {}
        for name, samples in self.samples.items():
            value = self._value(name, samples, frame)
            if name in _NOTHING_AT_0 and value == 0:
                continue
            quantity, units = _ATTRIBUTES[name]
            scale = 1.0 if units is None else units * self.unit_mm
            # Single precision: 2.8 is kept as 2.79999995.
            plain = float(f"{value * scale:.7g}")
            try:
                known = checked_quantity(quantity, plain, name)
            except CameraError as error:
                raise CameraError(error.what, where=self.path) from None
            if known is not None:
                found[quantity] = Reading(known, name)
        return found, self.place

    def _value(self, name: str, samples: Samples, frame: FrameKey) -> float:
        times, values = samples
        if len(times) > 1 and frame.number is None:
            raise CameraError(
                f"{name} changes over time, and the plate's name has no frame number",
                where=self.path,
                remedy="name the plate as plate.1001.exr",
            )
        return float(np.interp(frame.number or 0, times, values))


def _samples(prim: Any) -> Iterator[tuple[str, Samples]]:
    """Of every attribute that was written."""
    for name in _ATTRIBUTES:
        attribute = prim.GetAttribute(name)
        if not attribute or not attribute.HasAuthoredValue():
            continue
        times = list(attribute.GetTimeSamples())
        values = [attribute.Get(time) for time in times] or [attribute.Get()]
        if None not in values:
            yield name, (tuple(times or [0.0]), tuple(map(float, values)))


def read_usd_shot(path: Path, name: str | None) -> UsdShotCamera:
    """A camera of a stage.

    Parameters
    ----------
    name : Part of its path, where there are several.

    Raises
    ------
    CameraError : ``usd-core`` is missing, the file cannot be read, or holds no such
        camera, or several.
    """
    stage = open_stage(path, CameraError)
    cameras = [p for p in stage.Traverse() if p.GetTypeName() == "Camera"]
    word = (name or "").casefold()
    found = [p for p in cameras if word in str(p.GetPath()).casefold()]
    if len(found) != 1:
        names = ", ".join(str(p.GetPath()) for p in (found or cameras)[:5]) or "none"
        raise CameraError(
            f"holds no camera {name!r} ({names} are there)"
            if cameras and not found
            else f"holds {len(found)} cameras: {names}",
            where=path,
            remedy="say which with --camera-name"
            if cameras
            else "export the shot's camera",
        )
    unit = millimetres_per_unit(stage, path, CameraError)
    return UsdShotCamera(path, str(found[0].GetPath()), dict(_samples(found[0])), unit)
