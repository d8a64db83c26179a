"""A USD camera that carries the lens, as Omniverse's renderers read it.

The camera is the pinhole of the undistorted picture over the photograph's frame: USD's
focal length, apertures and their offsets, in tenths of a scene unit (the stage counts
in centimetres, so these are millimetres), f-stop, and the focus distance from the
pinhole, which stands in the entrance pupil. The focal length of the zoom ring has an
attribute of lensfit's own. The distortion is NVIDIA's applied schema
``OmniLensDistortionOpenCvPinholeAPI``: OpenCV's model and coefficients
(`lensfit.exchange.opencv`) with a principal point in pixels from the corner of
the picture, where OpenCV itself counts from the middle of its first pixel.

Written as text, which needs no library; read with ``usd-core``, in any of USD's forms.

References
----------
OpenUSD, UsdGeomCamera. NVIDIA ovrtx, "Lens Calibration" and "Lens Distortion Schemas".
"""

import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from lensfit.atomic import write_text_atomic
from lensfit.errors import ExchangeError
from lensfit.exchange.brown_conrady import opencv_camera
from lensfit.exchange.export_request import (
    Exported,
    ExportRequest,
    Nearness,
    export_result,
    lens_description,
)
from lensfit.exchange.foreign import ForeignLens, ForeignState, StatedValues
from lensfit.exchange.opencv import OpenCvMap
from lensfit.exchange.text_file import finite_number, positive_number
from lensfit.io.camera.usd import USD_NOMINAL, millimetres_per_unit, open_stage, pxr

_KIND = "USD camera"
_PREFIX = "omni:lensdistortion:opencvPinhole:"
_COEFFICIENTS = (
    "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4",
)  # fmt: skip
"""In OpenCV's order; its tilted sensor has none."""
_LENS, _PUPIL = "lensfit:lens", "lensfit:entrancePupilOffsetMm"


class UsdCamera(NamedTuple):
    """A camera with its lens.

    Attributes
    ----------
    map : The lens, over a picture of known size and width.
    f_number : None if not stated.
    focus_distance_mm : From the sensor; None if not stated, or infinite.
    entrance_pupil_offset_mm : None if not stated.
    name : Of the lens.
    nominal_focal_length_mm : As on the barrel or zoom ring; None if not stated.
    """

    map: OpenCvMap
    f_number: float | None
    focus_distance_mm: float | None
    entrance_pupil_offset_mm: float | None
    name: str
    nominal_focal_length_mm: float | None = None


def usd_camera_text(camera: UsdCamera, comment: str) -> str:
    """The camera as a stage of its own, in USD's text form.

    Parameters
    ----------
    comment : What it is, and how near.
    """
    lens = camera.map
    width_mm, height_mm = (n * lens.pitch_mm for n in lens.size_px)
    x, y = lens.principal_point_mm
    values = {
        "token projection": '"perspective"',
        "float focalLength": _number(lens.principal_distance_mm),
        "float horizontalAperture": _number(width_mm),
        "float verticalAperture": _number(height_mm),
        # The window of the frustum moves against the axis; y points up in USD.
        "float horizontalApertureOffset": _number(-x),
        "float verticalApertureOffset": _number(y),
    }
    pupil = camera.entrance_pupil_offset_mm
    focus = camera.focus_distance_mm
    if focus is not None and math.isfinite(focus):
        values["float focusDistance"] = _number((focus - (pupil or 0.0)) / 10)
    if camera.f_number is not None:
        values["float fStop"] = _number(camera.f_number)
    own = {USD_NOMINAL: camera.nominal_focal_length_mm, _PUPIL: pupil}
    stated = {name: value for name, value in own.items() if value is not None}
    values |= {f"custom double {n}": _number(v) for n, v in stated.items()}
    values[f"custom string {_LENS}"] = _text(camera.name)
    values["token omni:lensdistortion:model"] = '"opencvPinhole"'
    values[f"int2 {_PREFIX}imageSize"] = f"({lens.size_px[0]}, {lens.size_px[1]})"
    matrix = lens.matrix
    numbers = {
        "fx": matrix[0, 0],
        "fy": matrix[1, 1],
        "cx": matrix[0, 2] + 0.5,
        "cy": matrix[1, 2] + 0.5,
        **dict(zip(_COEFFICIENTS, lens.coefficients, strict=False)),
    }
    values |= {f"float {_PREFIX}{n}": _number(v) for n, v in numbers.items()}
    body = "\n".join(f"    {name} = {value}" for name, value in values.items())
    return (
        "#usda 1.0\n(\n"
        f"    doc = {_text(comment)}\n"
        '    defaultPrim = "Camera"\n'
        "    metersPerUnit = 0.01\n"
        '    upAxis = "Y"\n)\n\n'
        'def Camera "Camera" (\n'
        '    prepend apiSchemas = ["OmniLensDistortionOpenCvPinholeAPI"]\n)\n'
        f"{{\n{body}\n}}\n"
    )


def _number(value: float) -> str:
    return repr(float(value))


def _text(value: str) -> str:
    """As a word of USD's text form, on one line."""
    plain = "".join(c if c.isprintable() else " " for c in value)
    return '"' + plain.replace("\\", "\\\\").replace('"', '\\"') + '"'


