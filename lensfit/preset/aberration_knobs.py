"""Knobs of the aberrations that were measured: more of one, less, none, or another.

A gain multiplies what the preset says: 1 leaves it, 0 turns it off.
"""

from typing import Annotated

from msgspec import Meta, Struct

Gain = Annotated[float, Meta(ge=-100, le=100)]


class AberrationKnobs(
    Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True, kw_only=True
):
    """Knobs of the aberrations; neutral as they stand here."""

    coma_gain: Annotated[Gain, Meta(description="Gain of coma")] = 1.0
