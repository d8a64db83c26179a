"""The camera state of a plate: its header, the user's word, what the preset needs.

A value that is missing is an error only where the answer depends on it: the focal
length of a prime's preset is known without it, that of a zoom's is not.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from lensfit.errors import ImageError, PresetError
from lensfit.io.metadata import camera_state_from
from lensfit.preset.knobs import NEUTRAL, Knobs, knobs_in, turned
from lensfit.preset.schema import Preset


@dataclass(frozen=True)
class StateOverrides:
    """Camera state given by the user; None leaves the header's word."""

    focal_length_mm: float | None = None
    f_number: float | None = None
    focus_distance_mm: float | None = None
    sensor_width_mm: float | None = None


class PlateState(NamedTuple):
    """The state a plate is rendered at.

    Attributes
    ----------
    lens_key : focal_length_mm, f_number and focus_distance_mm, as `Preset.at` takes
        them; None where the preset decides.
    sensor_width_mm : Width that the display window spans.
    notes : One sentence for each thing that was assumed.
    knobs : As turned by the preset, the header and the user, the last one first.
    """

    lens_key: tuple[float | None, float | None, float | None]
    sensor_width_mm: float
    notes: tuple[str, ...]
    knobs: Knobs = NEUTRAL


_LEAST_WIDTH_MM = 0.01
"""Less is no sensor but another unit, or a slip."""
_WHERE_TO_FIND = {
    "focal_length_mm": ("focal length", "pinholeFocalLength or lens/focal"),
    "f_number": ("f-number", "aperture or lens/fstop"),
    "focus_distance_mm": ("focus distance", "focus or lens/focus"),
}


def plate_state(
    preset: Preset,
    attributes: Mapping[str, object],
    size_px: tuple[int, int],
    overrides: StateOverrides,
    *,
    falloff: bool = True,
    knobs: Mapping[str, object] | None = None,
) -> PlateState:
    """The state of one plate.

    Parameters
    ----------
    preset : The lens, which decides what must be known.
    attributes : Header of the plate.
    size_px : Width and height of its display window, pixels.
    overrides : What the user states.
    falloff : Whether the fall-off, and so the f-number, matters.
    knobs : What the user turned, by name.

    Raises
    ------
    ImageError : The sensor has no width, or a value is missing that the preset cannot
        do without; the line names it, the header entries it is looked for in and the
        option that gives it.
    PresetError : The preset does not reach the state.
    """
    header = camera_state_from(attributes, size_px)
    values = {
        name: _either(getattr(overrides, name), getattr(header, name))
        for name in _WHERE_TO_FIND
    }
    for name in _needed(preset, falloff):
        if values[name] is None:
            raise _missing(name)
    key = (
        values["focal_length_mm"],
        values["f_number"],
        values["focus_distance_mm"],
    )
    notes = list(preset.select(*key).notes)
    width = _either(overrides.sensor_width_mm, header.sensor_width_mm)
    if width is None:
        width = preset.camera.sensor_width_mm
        notes.append(
            f"no sensor width in the header: the preset's {width:g} mm is used "
            "(--sensor-width-mm states another)"
        )
    elif width > preset.camera.sensor_width_mm * 1.001:
        notes.append(
            f"the plate spans {width:g} mm and the lens was photographed over "
            f"{preset.camera.sensor_width_mm:g} mm: the rest is extrapolated"
        )
    if not _LEAST_WIDTH_MM <= width < math.inf:
        raise ImageError(
            f"the sensor is stated to be {width:g} mm wide",
            remedy="give its width with --sensor-width-mm",
        )
    return PlateState(
        key, width, tuple(notes), _turned(preset, attributes, knobs or {})
    )


def _turned(
    preset: Preset, attributes: Mapping[str, object], stated: Mapping[str, object]
) -> Knobs:
    by_header = turned(
        preset.knobs, knobs_in(attributes), error=ImageError, where="header"
    )
    return turned(by_header, stated, error=PresetError, where="options")


def _either(stated: float | None, found: float | None) -> float | None:
    return found if stated is None else stated


def _needed(preset: Preset, falloff: bool) -> list[str]:
    """What the preset cannot decide by itself."""
    needed = []
    focal_lengths = [entry.focal_length_mm for entry in preset.entries]
    if len(set(focal_lengths)) > 1:
        needed.append("focal_length_mm")
    if len(set(focal_lengths)) < len(focal_lengths):
        needed.append("focus_distance_mm")
    if falloff and any(len(entry.fall_off) > 1 for entry in preset.entries):
        needed.append("f_number")
    return needed


def _missing(name: str) -> ImageError:
    words, entries = _WHERE_TO_FIND[name]
    option = "--" + name.replace("_", "-")
    return ImageError(
        f"states no {words} (looked for {entries} in the header)",
        remedy=f"give it with {option}",
    )
