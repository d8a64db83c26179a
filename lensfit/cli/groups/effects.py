"""Effects of the lens on the command line: which are left out."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from lensfit.rendering.render_stages import Switches

_PANEL = "Effects"


def _left_out(effect: str, option: str) -> typer.models.OptionInfo:
    return typer.Option(option, help=f"Leave {effect} out", rich_help_panel=_PANEL)


@dataclass(frozen=True)
class EffectsGroup:
    """Switches of what the preset knows."""

    no_distortion: Annotated[bool, _left_out("distortion", "--no-distortion")] = False
    no_lateral_colour: Annotated[
        bool, _left_out("lateral colour", "--no-lateral-colour")
    ] = False
    no_falloff: Annotated[bool, _left_out("fall-off", "--no-falloff")] = False
    no_defocus: Annotated[bool, _left_out("depth of field", "--no-defocus")] = False

    def switches(self) -> "Switches":
        """As plates are rendered with it."""
        from lensfit.rendering.render_stages import Switches

        return Switches(
            distortion=not self.no_distortion,
            lateral_colour=not self.no_lateral_colour,
            falloff=not self.no_falloff,
            defocus=not self.no_defocus,
        )
