"""Rendering on the command line: the plate's depth, effects, accuracy, processor cores.

An aberration that is turned off by name has a gain of 0.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import typer

from lensfit._strict import did_you_mean
from lensfit.preset.knob_groups import AberrationKnobs

if TYPE_CHECKING:
    from lensfit.plate.plate_depth import DepthOptions
    from lensfit.rendering.render_stages import Switches

_DEPTH_PANEL = "Depth"


class KindName(StrEnum):
    """How depth is measured, as in `lensfit.io.depth_channel`."""

    perpendicular = "perpendicular"
    ray = "ray"
    inverse = "inverse"
    normalised = "normalised"


@dataclass(frozen=True)
class DepthGroup:
    """What is known better than the plate says it."""

    depth_channel: Annotated[
        str | None,
        typer.Option(
            help="Channel of the depth; Z, depth.Z and the like are found",
            rich_help_panel=_DEPTH_PANEL,
        ),
    ] = None
    depth_unit: Annotated[
        str | None,
        typer.Option(
            help="mm, cm, m, in, ft, or millimetres of one unit; metres if unknown",
            rich_help_panel=_DEPTH_PANEL,
        ),
    ] = None
    depth_kind: Annotated[
        KindName | None,
        typer.Option(
            help="How depth is measured; along the optical axis if unknown",
            rich_help_panel=_DEPTH_PANEL,
        ),
    ] = None
    depth_near: Annotated[
        float | None,
        typer.Option(
            help="Distance at 0 of a normalised depth, in its unit",
            rich_help_panel=_DEPTH_PANEL,
        ),
    ] = None
    depth_far: Annotated[
        float | None,
        typer.Option(
            help="Distance at 1 of a normalised depth, in its unit",
            rich_help_panel=_DEPTH_PANEL,
        ),
    ] = None
    edge_mask: Annotated[
        str | None,
        typer.Option(
            help="Thin Cryptomatte objects to blur as layers of their own: NAME,NAME",
            rich_help_panel=_DEPTH_PANEL,
        ),
    ] = None

    edge_matte: Annotated[
        str | None,
        typer.Option(
            help="Channel that covers such objects, in place of their names",
            rich_help_panel=_DEPTH_PANEL,
        ),
    ] = None

    def options(self) -> "DepthOptions":
        """As plates are rendered with it."""
        from lensfit.plate.plate_depth import DepthOptions

        return DepthOptions(
            self.depth_channel,
            self.depth_unit,
            None if self.depth_kind is None else self.depth_kind.value,
            self.depth_near,
            self.depth_far,
        )

    @property
    def edge_objects(self) -> tuple[str, ...]:
        """Names in the edge mask.

        Raises
        ------
        typer.BadParameter : It was given, and names nothing; or a matte was given too.
        """
        if self.edge_mask is None:
            return ()
        if self.edge_matte is not None:
            raise typer.BadParameter(
                "goes without --edge-matte", param_hint="--edge-mask"
            )
        names = tuple(n.strip() for n in self.edge_mask.split(",") if n.strip())
        if not names:
            raise typer.BadParameter("names no object", param_hint="--edge-mask")
        return names


_PANEL = "Effects"

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


ToleranceOption = Annotated[
    float,
    typer.Option(
        min=1e-7, max=1.0, help="Accepted rms error of the picture, display-referred"
    ),
]
CoresOption = Annotated[
    int | None,
    typer.Option(
        "--cores",
        min=1,
        envvar="LENSFIT_CORES",
        help="Processor cores that it takes at most; all that there are if left out",
    ),
]


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
