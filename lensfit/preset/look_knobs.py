"""Knobs of the looks that no photograph of a grid shows: filters, glass, exposure."""

from typing import Annotated

from msgspec import Meta, Struct


class LookKnobs(
    Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True, kw_only=True
):
    """Knobs of the look; neutral as they stand here."""

    bloom_gain: Annotated[
        float, Meta(ge=0, le=1, description="Share of the light that blooms")
    ] = 0.0
