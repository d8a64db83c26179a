"""Unreal Engine's lens file, ``.ulens``: tables over focus and zoom, as JSON.

The importer of the Camera Calibration plugin reads the spherical model only, which is
OpenCV's with K1, K2, K3, P1, P2; Fx, Fy, Cx, Cy count in widths and heights of the
picture, centres from its upper left corner (.5 is the middle). Each table is a text:
rows end with a semicolon, cells with a comma. The inputs of the tables are those of a
camera that states focus and zoom itself: focus distance in centimetres (the table of
the focus encoder says so) and nominal focal length in millimetres.

Source: Epic's plugin CameraCalibration, and files that other programs publish for it.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
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
    state_name,
    states_of,
)
from lensfit.exchange.foreign import ForeignLens, ForeignState, StatedValues
from lensfit.exchange.opencv import OpenCvMap
from lensfit.exchange.text_file import (
    finite_number,
    picture_size,
    positive_number,
    read_text,
)
from lensfit.printable import printable

_KIND = "Unreal lens file"
_TYPE, _VERSION, _MODEL = "LensFile", "0.0.0", "Spherical"
_KEYS = ("FocusEncoder", "ZoomEncoder")
_TABLES = {
    "FocalLengthTable": ("Fx", "Fy"),
    "ImageCenterTable": ("Cx", "Cy"),
    "DistortionTable": ("K1", "K2", "K3", "P1", "P2"),
}
_NODAL = ("Qx", "Qy", "Qz", "Qw", "Tx", "Ty", "Tz")
_FAR_CM = 1e6
"""In place of an infinite focus distance."""
_MM_PER_CM = 10.0
_MOST_ROWS = 2000


class UnrealState(NamedTuple):
    """A row of every table.

    Attributes
    ----------
    map : With five coefficients at most.
    focus_distance_mm : None or infinite is written as far away.
    """

    map: OpenCvMap
    focal_length_mm: float
    focus_distance_mm: float | None


def unreal_text(
    states: Sequence[UnrealState],
    name: str,
    serial: str | None,
    notes: Mapping[str, str],
) -> str:
    """The file.

    Parameters
    ----------
    notes : What it is, by name.
    """
    width, height = states[0].map.size_px
    pitch = states[0].map.pitch_mm
    rows = [(_focus_cm(s), s.focal_length_mm, *_numbers(s.map)) for s in states]
    parts, first = [], len(_KEYS)
    for table, columns in _TABLES.items():
        some = [(*r[:2], *r[first : first + len(columns)]) for r in rows]
        parts.append(_table(table, (*_KEYS, *columns), some))
        first += len(columns)
    still = [(*r[:2], 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0) for r in rows]
    parts.insert(2, _table("NodalOffsetTable", (*_KEYS, *_NODAL), still))
    focus = sorted({r[0] for r in rows})
    found = {
        "metadata": {
            "type": _TYPE,
            "version": _VERSION,
            "lensInfo": {
                "serialNumber": serial or "",
                "modelName": name,
                "distortionModel": _MODEL,
            },
            "name": name,
            "nodalOffsetCoordinateSystem": "OpenCV",
            "fxFyUnits": "Normalized",
            "cxCyUnits": "Normalized",
            "userMetadata": [{"name": k, "value": v} for k, v in notes.items()],
        },
        "sensorDimensions": {
            "width": width * pitch,
            "height": height * pitch,
            "units": "Millimeters",
        },
        "imageDimensions": {"width": width, "height": height},
        "cameraParameterTables": parts,
        "encoderTables": [
            _table("Focus", ("FocusEncoder", "FocusCM"), [(f, f) for f in focus]),
            _table("Iris", ("IrisEncoder", "IrisFstop"), []),
        ],
    }
    return json.dumps(found, indent="\t", allow_nan=False) + "\n"


def read_unreal(path: str | Path, stated: StatedValues) -> ForeignLens:
    """The lens of a lens file; a state for every row of its table of distortion.

    Raises
    ------
    ExchangeError : It is no lens file, of another model than the spherical one, or its
        tables do not belong together.
    """
    path = Path(path)
    found = _json(path)
    info = _part(_part(found, "metadata", path), "lensInfo", path)
    model = str(info.get("distortionModel"))
    if model.lower() != _MODEL.lower():
        raise ExchangeError(
            f"is of lens model {model[:40]!r}, and only the spherical one is read",
            where=path,
            remedy="hand over its UV map",
        )
    size, width = _frame(found, stated, path)
    pitch = width / size[0]
    tables = {name: _rows(found, name, path) for name in _TABLES}
    focus = _focus_curve(found, path)
    states = []
    for key, distortion in tables["DistortionTable"].items():
        row = {n: tables[n].get(key) for n in ("FocalLengthTable", "ImageCenterTable")}
        if None in row.values():
            raise ExchangeError(
                f"has distortion at focus {key[0]:g} and zoom {key[1]:g}, and no focal "
                "length or centre there",
                where=path,
            )
        numbers = (*row["FocalLengthTable"], *row["ImageCenterTable"], *distortion)  # pyright: ignore
        mapping = _map(numbers, size, pitch, path)
        focal = stated.focal_length_mm or _nominal(key[1], mapping)
        far = focus(key[0]) if stated.focus_distance_mm is None else None
        states.append(_state(mapping, focal, far, stated))
    name = str(info.get("modelName") or path.stem)
    sensor = (width, size[1] * pitch)
    serial = str(info.get("serialNumber") or "") or None
    return ForeignLens(_KIND, name, sensor, size, tuple(states), serial=serial)


def _focus_cm(state: UnrealState) -> float:
    mm = state.focus_distance_mm
    return _FAR_CM if mm is None or math.isinf(mm) else mm / _MM_PER_CM


def _numbers(camera: OpenCvMap) -> tuple[float, ...]:
    """fx, fy, cx, cy in pictures, then the coefficients in Unreal's order."""
    (width, height), matrix = camera.size_px, camera.matrix
    k1, k2, p1, p2, k3 = camera.coefficients[:5].tolist()
    assert not camera.coefficients[5:].any()
    return (
        float(matrix[0, 0]) / width,
        float(matrix[1, 1]) / height,
        (float(matrix[0, 2]) + 0.5) / width,
        (float(matrix[1, 2]) + 0.5) / height,
        k1, k2, k3, p1, p2,
    )  # fmt: skip


