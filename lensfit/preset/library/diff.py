"""Two presets compared key by key, measured numbers against their deviation.

Members of lists are matched by what they are (an entry by focal length and focus, a
fall-off by its f-number), not by where they stand. Records of the measurement (terms,
covariance, provenance) are left out: they differ between any two calibrations.

Standard deviations are given by the key of their number. The covariance of an entry is
in the units of the fit (`lensfit.fitting.parameters`): what counts in reference radii
there, or in the logarithm of a length, is millimetres here.
"""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from lensfit.preset.blocks import Covariance
from lensfit.preset.entry import Entry
from lensfit.preset.library.key_path import (
    IDENTITY,
    MISSING,
    complete_tables,
    member_text,
)
from lensfit.preset.schema import Preset

_RECORDS = ("schema", "conventions", "provenance", "saved", "terms", "covariance")

Deviations = dict[str, float]


class Difference(NamedTuple):
    """A key at which two presets differ.

    Attributes
    ----------
    a, b : The values; `MISSING` where one has none.
    relative : (b - a) / |a| of two numbers; None otherwise, and where a is 0.
    deviations : (b - a) in standard deviations of the difference, as far as the presets
        state one of both or of either; None otherwise.
    """

    key: str
    a: Any
    b: Any
    relative: float | None
    deviations: float | None


def differences(a: Preset, b: Preset) -> list[Difference]:
    """Every key at which two presets differ, in the order of the schema."""
    spread = deviations_of(a), deviations_of(b)
    return [
        _difference(key, old, new, spread)
        for key, old, new in _differing_values(
            complete_tables(a), complete_tables(b), ""
        )
    ]


def _difference(
    key: str, a: Any, b: Any, spread: tuple[Deviations, Deviations]
) -> Difference:
    if not (_is_number(a) and _is_number(b)):
        return Difference(key, a, b, None, None)
    known = [of[key] for of in spread if of.get(key, 0.0) > 0]
    total = math.hypot(*known)
    return Difference(
        key,
        a,
        b,
        (b - a) / abs(a) if a else None,
        (b - a) / total if known else None,
    )


def _is_number(value: Any) -> bool:
    return isinstance(value, float | int) and not isinstance(value, bool)


def _differing_values(a: Any, b: Any, key: str) -> Iterator[tuple[str, Any, Any]]:
    """Key and both values of what differs below a key."""
    if isinstance(a, dict) and isinstance(b, dict):
        for name in [*a, *(n for n in b if n not in a)]:
            if name not in _RECORDS:
                below = f"{key}.{name}" if key else name
                yield from _differing_values(
                    a.get(name, MISSING), b.get(name, MISSING), below
                )
    elif isinstance(a, list) and isinstance(b, list):
        name = key.rpartition(".")[2]
        old, new = _members(a, name), _members(b, name)
        for member in [*old, *(m for m in new if m not in old)]:
            yield from _differing_values(
                old.get(member, MISSING), new.get(member, MISSING), key + member
            )
    elif a is not b and (a != b or type(a) is not type(b)):
        yield key, a, b


def _members(values: list[Any], name: str) -> dict[str, Any]:
    """Members of a list by how a key names them."""
    if name in IDENTITY and all(isinstance(v, dict) for v in values):
        return {member_text(name, v, i): v for i, v in enumerate(values)}
    return {f"[{i}]": v for i, v in enumerate(values)}


_DISTORTION = {
    "radial": "radial_log_slope",
    "decentering": "decentering",
    "thin_prism": "thin_prism",
    "anamorphic": "anamorphic",
}


def deviations_of(preset: Preset) -> Deviations:
    """Standard deviation of every number that has one, in the number's own unit."""
    found: Deviations = {}
    for index, entry in enumerate(preset.entries):
        place = "entries" + member_text("entries", complete_tables(entry), index)
        of_entry = _colour_and_light_deviations(entry)
        if entry.covariance is not None:
            of_entry |= _entry_deviations(entry, entry.covariance)
        found |= {f"{place}.{key}": sd for key, sd in of_entry.items()}
    return found


def _colour_and_light_deviations(entry: Entry) -> Deviations:
    """Their parameters are named as keys of their block, and in its units."""
    found: Deviations = {}
    lateral = entry.lateral_colour
    if lateral is not None and lateral.covariance is not None:
        for channel in ("r", "b"):
            place = f"lateral_colour.{channel}"
            found |= _below(place, getattr(lateral.covariance, channel))
    for index, light in enumerate(entry.fall_off):
        if light.covariance is not None:
            member = member_text("fall_off", complete_tables(light), index)
            for channel in ("r", "g", "b"):
                covariance = getattr(light.covariance, channel)
                found |= _below(f"fall_off{member}", covariance)
    return found


def _below(place: str, covariance: Covariance) -> Deviations:
    stated = zip(covariance.parameters, covariance.standard_deviation, strict=True)
    return {f"{place}.{name}": sd for name, sd in stated}


def _entry_deviations(entry: Entry, covariance: Covariance) -> Deviations:
    projection, distortion = entry.projection, entry.distortion
    free = len(distortion.field.x) if distortion.field else 0
    found: Deviations = {}
    stated = zip(covariance.parameters, covariance.standard_deviation, strict=True)
    for parameter, sd in stated:
        block, _, rest = parameter.partition("[")
        number = rest.removesuffix("]")
        if not number.isdecimal():
            continue
        index = int(number)
        if block in _DISTORTION:
            found[f"distortion.{_DISTORTION[block]}[{index}]"] = sd
        elif block == "free_field" and free:
            axis = "x" if index < free else "y"
            found[f"distortion.field.{axis}[{index % free}]"] = sd
        elif block == "principal_point":
            mm = sd * distortion.reference_radius_mm
            found[f"projection.principal_point_mm[{index}]"] = mm
        elif block == "focal_length":
            found["projection.principal_distance_mm"] = (
                sd * projection.principal_distance_mm
            )
    return found | _squeeze_deviations(entry, covariance)


def _squeeze_deviations(entry: Entry, covariance: Covariance) -> Deviations:
    """Of exp(|e|) and half the angle of e, where e is what was fitted."""
    names = ("squeeze[0]", "squeeze[1]")
    size = math.log(entry.distortion.squeeze)
    if size == 0 or not set(names) <= set(covariance.parameters):
        return {}
    rows = [covariance.parameters.index(name) for name in names]
    matrix = covariance.matrix()[np.ix_(rows, rows)]
    angle = 2 * entry.distortion.squeeze_axis_rad
    along = np.array([math.cos(angle), math.sin(angle)])
    across = np.array([-along[1], along[0]])
    return {
        "distortion.squeeze": entry.distortion.squeeze
        * math.sqrt(max(along @ matrix @ along, 0.0)),
        "distortion.squeeze_axis_rad": math.sqrt(max(across @ matrix @ across, 0.0))
        / (2 * abs(size)),
    }
