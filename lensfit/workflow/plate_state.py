"""The camera state of a plate: what its sources say, and what the preset needs.

`lensfit.workflow.camera_sources` has the sources, and which of them counts.

A value that is missing is an error only where the answer depends on it: the focal
length of a prime's preset is known without it, that of a zoom's is not.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from lensfit.errors import ImageError, PresetError, SettingsError
from lensfit.preset.knobs import NEUTRAL, Knobs, knobs_in, slips_in, turned
from lensfit.preset.schema import Preset
from lensfit.render.look.white_balance import REC709, Chromaticities
from lensfit.workflow.camera_sources import PlateCamera
from lensfit.workflow.focus_pick import from_sensor_mm


class PlateState(NamedTuple):
    """The state a plate is rendered at.

    Attributes
    ----------
    lens_key : focal_length_mm, f_number and focus_distance_mm, as `Preset.at` takes
        them; None where the preset decides.
    sensor_width_mm : Width that the display window spans.
    notes : One sentence for each thing that was assumed.
    knobs : As turned by the preset, the header and the user, the last one first.
    chromaticities : x and y of red, green, blue and white of the plate; None where its
        header does not say.
    """

    lens_key: tuple[float | None, float | None, float | None]
    sensor_width_mm: float
    notes: tuple[str, ...]
    knobs: Knobs = NEUTRAL
    chromaticities: Chromaticities | None = None


_LEAST_WIDTH_MM = 0.01
"""Less is no sensor but another unit, or a slip."""
_LEAST_PART = 0.12
"""Of the width that was photographed: a smaller one may be in centimetres."""
_WHERE_TO_FIND = {
    "focal_length_mm": ("focal length", "pinholeFocalLength or lens/focal"),
    "f_number": ("f-number", "aperture or lens/fstop"),
    "focus_distance_mm": ("focus distance", "focus or lens/focus"),
}


def plate_state(
    preset: Preset,
    camera: PlateCamera,
    attributes: Mapping[str, object],
    *,
    falloff: bool = True,
    knobs: Mapping[str, object] | None = None,
) -> PlateState:
    """The state of one plate.

    Parameters
    ----------
    preset : The lens, which decides what must be known.
    camera : What is known of the plate's camera.
    attributes : Header of the plate.
    falloff : Whether the fall-off, and so the f-number, matters.
    knobs : What the user turned, by name.

    Raises
    ------
    ImageError : The sensor has no width, or a value is missing that the preset cannot
        do without; the line names it, where it was looked for and the option that
        gives it.
    PresetError : The preset does not reach the state.
    """
    key = _lens_key(preset, camera)
    for name, value in zip(_WHERE_TO_FIND, key, strict=True):
        if value is None and name in _needed(preset, falloff):
            raise _missing(name, camera)
    notes = [*camera.notes, *preset.select(*key).notes]
    width, note = _width_mm(preset, camera)
    notes += [*([note] if note else []), *slips_in(attributes)]
    turns = _turned(preset, attributes, camera, knobs or {})
    colours = _chromaticities(attributes)
    return PlateState(key, width, tuple(notes), turns, colours)


def _chromaticities(attributes: Mapping[str, object]) -> Chromaticities | None:
    """The standard attribute; one that is not eight numbers says nothing."""
    try:
        numbers = np.asarray(attributes.get("chromaticities"), float).ravel()
    except (TypeError, ValueError):
        return None
    if numbers.size != len(REC709) or not np.isfinite(numbers).all():
        return None
    return tuple(numbers.tolist())


def _lens_key(
    preset: Preset, camera: PlateCamera
) -> tuple[float | None, float | None, float | None]:
    focal, stop, focus = map(camera.number, _WHERE_TO_FIND)
    if focus is not None and camera.known["focus_distance_mm"].from_pupil:
        focus = from_sensor_mm(focus, lambda guess: preset.at(focal, stop, guess))
    return focal, stop, focus


def _width_mm(preset: Preset, camera: PlateCamera) -> tuple[float, str | None]:
    """The width that the display window spans, and what is to be said of it."""
    width, measured, note = (
        camera.number("sensor_width_mm"),
        preset.camera.sensor_width_mm,
        None,
    )
    if width is None:
        width = measured
        note = (
            f"no sensor width in the header: the preset's {width:g} mm is used "
            "(--sensor-width-mm states another)"
        )
    elif width > measured * 1.001:
        note = (
            f"the plate spans {width:g} mm and the lens was photographed over "
            f"{measured:g} mm: the rest is extrapolated"
        )
    elif _LEAST_WIDTH_MM <= width < _LEAST_PART * measured:
        note = (
            f"the plate spans {width:g} mm of the {measured:g} mm that the lens was "
            "photographed over: make sure that this is in mm (--sensor-width-mm)"
        )
    if not _LEAST_WIDTH_MM <= width < math.inf:
        raise ImageError(
            f"the sensor is stated to be {width:g} mm wide",
            remedy="give its width with --sensor-width-mm",
        )
    return width, note


def _turned(
    preset: Preset,
    attributes: Mapping[str, object],
    camera: PlateCamera,
    stated: Mapping[str, object],
) -> Knobs:
    """Knobs by the preset, turned by the header, the settings, the options."""
    found = turned(preset.knobs, knobs_in(attributes), error=ImageError, where="header")
    settings = camera.settings
    for name, value in settings.knobs.items():
        file = settings.knob_paths[name]
        found = turned(found, {name: value}, error=SettingsError, where=file)
    return turned(found, stated, error=PresetError, where="options")


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


def _missing(name: str, camera: PlateCamera) -> ImageError:
    words, entries = _WHERE_TO_FIND[name]
    option = "--" + name.replace("_", "-")
    places = ", ".join([f"{entries} in the header", *camera.asked])
    return ImageError(
        f"states no {words} (looked for {places})", remedy=f"give it with {option}"
    )
