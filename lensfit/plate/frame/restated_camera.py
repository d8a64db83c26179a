"""One camera in a result's header: the one that was rendered with.

A plate's own entries stay where they state that camera. Entries that state another one,
which an option or a sidecar overruled, are set to it, each in its own unit and type, so
that no program reads another camera than the picture has.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lensfit.errors import ImageError
from lensfit.io.camera.header_entries import (
    ALIASES,
    SENSOR_WIDTH_KEY,
    Alias,
    entry_quantity,
    is_entry_of_alias,
)
from lensfit.io.metadata import RECORDED, camera_words, recorded_size
from lensfit.plate.camera.header_source import ROUNDING

_SAME = 1e-4
_LOST_LIGHT = 1.5
"""T-stop over f-number: no lens loses more than a stop of light."""


@dataclass(frozen=True)
class AppliedCamera:
    """The camera that a picture was rendered with; None where nothing depends on it.

    Attributes
    ----------
    focal_length_mm : As on the ring.
    pinhole_focal_length_mm : Of the pinhole with the picture's angle of view.
    sensor_size_mm : Width and height of what the display window spans.
    """

    focal_length_mm: float
    pinhole_focal_length_mm: float
    f_number: float | None
    focus_distance_mm: float | None
    sensor_size_mm: tuple[float, float]

    def value(self, name: str, alias: Alias) -> float | None:
        """What an entry of a quantity should state."""
        width_mm, height_mm = self.sensor_size_mm
        return {
            "focal_length_mm": self.pinhole_focal_length_mm
            if alias.of_pinhole
            else self.focal_length_mm,
            "f_number": self.f_number,
            "focus_distance_mm": self.focus_distance_mm,
            "sensor_width_mm": width_mm,
            "sensor_height_mm": height_mm,
        }.get(name)


def restated(
    attributes: Mapping[str, object],
    camera: AppliedCamera,
    aliases: Mapping[str, Sequence[Alias]],
) -> dict[str, object]:
    """A header whose camera entries state one camera.

    Parameters
    ----------
    attributes : Of the plate.
    aliases : Entries of the project's settings, by quantity.
    """
    found = dict(attributes)
    for name in ALIASES:
        for alias, key in _entries(found, name, aliases):
            value = camera.value(name, alias)
            if value is None or _states(name, alias, key, found[key], value):
                continue
            entry = _in_type_of(found[key], value / alias.factor)
            found.pop(key)
            if entry is not None:
                found[key] = entry
    found = _without_other_stop(found, camera.f_number)
    return _with_sensor(found, camera.sensor_size_mm[0], aliases)


def _entries(
    header: Mapping[str, object], name: str, aliases: Mapping[str, Sequence[Alias]]
) -> Iterator[tuple[Alias, str]]:
    """The entries of a quantity, each with the alias that it counts by."""
    seen = set()
    for alias in (*aliases.get(name, ()), *ALIASES[name]):
        for key in [key for key in header if is_entry_of_alias(key, alias.key)]:
            if key not in seen:
                seen.add(key)
                yield alias, key


def _states(name: str, alias: Alias, key: str, entry: object, value: float) -> bool:
    """Whether an entry states a value already, or nothing."""
    try:
        known = entry_quantity(name, key, entry, alias)
    except ImageError:
        return False
    return known is None or known == value or abs(known - value) <= _SAME * value


def _in_type_of(entry: object, value: float) -> object | None:
    """The value as the entry had it; None where its type holds no such number."""
    if isinstance(entry, str):
        return f"{value:.7g}"
    if isinstance(entry, float | int | np.floating):
        return float(value)
    return None


def _without_other_stop(
    header: dict[str, object], f_number: float | None
) -> dict[str, object]:
    """Without the T-stop of another f-number."""
    if f_number is None:
        return header
    kept = dict(header)
    for alias, key in _entries(header, "t_number", {}):
        try:
            stop = entry_quantity("t_number", key, header[key], alias)
        except ImageError:
            continue
        low, high = f_number * (1 - ROUNDING), f_number * _LOST_LIGHT
        if stop is not None and not low <= stop <= high:
            del kept[key]
    return kept


def _with_sensor(
    header: dict[str, object], width_mm: float, aliases: Mapping[str, Sequence[Alias]]
) -> dict[str, object]:
    """With the width that the frame spans, unless the recorded photosites state it."""
    recorded = recorded_size(header)
    if recorded is not None and (
        isinstance(recorded.size_mm, ImageError)
        or abs(recorded.size_mm[0] - width_mm) > _SAME * width_mm
    ):
        header = {k: v for k, v in header.items() if k not in RECORDED}
    words = camera_words(header, None, aliases).get("sensor_width_mm")
    return header if words else header | {SENSOR_WIDTH_KEY: width_mm}
