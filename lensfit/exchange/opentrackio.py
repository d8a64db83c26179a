"""OpenTrackIO samples (JSON) with the lens of OpenLensIO.

A sample states one lens state: distortion in either direction (`brown_conrady`), the
projection offset dP and distortion offset dC in mm, pinhole focal length in mm, focus
distance and entrance pupil offset in *metres*, and the fall-off
v(r) = 1 - (a1 r^2 + a2 r^4 + a3 r^6) with r in mm from the sensor centre. Several
states are a list of samples. What the standard has no field for stands in its slot
`custom`: lensfit writes, where the calibration history says "custom: lensfit layout 1",

    [1, nominal focal length mm, focus dioptres (0 infinite, -1 unknown)]

and, for a lens with lateral colour, for red and then for blue: reference radius mm,
largest measured radius, shift x and y mm, two strains, two decenterings, the number
of radial coefficients and these (`lensfit.optics.lateral` has the formula).

Source: camdkit's lens types and schema (SMPTE RIS), OpenLensIO 1.0.1.
"""

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lensfit.errors import ExchangeError
from lensfit.exchange.brown_conrady import D_U, U_D, BrownMap
from lensfit.exchange.text_file import (
    finite_number,
    picture_size,
    positive_number,
    read_text,
)
from lensfit.io.camera.tracking import CUSTOM_LAYOUT, CUSTOM_MARK
from lensfit.units import MILLIMETRES_PER_METRE, dioptres_from_mm, m_from_mm

_UNKNOWN = -1.0
_HEAD_OF_SHIFT = 9
"""Numbers of a channel before its radial coefficients."""


@dataclass(frozen=True)
class ColourShift:
    """Where a channel lands against green, as `lensfit.preset.blocks.ChannelShift`."""

    reference_radius_mm: float
    valid_radius: float
    shift_mm: tuple[float, float]
    strain: tuple[float, float]
    decentering: tuple[float, float]
    radial: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class LensSample:
    """The lens and camera of one sample.

    Attributes
    ----------
    distortions : One or both directions, about the same centre.
    projection_offset_mm : dP.
    falloff : a1, a2, a3; empty when there is none.
    nominal_focal_length_mm : As on the barrel, or None.
    is_prime : Whether the standard's field for that may be used: a zoom has none.
    overscan : Factor (>= 1) that holds the undistorted frame; None when not stated.
    colour : "r" and "b", or empty.
    """

    name: str
    sensor_size_mm: tuple[float, float] | None
    size_px: tuple[int, int] | None
    distortions: tuple[BrownMap, ...]
    projection_offset_mm: tuple[float, float]
    pinhole_focal_length_mm: float
    nominal_focal_length_mm: float | None = None
    is_prime: bool = True
    focus_distance_mm: float | None = None
    f_number: float | None = None
    entrance_pupil_offset_mm: float | None = None
    falloff: tuple[float, ...] = ()
    overscan: float | None = None
    serial: str | None = None
    camera_model: str | None = None
    colour: Mapping[str, ColourShift] = field(default_factory=dict)
    history: tuple[str, ...] = ()


def custom_numbers(sample: LensSample) -> Iterator[float]:
    """What lensfit writes into `custom`."""
    focus = sample.focus_distance_mm
    yield CUSTOM_LAYOUT
    yield sample.nominal_focal_length_mm or sample.pinhole_focal_length_mm
    yield _UNKNOWN if focus is None else dioptres_from_mm(focus)
    for channel in "rb" if sample.colour else "":
        shift = sample.colour[channel]
        yield shift.reference_radius_mm
        yield shift.valid_radius
        yield from (*shift.shift_mm, *shift.strain, *shift.decentering)
        yield float(len(shift.radial))
        yield from shift.radial


@dataclass(frozen=True)
class Custom:
    """What lensfit keeps in `custom`.

    Attributes
    ----------
    nominal_mm : Focal length as on the barrel.
    focus_mm : Focus distance; may be infinite, None when not known.
    colour : "r" and "b", or empty.
    """

    nominal_mm: float
    focus_mm: float | None
    colour: dict[str, ColourShift]


def custom_of_numbers(numbers: tuple[float, ...], path: Path) -> Custom | None:
    """What the numbers of `custom` say; None of another layout.

    Raises
    ------
    ExchangeError : They are of this layout, and hold what cannot be.
    """
    if len(numbers) < 3 or numbers[0] != CUSTOM_LAYOUT:
        return None
    nominal, dioptres = positive_number(numbers[1], "custom[1]", path), numbers[2]
    focus = None
    if dioptres >= 0:
        focus = MILLIMETRES_PER_METRE / dioptres if dioptres else math.inf
    colour, rest = {}, numbers[3:]
    for channel in "rb" if rest else "":
        head, count = rest[:_HEAD_OF_SHIFT], 0
        if len(head) == _HEAD_OF_SHIFT:
            count = int(head[-1]) if 0 <= head[-1] < 100 else len(rest)
        end = _HEAD_OF_SHIFT + count
        if len(head) < _HEAD_OF_SHIFT or len(rest) < end or min(head[:2]) <= 0:
            raise ExchangeError("custom is no lateral colour of lensfit", where=path)
        colour[channel] = ColourShift(
            head[0],
            head[1],
            (head[2], head[3]),
            (head[4], head[5]),
            (head[6], head[7]),
            rest[_HEAD_OF_SHIFT:end],
        )
        rest = rest[end:]
    return Custom(nominal, focus, colour)


