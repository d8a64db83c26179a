"""The camera in a plate's header: the last of its sources, and restated in a result.

Where entries of one header state different values of a quantity, the better entry
counts (`lensfit.io.camera.header_entries` has the order), and a note names the others.
Entries that mean different things may differ:

- a focal length as on the barrel, and that of the pinhole, which is the principal
  distance and grows with focusing
- EXIF's 35 mm equivalent is whole millimetres

Parts of one picture have headers of their own, and must not state different cameras.

A plate's own entries stay where they state that camera. Entries that state another one,
which an option or a sidecar overruled, are set to it, each in its own unit and type, so
that no program reads another camera than the picture has.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
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
from lensfit.io.exr import ExrPart
from lensfit.io.metadata import (
    RECORDED,
    WHOLE_SENSOR,
    HeaderWord,
    camera_words,
    recorded_size,
    whole_sensor_mm,
)
from lensfit.plate.camera.plate_camera import (
    SPELT,
    BadEntry,
    PlateCamera,
    SourcedValue,
    option_of,
)

HEADER = 1_000_000
"""Its rank; there are fewer files."""
_OPTIONS = {
    "focal_length_mm": "give --focal-length-mm",
    "f_number": "give --f-number",
    "t_number": "give --f-number",
    "focus_distance_mm": "give --focus-distance-mm",
    "sensor_width_mm": "give --sensor-width-mm",
    "sensor_height_mm": "give sensor_height_mm under [camera] of lensfit.toml",
}


def add_header(
    words: dict[str, list[SourcedValue]],
    stated: Mapping[str, Sequence[HeaderWord]],
    better: Collection[str],
) -> dict[str, tuple[BadEntry, ...]]:
    """Add what a header tells to `words`, behind those of better sources; what it
    cannot mean is returned.

    Parameters
    ----------
    words : By quantity, the word that counts most first.
    stated : By the header.
    better : Quantities that another source tells.
    """
    bad: dict[str, tuple[BadEntry, ...]] = {}
    for name, entries in stated.items():
        known = name in better
        for value, key, of_pinhole in entries:
            if not isinstance(value, ImageError):
                known_value = SourcedValue(
                    value, key, rank=HEADER, of_pinhole=of_pinhole
                )
                words.setdefault(name, []).append(known_value)
                known = True
                continue
            remedy = _OPTIONS.get(name, "take it out of the header")
            error = ImageError(value.what, remedy=f"mend it, or {remedy}")
            bad[name] = (*bad.get(name, ()), BadEntry(error, key, not known))
    return bad


ROUNDING = 0.02
"""Relative: f/2.8 is f/2.83, and cameras round distances."""
_BREATHING = 0.15
_WHOLE_MILLIMETRES = "FocalLengthIn35mmFilm"
_COARSE = 0.06


def contradictions(
    words: Mapping[str, Sequence[SourcedValue]], rank: int
) -> Iterator[tuple[str, str]]:
    """The quantity and a sentence, for each that a header tells differently.

    Parameters
    ----------
    words : By quantity, what was said of it, the one that counts first.
    rank : Of what the header says; what a better source tells is no matter.
    """
    for name, spelt in SPELT.items():
        known = words.get(name)
        if not known or known[0].rank != rank:
            continue
        others = [k for k in known[1:] if k.rank == rank and _contradicts(known[0], k)]
        if others:
            said = ", ".join(_spelt(name, other) for other in others)
            yield (
                name,
                f"the header contradicts itself on the {spelt}: "
                f"{_spelt(name, known[0])} is used, not {said} "
                f"({option_of(name)} states another)",
            )


def whole_sensor_note(
    header: Mapping[str, object], known: SourcedValue | None
) -> str | None:
    """A sentence where a header states the whole sensor, and no part of it that could
    have been recorded.

    Parameters
    ----------
    known : Width of the frame on the sensor, if a source states it.
    """
    whole = whole_sensor_mm(header)
    if whole is None:
        return None
    shown = f"{WHOLE_SENSOR} ({whole[0]:g} x {whole[1]:g} mm)"
    if known is None:
        return (
            f"{shown} is the whole sensor, and the header does not state the part of "
            f"it that was recorded ({' with '.join(RECORDED)}, or --sensor-width-mm)"
        )
    if known.rank == HEADER and float(known.value) > whole[0] * (1 + ROUNDING):
        return (
            f"the header contradicts itself on the sensor width: "
            f"{_spelt('sensor_width_mm', known)} is used, which is more than {shown} "
            "has (--sensor-width-mm states another)"
        )
    return None


def refuse_several_cameras(parts: Sequence[ExrPart], camera: PlateCamera) -> None:
    """Refuse parts of one view of which a value counts that another part contradicts.

    Parameters
    ----------
    camera : Of the picture; values that it has from better sources than its header
        decide for all parts.

    Raises
    ------
    ImageError : Two parts state different values.
    """
    stated = [
        (part, camera_words(part.attributes, None, camera.settings.aliases))
        for part in parts
    ]
    for name, spelt in SPELT.items():
        known = camera.known.get(name)
        if known is None or known.rank != HEADER:
            continue
        values = [
            (part, word.value, word.of_pinhole)
            for part, words in stated
            for word in words.get(name, ())[:1]
            if isinstance(word.value, float)
        ]
        for part, value, of_pinhole in values[1:]:
            first, counts, of_first = values[0]
            if of_pinhole == of_first and differ(counts, value):
                raise ImageError(
                    f"states two cameras: the {spelt} of part {part.name!r} is "
                    f"{value:g}, that of part {first.name!r} is {counts:g}",
                    remedy=f"state the views of its parts in the header entry view, "
                    f"or give one {spelt} with {option_of(name)}",
                )


def _contradicts(one: SourcedValue, other: SourcedValue) -> bool:
    keys = tuple(known.source.rpartition("/")[2] for known in (one, other))
    allowed = ROUNDING
    if one.of_pinhole != other.of_pinhole:
        allowed = _BREATHING
    elif _WHOLE_MILLIMETRES in keys:
        allowed = _COARSE
    return differ(float(one.value), float(other.value), allowed)


def differ(one: float, other: float, allowed: float = ROUNDING) -> bool:
    """Whether two statements of a quantity differ by more than a share of the larger;
    infinity differs from all else."""
    if one == other:
        return False
    larger = max(abs(one), abs(other))
    return abs(one - other) > allowed * larger or larger == float("inf")


def _spelt(name: str, known: SourcedValue) -> str:
    value = known.value
    number = f"{value:g}" if isinstance(value, float) else str(value)
    return f"{known.source} ({number}{' mm' if name.endswith('_mm') else ''})"


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
            entry = _converted_like(found[key], value / alias.factor)
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


def _converted_like(entry: object, value: float) -> object | None:
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