def _table(name: str, header: tuple[str, ...], rows: Sequence[tuple[float, ...]]):
    cells = (", ".join(repr(float(v)) for v in row) for row in rows)
    return {
        "parameterName": name,
        "header": ", ".join(header),
        "data": "; ".join(cells),
    }


def _json(path: Path) -> Mapping[str, Any]:
    try:
        found = json.loads(read_text(path, _KIND))
    except (ValueError, RecursionError) as error:
        raise ExchangeError(f"is not valid JSON ({error})", where=path) from error
    kind = found.get("metadata", {}) if isinstance(found, dict) else {}
    if not isinstance(kind, dict) or kind.get("type") != _TYPE:
        raise ExchangeError("is no Unreal lens file", where=path)
    return found


def _part(found: Mapping[str, Any], key: str, path: Path) -> Mapping[str, Any]:
    part = found.get(key)
    if not isinstance(part, dict):
        raise ExchangeError(f"holds no {key}", where=path)
    return part


def _frame(
    found: Mapping[str, Any], stated: StatedValues, path: Path
) -> tuple[tuple[int, int], float]:
    image = _part(found, "imageDimensions", path)
    sides = [
        positive_number(image.get(k), f"image {k}", path) for k in ("width", "height")
    ]
    size = picture_size(sides, "imageDimensions", path)
    stated.require_size(size, path)
    sensor = _part(found, "sensorDimensions", path)
    width = stated.sensor_width_mm
    return size, width or positive_number(sensor.get("width"), "sensor width", path)


def _listed_parameter(found: Mapping[str, Any], where: str, name: str, path: Path):
    tables = found.get(where)
    for table in tables if isinstance(tables, list) else ():
        if isinstance(table, dict) and table.get("parameterName") == name:
            return table
    raise ExchangeError(f"holds no {name}", where=path)