_KIND = "OpenTrackIO file"
_MOST_SAMPLES = 1000


def read_opentrackio(path: str | Path) -> tuple[LensSample, ...]:
    """The lens of every sample in a file: one object, or a list of them.

    Raises
    ------
    ExchangeError : It is no JSON, no sample, of a model that is not known here, or
        holds what cannot be.
    """
    path = Path(path)

    def refuse(word: str) -> float:
        raise ValueError(f"{word} is no number")

    try:
        found = json.loads(read_text(path, _KIND), parse_constant=refuse)
    except (ValueError, RecursionError) as error:
        raise ExchangeError(f"is not valid JSON ({error})", where=path) from error
    samples = found if isinstance(found, list) else [found]
    if not 0 < len(samples) <= _MOST_SAMPLES:
        raise ExchangeError(
            f"holds {len(samples)} samples, and 1 to {_MOST_SAMPLES} are read",
            where=path,
        )
    return tuple(_Reader(sample, path).sample() for sample in samples)


def opentrackio_text(samples: tuple[LensSample, ...]) -> str:
    """Samples as JSON: one object, or a list when there are several."""
    tables = [_tables(sample) for sample in samples]
    found = tables[0] if len(tables) == 1 else tables
    return json.dumps(found, indent=2, allow_nan=False) + "\n"


def _tables(sample: LensSample) -> dict[str, Any]:
    camera, static = {}, {"model": sample.name}
    if sample.camera_model:
        camera["model"] = sample.camera_model
    if sample.sensor_size_mm:
        width, height = sample.sensor_size_mm
        camera["activeSensorPhysicalDimensions"] = {"height": height, "width": width}
    if sample.size_px:
        camera["activeSensorResolution"] = {
            "height": sample.size_px[1],
            "width": sample.size_px[0],
        }
    if sample.serial:
        static["serialNumber"] = sample.serial
    known = {
        "nominalFocalLength": sample.nominal_focal_length_mm
        if sample.is_prime
        else None,
        "distortionOverscanMax": sample.overscan,
        "undistortionOverscanMax": sample.overscan,
        "calibrationHistory": [*sample.history, CUSTOM_MARK],
    }
    static |= {k: v for k, v in known.items() if v is not None}
    return {
        "static": {"camera": camera, "lens": static},
        "lens": _lens_table(sample),
        "protocol": {"name": "OpenTrackIO", "version": [1, 0, 1]},
    }


def _lens_table(sample: LensSample) -> dict[str, Any]:
    centre = sample.distortions[0].centre_mm
    dx, dy = sample.projection_offset_mm
    focus = sample.focus_distance_mm
    pupil = sample.entrance_pupil_offset_mm
    known = {
        "custom": list(custom_numbers(sample)),
        "distortion": [
            _distortion_table(d, sample.overscan) for d in sample.distortions
        ],
        "distortionOffset": {"x": centre[0] - dx, "y": centre[1] - dy},
        "projectionOffset": {"x": dx, "y": dy},
        "pinholeFocalLength": sample.pinhole_focal_length_mm,
        "focusDistance": None
        if focus is None or math.isinf(focus)
        else m_from_mm(focus),
        "fStop": sample.f_number,
        "entrancePupilOffset": None if pupil is None else m_from_mm(pupil),
        "exposureFalloff": dict(zip(("a1", "a2", "a3"), sample.falloff, strict=False))
        or None,
    }
    return {key: value for key, value in known.items() if value is not None}


def _distortion_table(one: BrownMap, overscan: float | None) -> dict[str, Any]:
    table: dict[str, Any] = {"model": one.model, "radial": list(one.radial)}
    if one.tangential:
        table["tangential"] = list(one.tangential)
    if overscan is not None:
        table["overscan"] = overscan
    return table


