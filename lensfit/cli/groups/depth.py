"""Depth on the command line: where a plate keeps it and what its numbers mean."""

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from lensfit.plate.plate_depth import DepthOptions

_PANEL = "Depth"


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
            rich_help_panel=_PANEL,
        ),
    ] = None
    depth_unit: Annotated[
        str | None,
        typer.Option(
            help="mm, cm, m, in, ft, or millimetres of one unit; metres if unknown",
            rich_help_panel=_PANEL,
        ),
    ] = None
    depth_kind: Annotated[
        KindName | None,
        typer.Option(
            help="How depth is measured; along the optical axis if unknown",
            rich_help_panel=_PANEL,
        ),
    ] = None
    depth_near: Annotated[
        float | None,
        typer.Option(
            help="Distance at 0 of a normalised depth, in its unit",
            rich_help_panel=_PANEL,
        ),
    ] = None
    depth_far: Annotated[
        float | None,
        typer.Option(
            help="Distance at 1 of a normalised depth, in its unit",
            rich_help_panel=_PANEL,
        ),
    ] = None
    edge_mask: Annotated[
        str | None,
        typer.Option(
            help="Thin Cryptomatte objects to blur as layers of their own: NAME,NAME",
            rich_help_panel=_PANEL,
        ),
    ] = None

    edge_matte: Annotated[
        str | None,
        typer.Option(
            help="Channel that covers such objects, in place of their names",
            rich_help_panel=_PANEL,
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
