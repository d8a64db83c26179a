"""Entries of one header that state different values of a quantity.

The better entry counts (`lensfit.io.camera.aliases` has the order), and a note names
the others. Entries that mean different things may differ:

- the standard's focal lengths: of the barrel (nominal), of the lens (effective) and of
  the pinhole, which is the principal distance and grows with focusing
- what was recorded is a part of the sensor (``sensorOverallDimensions``)
- EXIF's 35 mm equivalent is whole millimetres
"""

from collections.abc import Iterator, Mapping, Sequence

from lensfit.plate.camera.sourced_value import SourcedValue
from lensfit.plate.camera.spelling import SPELT, option_of

_ROUNDING = 0.02
"""Relative: f/2.8 is f/2.83, and cameras round distances."""
_OF_ONE_LENS = ("pinholeFocalLength", "effectiveFocalLength", "nominalFocalLength")
_BREATHING = 0.15
_WHOLE_SENSOR = "sensorOverallDimensions"
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


def _contradicts(one: SourcedValue, other: SourcedValue) -> bool:
    a, b = float(one.value), float(other.value)
    if a == b:
        return False
    keys = tuple(known.source.rpartition("/")[2] for known in (one, other))
    allowed = _ROUNDING
    if set(keys) <= set(_OF_ONE_LENS):
        allowed = _BREATHING
    elif _WHOLE_MILLIMETRES in keys:
        allowed = _COARSE
    elif keys[1] == _WHOLE_SENSOR and a < b:
        return False
    return abs(a - b) > allowed * max(abs(a), abs(b)) or a + b == float("inf")


def _spelt(name: str, known: SourcedValue) -> str:
    value = known.value
    number = f"{value:g}" if isinstance(value, float) else str(value)
    return f"{known.source} ({number}{' mm' if name.endswith('_mm') else ''})"