def read_usd_camera(path: str | Path, stated: StatedValues) -> ForeignLens:
    """The lens of a camera in a USD file; at the first of its time samples.

    Parameters
    ----------
    stated : `lens` chooses among several cameras, by part of the name.

    Raises
    ------
    ExchangeError : ``usd-core`` is missing, the file cannot be read, or holds no camera
        with OpenCV's lens, or several.
    """
    path = Path(path)
    stage = open_stage(path, ExchangeError)
    prim = _camera(stage, stated.lens, path)
    fields = _Fields(prim, path)
    millimetres = millimetres_per_unit(stage, path, ExchangeError)
    size = stated.size_px or fields.size()
    pitch = stated.sensor_width_mm or fields.positive("horizontalAperture") * (
        millimetres / 10
    )
    pitch /= size[0]
    matrix = np.array(
        [
            [fields.positive(f"{_PREFIX}fx"), 0.0, fields.number(f"{_PREFIX}cx") - 0.5],
            [0.0, fields.positive(f"{_PREFIX}fy"), fields.number(f"{_PREFIX}cy") - 0.5],
            [0.0, 0.0, 1.0],
        ]
    )
    coefficients = np.zeros(14)
    for index, name in enumerate(_COEFFICIENTS):
        coefficients[index] = fields.number(f"{_PREFIX}{name}", 0.0)
    mapping = OpenCvMap(matrix, coefficients, size, pitch)
    pupil = fields.number(_PUPIL) if fields.has(_PUPIL) else None
    nominal = fields.positive(USD_NOMINAL) if fields.has(USD_NOMINAL) else None
    focus = fields.number("focusDistance", 0.0) * millimetres
    from_sensor = focus + (pupil or 0.0) if focus > 0 else None
    distance = mapping.principal_distance_mm
    state = ForeignState(
        map=mapping,
        principal_distance_mm=distance,
        principal_point_mm=mapping.principal_point_mm,
        focal_length_mm=stated.focal_length_mm or nominal or distance,
        focus_distance_mm=stated.focus_distance_mm or from_sensor,
        entrance_pupil_offset_mm=pupil,
    )
    name = str(fields.value(_LENS) or prim.GetName())
    sensor = (size[0] * pitch, size[1] * pitch)
    return ForeignLens(_KIND, name, sensor, size, (state,))


class _Fields:
    """Attributes of a prim, at the first time that they have a value."""

    def __init__(self, prim: Any, path: Path):
        self.prim, self.path = prim, path

    def has(self, name: str) -> bool:
        return bool(self.prim.GetAttribute(name).HasAuthoredValue())

    def value(self, name: str) -> Any:
        attribute = self.prim.GetAttribute(name)
        if not attribute:
            return None
        found = attribute.Get(pxr("Usd").TimeCode.EarliestTime())
        return attribute.Get() if found is None else found

    def number(self, name: str, without: float | None = None) -> float:
        found = self.value(name)
        if found is None and without is not None:
            return without
        if found is None:
            raise ExchangeError(
                f"{self.prim.GetPath()} states no {name}", where=self.path
            )
        return finite_number(found, name, self.path)

    def positive(self, name: str) -> float:
        return positive_number(self.number(name), name, self.path)

    def size(self) -> tuple[int, int]:
        found = self.value(f"{_PREFIX}imageSize")
        if found is None or len(found) != 2 or min(found) < 1:
            raise ExchangeError(
                "does not say how large the picture is",
                where=self.path,
                remedy="give --size",
            )
        return int(found[0]), int(found[1])


def _camera(stage: Any, wanted: str | None, path: Path) -> Any:
    """The one camera with OpenCV's lens."""
    cameras = [p for p in stage.Traverse() if p.GetTypeName() == "Camera"]
    found = [p for p in cameras if p.GetAttribute(f"{_PREFIX}fx").HasAuthoredValue()]
    if wanted is not None:
        found = [p for p in found if wanted.lower() in str(p.GetPath()).lower()]
    if len(found) == 1:
        return found[0]
    if not found:
        raise ExchangeError(
            f"has {len(cameras)} cameras, and none with OpenCV's lens"
            + ("" if wanted is None else f" is called {wanted!r}"),
            where=path,
            remedy="give a camera with OmniLensDistortionOpenCvPinholeAPI",
        )
    names = ", ".join(str(p.GetPath()) for p in found[:5])
    raise ExchangeError(
        f"has {len(found)} cameras with a lens ({names})",
        where=path,
        remedy="say which with --lens",
    )


def export_usd(request: ExportRequest) -> Exported:
    """A USD camera with OpenCV's lens, as Omniverse reads it."""
    lens, frame = request.lens(), request.frame
    mapping, residual = opencv_camera(lens, frame)
    camera = UsdCamera(
        mapping,
        request.state.f_number,
        lens.focus_distance_mm,
        float(lens.entrance_pupil_offset_mm),
        request.preset.lens.name,
        lens.focal_length_mm,
    )
    comment = f"{lens_description(request, lens)}; residual {residual} over {frame}"
    write_text_atomic(request.out, usd_camera_text(camera, comment))
    return export_result(request, lens, (Nearness("distortion", residual),))