class _Reader:
    """One sample's tables, every value checked as it is taken."""

    def __init__(self, sample: Any, path: Path):
        self.path = path
        self.top = self._object(sample, "the sample")
        self.lens = self._object(self.top.get("lens", {}), "lens")
        self.static = self._object(self.top.get("static", {}), "static")

    def sample(self) -> LensSample:
        """The lens of the sample."""
        fixed = self._object(self.static.get("lens", {}), "static.lens")
        camera = self._object(self.static.get("camera", {}), "static.camera")
        history = tuple(str(h)[:1024] for h in self._list(fixed, "calibrationHistory"))
        own = self._own() if CUSTOM_MARK in history else None
        nominal = own.nominal_mm if own else self._number(fixed, "nominalFocalLength")
        pinhole = self._number(self.lens, "pinholeFocalLength", above=0.0)
        offset = self._pair(self.lens, "projectionOffset") or (0.0, 0.0)
        if pinhole is None and nominal is None:
            raise ExchangeError(
                "states no pinholeFocalLength and no nominalFocalLength",
                where=self.path,
            )
        focus = _mm(self._number(self.lens, "focusDistance", above=0.0))
        pupil = _mm(self._number(self.lens, "entrancePupilOffset"))
        return LensSample(
            name=self._text(fixed, "model") or self.path.stem,
            serial=self._text(fixed, "serialNumber"),
            camera_model=self._text(camera, "model"),
            sensor_size_mm=self._sensor(camera),
            size_px=self._pixels(camera),
            distortions=self._distortions(offset, self._sensor(camera)),
            projection_offset_mm=offset,
            pinhole_focal_length_mm=pinhole or nominal or 0.0,
            nominal_focal_length_mm=nominal,
            focus_distance_mm=own.focus_mm if own else focus,
            f_number=self._number(self.lens, "fStop", above=0.0),
            entrance_pupil_offset_mm=pupil,
            falloff=self._falloff(),
            colour=own.colour if own else {},
            history=tuple(h for h in history if h != CUSTOM_MARK),
        )

    def _distortions(
        self, offset: tuple[float, float], sensor: tuple[float, float] | None
    ) -> tuple[BrownMap, ...]:
        dx, dy = self._pair(self.lens, "distortionOffset") or (0.0, 0.0)
        centre = (offset[0] + dx, offset[1] + dy)
        unit = math.hypot(*(sensor or (36.0, 24.0))) / 2
        found = []
        for one in self._list(self.lens, "distortion"):
            table = self._object(one, "lens.distortion")
            model = table.get("model", D_U)
            if model not in (D_U, U_D):
                continue
            radial = self._numbers(table, "radial", most=6)
            tangential = self._numbers(table, "tangential", most=2)
            found.append(BrownMap(model, radial, tangential, centre, unit))
        if not found:
            raise ExchangeError(
                "holds no distortion of a model known here",
                where=self.path,
                remedy=f"known are {D_U} and {U_D}",
            )
        return tuple(found)

    def _falloff(self) -> tuple[float, ...]:
        table = self._object(self.lens.get("exposureFalloff", {}), "exposureFalloff")
        found = [self._number(table, name) for name in ("a1", "a2", "a3")]
        return tuple(a or 0.0 for a in found) if found[0] is not None else ()

    def _own(self) -> Custom | None:
        numbers = self._numbers(self.lens, "custom", most=200)
        return custom_of_numbers(numbers, self.path)

    def _sensor(self, camera: Mapping[str, Any]) -> tuple[float, float] | None:
        name = "activeSensorPhysicalDimensions"
        if name not in camera:
            return None
        table = self._object(camera[name], name)
        width, height = (
            positive_number(table.get(side), f"{name}.{side}", self.path)
            for side in ("width", "height")
        )
        return width, height

    def _pixels(self, camera: Mapping[str, Any]) -> tuple[int, int] | None:
        name = "activeSensorResolution"
        if name not in camera:
            return None
        table = self._object(camera[name], name)
        found = [
            positive_number(table.get(side), f"{name}.{side}", self.path)
            for side in ("width", "height")
        ]
        return picture_size(found, name, self.path)

    def _pair(self, table: Mapping[str, Any], key: str) -> tuple[float, float] | None:
        if key not in table:
            return None
        found = self._object(table[key], key)
        x, y = (finite_number(found.get(a), f"{key}.{a}", self.path) for a in "xy")
        return x, y

    def _number(
        self, table: Mapping[str, Any], key: str, above: float | None = None
    ) -> float | None:
        if table.get(key) is None:
            return None
        check = finite_number if above is None else positive_number
        return check(table[key], key, self.path)

    def _numbers(
        self, table: Mapping[str, Any], key: str, most: int
    ) -> tuple[float, ...]:
        found = self._list(table, key)
        if len(found) > most:
            raise ExchangeError(
                f"{key} has {len(found)} numbers, at most {most} are known",
                where=self.path,
            )
        return tuple(finite_number(value, key, self.path) for value in found)

    def _text(self, table: Mapping[str, Any], key: str) -> str | None:
        found = table.get(key)
        return found.strip()[:1024] or None if isinstance(found, str) else None

    def _list(self, table: Mapping[str, Any], key: str) -> list[Any]:
        found = table.get(key)
        if found is not None and not isinstance(found, list):
            raise ExchangeError(f"{key} is no list", where=self.path)
        return found or []

    def _object(self, value: Any, what: str) -> Mapping[str, Any]:
        if not isinstance(value, dict):
            raise ExchangeError(f"{what} is no JSON object", where=self.path)
        return value


def _mm(metres: float | None) -> float | None:
    return None if metres is None else metres * MILLIMETRES_PER_METRE
