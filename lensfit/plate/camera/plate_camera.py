"""One plate's camera and knobs from all sources, before the preset is applied.

A quantity has a name in sentences and one as an option, and each value its source.

Sources of the knobs, the one that counts most first:

1. the command line (``--coma-gain``)
2. ``[knobs]`` of the settings files, the nearest file first
3. the plate's header (``lensfit/coma_gain``, with any prefix)
4. the preset

Each knob is decided separately; an invalid value is an error only where it counts.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

from lensfit.errors import ImageError, LensfitError, PresetError, SettingsError
from lensfit.io.metadata import CameraState
from lensfit.plate.camera.settings import Settings
from lensfit.preset.knobs import (
    GROUP_OF,
    NEUTRAL,
    Knobs,
    Value,
    active_knobs,
    adjusted_knobs,
    knob_entries,
)

SPELT = {
    "focal_length_mm": "focal length",
    "f_number": "f-number",
    "focus_distance_mm": "focus distance",
    "sensor_width_mm": "sensor width",
}
"""Those that a frame depends on."""


def option_of(name: str) -> str:
    """The option that states a quantity or a knob."""
    return "--" + name.replace("_", "-")


class SourcedValue(NamedTuple):
    """A value and its source.

    Attributes
    ----------
    value : In the unit of its quantity.
    source : The option, file or header entry, for people.
    from_pupil : A focus distance from the pinhole of the CG camera, which is the
        entrance pupil, rather than from the sensor.
    rank : Place among the sources; less counts more.
    of_pinhole : A focal length of the pinhole with the picture's angle of view, rather
        than as on the barrel or the zoom ring.
    """

    value: float | str
    source: str
    from_pupil: bool = False
    rank: int = 0
    of_pinhole: bool = False


_DECIDING = (
    "focal_length_mm",
    "f_number",
    "t_number",
    "focus_distance_mm",
    "sensor_width_mm",
)
"""Quantities that a frame depends on."""


class BadEntry(NamedTuple):
    """A header entry that holds what it cannot.

    Attributes
    ----------
    error : Which it is, and which option gives the value in its place.
    entry : Its name.
    counts : Nothing better tells the quantity.
    """

    error: ImageError
    entry: str
    counts: bool


@dataclass(frozen=True)
class PlateCamera:
    """All that is known of a plate's camera.

    Attributes
    ----------
    known : By quantity, what counts.
    overruled : By quantity, what does not, in the order in which it would.
    bad : By quantity, the impossible entries of the header; a quantity of which one of
        them counts is not known.
    plate : The plate.
    notes : One sentence for each thing that was assumed.
    searched : The files beside the header, for saying where something was not found.
    settings : The settings that hold for the plate.
    """

    known: Mapping[str, SourcedValue]
    overruled: Mapping[str, tuple[SourcedValue, ...]] = field(default_factory=dict)
    bad: Mapping[str, tuple[BadEntry, ...]] = field(default_factory=dict)
    plate: Path = Path()
    notes: tuple[str, ...] = ()
    searched: tuple[str, ...] = ()
    settings: Settings = field(default_factory=Settings)

    def number(self, name: str) -> float | None:
        """The value of a quantity that is a number."""
        found = self.known.get(name)
        return None if found is None else float(found.value)

    def checked(self) -> "PlateCamera":
        """The same.

        Raises
        ------
        ImageError : An impossible entry stands where something would count on which a
            frame depends.
        """
        needed = [*_DECIDING]
        if "vertical_fov_deg" in self.known:
            needed.append("sensor_height_mm")
        for name in needed:
            for entry in self.bad.get(name, ()):
                if entry.counts:
                    raise entry.error
        return self

    def focused(self, distance: SourcedValue) -> "PlateCamera":
        """The same, focused at a distance that the user picked."""
        return self.with_known("focus_distance_mm", distance)

    def with_known(
        self, name: str, value: SourcedValue, note: str | None = None
    ) -> "PlateCamera":
        """The same with another value of a quantity, and a note on it."""
        notes = self.notes if note is None else (*self.notes, note)
        return replace(self, known={**self.known, name: value}, notes=notes)

    @property
    def state(self) -> CameraState:
        """As a header would say it; a focus distance from the pinhole is not in it."""
        names = CameraState.__dataclass_fields__.keys() - {"sources"}
        kept = {n: k for n, k in self.known.items() if n in names and not k.from_pupil}
        values = {name: known.value for name, known in kept.items()}
        sources = {name: known.source for name, known in kept.items()}
        return CameraState(**values, sources=sources)  # pyright: ignore[reportArgumentType]


class KnobWord(NamedTuple):
    """A value of a knob, and its source."""

    value: Value
    source: str


@dataclass(frozen=True)
class AdjustedKnobs:
    """The knobs and the source of each value.

    Attributes
    ----------
    knobs : All of them.
    known : By name, of every knob that a source states, what counts.
    overruled : By name, what does not, in the order in which it would.
    problems : Words that count and that no knob can have.
    notes : One sentence for each header that states a knob twice.
    """

    knobs: Knobs = NEUTRAL
    known: Mapping[str, KnobWord] = field(default_factory=dict)
    overruled: Mapping[str, tuple[KnobWord, ...]] = field(default_factory=dict)
    problems: tuple[LensfitError, ...] = ()
    notes: tuple[tuple[str, str], ...] = ()

    def checked(self) -> Knobs:
        """The knobs.

        Raises
        ------
        LensfitError : A word that counts is none that the knob can have.
        """
        if self.problems:
            raise self.problems[0]
        return self.knobs


class _Stated(NamedTuple):
    name: str
    value: object
    source: str
    error: type[LensfitError]
    where: str | Path
    remedy: str | None


def knobs_of_plate(
    preset: Knobs,
    header: Mapping[str, object],
    settings: Settings,
    stated: Mapping[str, object],
) -> AdjustedKnobs:
    """The knobs of one plate.

    Parameters
    ----------
    preset : As the preset has them.
    header : Entries of the plate.
    settings : That hold for the plate.
    stated : By the user, by name.
    """
    words: dict[str, list[KnobWord]] = {}
    problems: dict[str, LensfitError] = {}
    for said in [
        *_stated_options(stated),
        *_settings_knobs(settings),
        *_header_knobs(header),
    ]:
        try:
            alone = adjusted_knobs(
                NEUTRAL, {said.name: said.value}, error=said.error, where=said.where
            )
        except LensfitError as error:
            if said.name not in words.keys() | problems.keys():
                problems[said.name] = said.error(
                    error.what, where=error.where, remedy=said.remedy
                )
            continue
        value = getattr(getattr(alone, GROUP_OF[said.name]), said.name)
        words.setdefault(said.name, []).append(KnobWord(value, said.source))
    for name, value in active_knobs(preset).items():
        words.setdefault(name, []).append(KnobWord(value, "preset"))
    known = {n: found[0] for n, found in words.items() if n not in problems}
    first = {name: int(name in known) for name in words}
    return AdjustedKnobs(
        adjusted_knobs(preset, {name: word.value for name, word in known.items()}),
        known,
        {n: tuple(w[first[n] :]) for n, w in words.items() if w[first[n] :]},
        tuple(problems.values()),
        tuple(_contradictions(words, header)),
    )


def _stated_options(stated: Mapping[str, object]) -> Iterator[_Stated]:
    for name, value in stated.items():
        yield _Stated(name, value, option_of(name), PresetError, "options", None)


def _settings_knobs(settings: Settings) -> Iterator[_Stated]:
    for name, value in settings.knobs.items():
        file = settings.knob_paths[name]
        remedy = f"mend it under [knobs], or give {option_of(name)}"
        if name not in GROUP_OF:
            remedy = "mend it under [knobs]"
        source = f"{file} [knobs]"
        yield _Stated(name, value, source, SettingsError, file, remedy)


def _header_knobs(header: Mapping[str, object]) -> Iterator[_Stated]:
    for key, name, value in knob_entries(header):
        where = f"header entry {key!r}"
        remedy = f"mend it, or give {option_of(name)}"
        yield _Stated(name, value, key, ImageError, where, remedy)


def _contradictions(
    words: Mapping[str, list[KnobWord]], header: Mapping[str, object]
) -> Iterator[tuple[str, str]]:
    """The knob and a sentence, for each whose entries in a header differ and count."""
    keys = {key for key, _, _ in knob_entries(header)}
    for name, found in words.items():
        of_header = [word for word in found if word.source in keys]
        others = [word for word in of_header[1:] if word.value != of_header[0].value]
        if others and of_header[0] is found[0]:
            shown = ", ".join(f"{word.source} ({word.value})" for word in others)
            yield (
                name,
                f"the header contradicts itself on {name}: {of_header[0].source} "
                f"({of_header[0].value}) is used, not {shown} ({option_of(name)} "
                "states another)",
            )
