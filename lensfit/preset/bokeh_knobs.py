"""Knobs of the opening, and so of the shape of lights out of focus."""

from typing import Annotated

from msgspec import Meta, Struct


class BokehKnobs(
    Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True, kw_only=True
):
    """Knobs of the opening; neutral as they stand here."""

    blades: (
        Annotated[
            int,
            Meta(ge=0, le=16, description="Blades of the stop, 0 for a round one"),
        ]
        | None
    ) = None