def _cells(table: Mapping[str, Any], columns: tuple[str, ...], path: Path):
    """The columns of a table, whatever their order."""
    name = table["parameterName"]
    header = [word.strip() for word in str(table.get("header")).split(",")]
    if not set(columns) <= set(header):
        raise ExchangeError(
            f"{name} has columns {', '.join(header)[:80]}, and should have "
            f"{', '.join(columns)}",
            where=path,
        )
    rows = [row for row in str(table.get("data") or "").split(";") if row.strip()]
    if len(rows) > _MOST_ROWS:
        raise ExchangeError(f"{name} has more than {_MOST_ROWS} rows", where=path)
    found = []
    for number, row in enumerate(rows, 1):
        words = [word.strip() for word in row.split(",")]
        if len(words) != len(header):
            raise ExchangeError(
                f"{name}: row {number} has {len(words)} cells and should have "
                f"{len(header)}",
                where=path,
            )
        cells = dict(zip(header, words, strict=True))
        found.append([finite_number(cells[c], f"{name} {c}", path) for c in columns])
    return found


def _rows(found: Mapping[str, Any], name: str, path: Path):
    """Values of a table by focus and zoom."""
    table = _listed_parameter(found, "cameraParameterTables", name, path)
    rows = _cells(table, (*_KEYS, *_TABLES[name]), path)
    if not rows:
        raise ExchangeError(f"{name} has no rows", where=path)
    return {(row[0], row[1]): tuple(row[2:]) for row in rows}


def _focus_curve(found: Mapping[str, Any], path: Path):
    """Focus distance in mm of an encoder's value; None where no table says it."""
    try:
        table = _listed_parameter(found, "encoderTables", "Focus", path)
    except ExchangeError:
        return lambda _key: None
    rows = np.array(sorted(_cells(table, ("FocusEncoder", "FocusCM"), path)))
    if not len(rows):
        return lambda _key: None

    def distance_mm(key: float) -> float | None:
        cm = float(np.interp(key, rows[:, 0], rows[:, 1]))
        if not cm > 0:
            return None
        return math.inf if cm >= _FAR_CM else cm * _MM_PER_CM

    return distance_mm


def _map(
    numbers: tuple[float, ...], size: tuple[int, int], pitch_mm: float, path: Path
) -> OpenCvMap:
    fx, fy, cx, cy, k1, k2, k3, p1, p2 = numbers
    for value in (fx, fy):
        positive_number(value, "Fx or Fy", path)
    (width, height), matrix = size, np.eye(3)
    matrix[0, 0], matrix[1, 1] = fx * width, fy * height
    matrix[:2, 2] = cx * width - 0.5, cy * height - 0.5
    coefficients = np.array([k1, k2, p1, p2, k3, *[0.0] * 9])
    return OpenCvMap(matrix, coefficients, size, pitch_mm)


def _nominal(zoom: float, mapping: OpenCvMap) -> float:
    """The zoom where it is a focal length, or else that of the pinhole."""
    distance = mapping.principal_distance_mm
    return zoom if 0.5 * distance < zoom < 2 * distance else distance


def _state(
    mapping: OpenCvMap, focal_mm: float, focus_mm: float | None, stated: StatedValues
) -> ForeignState:
    return ForeignState(
        map=mapping,
        principal_distance_mm=mapping.principal_distance_mm,
        principal_point_mm=mapping.principal_point_mm,
        focal_length_mm=focal_mm,
        focus_distance_mm=stated.focus_distance_mm or focus_mm,
    )


_COEFFICIENTS = 5
_PUPIL = "entrancePupilOffsetMm"


def export_unreal(request: ExportRequest) -> Exported:
    """A row for each entry, or for the one requested."""
    states, nearness, pupils, lens = [], [], [], None
    for state in states_of(request):
        lens = replace(request, state=state).lens()
        camera, residual = opencv_camera(lens, request.frame, _COEFFICIENTS)
        states.append(UnrealState(camera, lens.focal_length_mm, lens.focus_distance_mm))
        nearness.append(Nearness(f"distortion at {state_name(lens)}", residual))
        pupils.append(f"{float(lens.entrance_pupil_offset_mm):.3f}")
    assert lens is not None
    name = printable(" ".join(request.preset.lens.name.split()))
    notes = {
        "madeBy": lens_description(request, lens),
        "residual": "; ".join(map(str, nearness)),
        _PUPIL: "; ".join(pupils),
    }
    serial = request.preset.lens.serial
    write_text_atomic(request.out, unreal_text(states, name, serial, notes))
    found = export_result(request, lens, tuple(nearness))
    place = (
        "the nodal offset is written as none: place the camera in the entrance pupil, "
        f"{pupils[-1]} mm in front of the sensor"
    )
    return Exported(found.paths, found.nearness, (*found.notes, place))
