"""The camera state in a header: focal length, stop, focus, sensor.

`lensfit.io.camera.header_entries` names every header entry that is understood, and a
settings file may name more. A header may state a quantity twice; the better entry
counts, and the others are kept, since they may contradict it.

Focus distances in headers are metres, for the standard ``focus`` and for ``lens/focus``
alike. ``lens/aperture`` is the horizontal sensor size; the standard ``aperture`` is the
f-number. EXIF writes 0 for what it does not know, which counts as missing here.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import NamedTuple

from lensfit.errors import ImageError
from lensfit.io.camera.header_entries import (
    ALIASES,
    Alias,
    entry_quantity,
    entry_text,
    is_entry_of_alias,
)
from lensfit.io.camera.quantity import TEXTS
from lensfit.io.header_sensor import SensorSize, exif_sizes, recorded_size


@dataclass(frozen=True)
class CameraState:
    """The camera as a header knows it; None where it says nothing.

    Attributes
    ----------
    t_number : T-stop: the f-number of a lens without losses that lets as much through.
    focus_distance_mm : Focus distance; infinity is allowed.
    sensor_width_mm, sensor_height_mm : The area the picture covers.
    overscan_percent : Rendered beyond the frame, in total, percent of its size.
    sources : For each field that is known, the header entries it came from.
    """

    focal_length_mm: float | None = None
    f_number: float | None = None
    focus_distance_mm: float | None = None
    sensor_width_mm: float | None = None
    sensor_height_mm: float | None = None
    overscan_percent: float | None = None
    t_number: float | None = None
    camera_model: str | None = None
    lens_model: str | None = None
    lens_serial: str | None = None
    sources: Mapping[str, str] = field(default_factory=dict)

    def known(self) -> dict[str, float | str]:
        """The fields that are known, by name, without their sources."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return {k: v for k, v in values.items() if v is not None and k != "sources"}


class HeaderWord(NamedTuple):
    """What one entry (or a few together) says of a quantity.

    Attributes
    ----------
    value : In the unit of its quantity; an error where the entry holds something
        impossible.
    entry : Its name.
    of_pinhole : A focal length of the pinhole, as `Alias.of_pinhole`.
    """

    value: float | str | ImageError
    entry: str
    of_pinhole: bool = False


def camera_words(
    header: Mapping[str, object],
    size_px: tuple[int, int] | None = None,
    aliases: Mapping[str, Sequence[Alias]] | None = None,
) -> dict[str, list[HeaderWord]]:
    """All that a header says of a camera, by field of `CameraState`; of each the entry
    that counts most first, the impossible ones among them.

    Parameters
    ----------
    header : Entries by name, of an EXR file or EXIF.
    size_px : Width and height of the upright picture, pixels; needed to turn EXIF's
        resolution on the sensor, or its 35 mm equivalent, into a sensor size.
    aliases : More entries, by field; they count before the built-in ones.
    """
    own = aliases or {}
    words = {
        name: _values_of_entries(header, name, (*own.get(name, ()), *built_in))
        for name, built_in in ALIASES.items()
    }
    focal = next((w.value for w in words["focal_length_mm"] if _is_good(w)), None)
    exif = exif_sizes(header, size_px, focal if isinstance(focal, float) else None)
    recorded = recorded_size(header)
    sizes = [*([] if recorded is None else [recorded]), *exif]
    widths = words["sensor_width_mm"]
    stated = len(
        _values_of_entries(header, "sensor_width_mm", own.get("sensor_width_mm", ()))
    )
    middle = len(sizes) - len(exif)
    words["sensor_width_mm"] = [
        *widths[:stated],
        *_sides(sizes[:middle], 0),
        *widths[stated:],
        *_sides(exif, 0),
    ]
    words["sensor_height_mm"] = _heights(
        words["sensor_height_mm"], words["sensor_width_mm"], sizes
    )
    return {name: found for name, found in words.items() if found}


def camera_state_from(
    header: Mapping[str, object],
    size_px: tuple[int, int] | None = None,
) -> CameraState:
    """The camera state that a header describes.

    Parameters
    ----------
    header, size_px : As `camera_words` takes them.

    Raises
    ------
    ImageError : An entry that counts holds something impossible, like a focal length
        that is no number or not above zero; the error names it.
    """
    values: dict[str, float | str] = {}
    sources: dict[str, str] = {}
    for name, words in camera_words(header, size_px).items():
        value, entry, _ = words[0]
        if isinstance(value, ImageError):
            raise value
        values[name], sources[name] = value, entry
    return CameraState(**values, sources=sources)  # pyright: ignore[reportArgumentType]


def _is_good(word: HeaderWord) -> bool:
    return not isinstance(word.value, ImageError)


def _values_of_entries(
    header: Mapping[str, object], name: str, aliases: Iterable[Alias]
) -> list[HeaderWord]:
    """Every entry that one of the aliases is_entry_of_alias; none of them twice."""
    found: dict[str, HeaderWord] = {}
    for alias in aliases:
        for key, value in header.items():
            if key in found or not is_entry_of_alias(key, alias.key):
                continue
            try:
                text = name in TEXTS
                known = (
                    entry_text(value)
                    if text
                    else entry_quantity(name, key, value, alias)
                )
            except ImageError as error:
                known = error
            if known is not None:
                found[key] = HeaderWord(known, key, alias.of_pinhole)
    return list(found.values())


def _sides(sizes: Iterable[SensorSize], side: int) -> list[HeaderWord]:
    return [
        HeaderWord(size if isinstance(size, ImageError) else size[side], source)
        for size, source in sizes
    ]


def _heights(
    stated: list[HeaderWord], widths: list[HeaderWord], sizes: list[SensorSize]
) -> list[HeaderWord]:
    """Heights: the one of the size whose width counts stands first, and a size whose
    width does not count tells no height that would."""
    best = next((w.entry for w in widths if _is_good(w)), None)
    first = [size for size in sizes if size.source == best]
    others = [
        size
        for size in sizes
        if size.source != best and not isinstance(size.size_mm, ImageError)
    ]
    heights = [*_sides(first, 1), *stated]
    return [*heights, *_sides(others, 1)] if heights else []
