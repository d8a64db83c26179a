"""All adjustments that an artist may make to a measured lens.

A knob has one name everywhere: in a preset (the block "knobs", only what is not
neutral), on the command line (``--coma-gain``), in the header of a plate
(``lensfit/coma_gain``, with any prefix) and in a settings file (``[knobs]``). A preset
from calibration has neutral knobs, and neutral knobs change no bit.
"""

import difflib
import math
from collections.abc import Mapping
from pathlib import Path

import msgspec
from msgspec import Struct

from lensfit._strict import convert_strictly, did_you_mean
from lensfit.errors import LensfitError, PresetError
from lensfit.preset.knob_groups import AberrationKnobs, BokehKnobs, LookKnobs

Value = float | int | str | bool | None
_PREFIX = "lensfit/"


class Knobs(
    Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True, kw_only=True
):
    """All knobs; `Knobs()` is the lens as it was measured.

    No name stands in two groups, so that a name alone says which knob is meant.
    """

    aberration: AberrationKnobs = AberrationKnobs()
    bokeh: BokehKnobs = BokehKnobs()
    look: LookKnobs = LookKnobs()


NEUTRAL = Knobs()
GROUP_OF: dict[str, str] = {
    name: group
    for group in Knobs.__struct_fields__
    for name in getattr(NEUTRAL, group).__struct_fields__
}
"""The group of every knob, by name."""


def adjusted_knobs(
    knobs: Knobs,
    values: Mapping[str, object],
    *,
    error: type[LensfitError] = PresetError,
    where: str | Path = "knobs",
) -> Knobs:
    """`knobs` with some of them set.

    Parameters
    ----------
    values : By name; numbers may be text, as headers have them.
    error, where : What is raised, and which source it names.

    Raises
    ------
    LensfitError : There is no such knob, or it cannot be set to that.
    """
    tables = msgspec.to_builtins(knobs)
    for name, value in values.items():
        if name not in GROUP_OF:
            hint = did_you_mean(name, list(GROUP_OF))
            raise error(f'there is no knob "{name}"; {hint}', where=where)
        if isinstance(value, str | float) and _is_not_finite(value):
            raise error(f"{name}: {value} is no finite number", where=where)
        tables.setdefault(GROUP_OF[name], {})[name] = value
    return convert_strictly(tables, Knobs, error=error, where=where, lax=True)


def _is_not_finite(value: str | float) -> bool:
    """Whether it reads as a number, but as none that a knob can have."""
    try:
        return not math.isfinite(float(value))
    except ValueError:
        return False


def active_knobs(knobs: Knobs) -> dict[str, Value]:
    """Name and value of every knob that changes something."""
    return {
        name: getattr(getattr(knobs, group), name)
        for name, group in GROUP_OF.items()
        if getattr(getattr(knobs, group), name)
        != getattr(getattr(NEUTRAL, group), name)
    }


def knob_entries(attributes: Mapping[str, object]) -> list[tuple[str, str, object]]:
    """Entries of a header that state a knob: entry, name and value, in its order."""
    return [entry for entry in _knob_entries(attributes) if entry[1] in GROUP_OF]


def misspelt_knob_notes(attributes: Mapping[str, object]) -> tuple[str, ...]:
    """One sentence for each header entry that looks like a knob and is none.

    Headers travel through many programs, and lensfit's own entries stand under the same
    prefix, so that an unknown one is no error.
    """
    slips = []
    for name in dict.fromkeys(name for _, name, _ in _knob_entries(attributes)):
        close = difflib.get_close_matches(name.lower(), GROUP_OF, n=1, cutoff=0.75)
        if name not in GROUP_OF and close:
            slips.append(
                f'the header entry "{_PREFIX}{name}" is no knob and is left out; did '
                f'you mean "{close[0]}"?'
            )
    return tuple(slips)


def _knob_entries(attributes: Mapping[str, object]) -> list[tuple[str, str, object]]:
    """Entries with the prefix of knobs: whole, what follows the prefix, and value."""
    found = []
    for key, value in attributes.items():
        before, prefix, name = key.rpartition(_PREFIX)
        if prefix and (not before or before.endswith("/")):
            found.append((key, name, value))
    return found
