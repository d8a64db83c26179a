"""Aberrations that are turned off by name on the command line: a gain of 0 each."""

from dataclasses import dataclass
from typing import Annotated

import typer

from lensfit._strict import did_you_mean
from lensfit.preset.aberration_knobs import AberrationKnobs

_GAIN = "_gain"
_SINGLE = tuple(
    name.removesuffix(_GAIN)
    for name in AberrationKnobs.__struct_fields__
    if name.endswith(_GAIN)
)
_SEVERAL = {
    "lateral_colour": ("lateral_red", "lateral_blue"),
    "astigmatism": ("astigmatism_sagittal", "astigmatism_tangential"),
    "vignetting": (
        "natural_vignetting",
        "optical_vignetting",
        "mechanical_vignetting",
    ),
}
_AS_OPTIONS = [name.replace("_", "-") for name in (*_SINGLE, *_SEVERAL)]
"""As the options of their gains are spelt; the underscores of knobs do too."""


@dataclass(frozen=True)
class DisableGroup:
    """What is turned off."""

    disable: Annotated[
        str | None,
        typer.Option(
            help="Aberrations to turn off, whatever their gain: coma,spherical,...",
            rich_help_panel="Aberrations",
        ),
    ] = None

    @property
    def gains(self) -> dict[str, object]:
        """The knobs that this sets.

        Raises
        ------
        typer.BadParameter : It was given, and names nothing or no aberration.
        """
        if self.disable is None:
            return {}
        names = [n.strip().replace("-", "_") for n in self.disable.split(",")]
        names = [n.lower() for n in names if n]
        if not names:
            raise typer.BadParameter("names no aberration", param_hint="--disable")
        for name in names:
            if name not in (*_SINGLE, *_SEVERAL):
                said = name.replace("_", "-")
                hint = did_you_mean(said, _AS_OPTIONS)
                raise typer.BadParameter(
                    f'there is no aberration "{said}"; {hint}', param_hint="--disable"
                )
        return {
            f"{single}{_GAIN}": 0.0
            for name in names
            for single in _SEVERAL.get(name, (name,))
        }
