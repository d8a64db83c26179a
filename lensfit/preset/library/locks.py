"""Which keys of a preset may be changed: knobs always, measured values if unlocked.

Measured values are locked, so that a number in a preset is the measured one unless an
edit records why not. Records of the measurement (provenance, quality, the state of an
entry) cannot be changed at all: changing them would make them false.
"""

from typing import Literal

from lensfit._strict import did_you_mean
from lensfit.errors import PresetError
from lensfit.preset.entry import Entry
from lensfit.preset.knobs import GROUP_OF
from lensfit.preset.library.key_path import IDENTITY, Step
from lensfit.preset.schema import Preset

Lock = Literal["free", "locked", "record"]

_RECORDS = ("schema", "conventions", "provenance", "saved")
_RECORDS_OF_ENTRY = ("terms", "covariance", "quality")


def lock_of(steps: tuple[Step, ...]) -> Lock:
    """How a key is locked."""
    names = [step for step in steps if isinstance(step, str)]
    if names[0] == "knobs":
        return "free"
    if names[0] in _RECORDS or names == ["entries"]:
        return "record"
    if names[0] == "entries" and (len(names) < 2 or names[1] in _RECORDS_OF_ENTRY):
        return "record"
    if "covariance" in names:
        return "record"
    if len(names) > 1 and names[-1] in IDENTITY.get(names[-2], ()):
        return "record"
    return "locked"


def check_lock(key: str, steps: tuple[Step, ...], *, unlocked: bool) -> None:
    """Refuse to change what an edit may not.

    Parameters
    ----------
    steps : The key, parted (`lensfit.preset.library.key_path`).
    unlocked : Whether somebody said that a measured value is to be changed.

    Raises
    ------
    PresetError : The key is unknown, a record, or measured and not unlocked.
    """
    if steps[0] not in Preset.__struct_fields__:
        known = [*GROUP_OF, *Preset.__struct_fields__]
        hint = did_you_mean(str(steps[0]), known)
        raise PresetError(f'unknown key "{key[:80]}"; {hint}')
    lock = lock_of(steps)
    if lock == "record":
        raise PresetError(
            f"{key}: is a record of the measurement, which no edit changes",
            remedy=f"change knobs, or values of an entry ({', '.join(_VALUES)})",
        )
    if lock == "locked" and not unlocked:
        raise PresetError(
            f"{key}: was measured and is locked",
            remedy="turn a knob, or change it with --unlock, which the edit records",
        )


_VALUES = tuple(
    name
    for name in Entry.__struct_fields__
    if name not in (*_RECORDS_OF_ENTRY, *IDENTITY["entries"])
)
