"""Sources of the knobs of a plate, and their priority.

Sources, the one that counts most first:

1. the command line (``--coma-gain``)
2. ``[knobs]`` of the settings files, the nearest file first
3. the plate's header (``lensfit/coma_gain``, with any prefix)
4. the preset

Each knob is decided separately; an invalid value is an error only where it counts.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from lensfit.errors import ImageError, LensfitError, PresetError, SettingsError
from lensfit.plate.camera.plate_camera import option_of
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
    for said in [*_stated(stated), *_of_settings(settings), *_of_header(header)]:
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


def _stated(stated: Mapping[str, object]) -> Iterator[_Stated]:
    for name, value in stated.items():
        yield _Stated(name, value, option_of(name), PresetError, "options", None)


def _of_settings(settings: Settings) -> Iterator[_Stated]:
    for name, value in settings.knobs.items():
        file = settings.knob_paths[name]
        remedy = f"mend it under [knobs], or give {option_of(name)}"
        if name not in GROUP_OF:
            remedy = "mend it under [knobs]"
        source = f"{file} [knobs]"
        yield _Stated(name, value, source, SettingsError, file, remedy)


def _of_header(header: Mapping[str, object]) -> Iterator[_Stated]:
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
