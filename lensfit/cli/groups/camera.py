"""The camera state on the command line: options that count in place of the header."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from lensfit.workflow.plate_state import StateOverrides

_PANEL = "Camera"


@dataclass(frozen=True)
class CameraGroup:
    """What is known better than the header knows it."""

    focal_length_mm: Annotated[
        float | None,
        typer.Option(help="In place of the header's, mm", rich_help_panel=_PANEL),
    ] = None
    f_number: Annotated[
        float | None,
        typer.Option(help="In place of the header's", rich_help_panel=_PANEL),
    ] = None
    focus_distance_mm: Annotated[
        float | None,
        typer.Option(
            help="In place of the header's, mm from the sensor; inf is allowed",
            rich_help_panel=_PANEL,
        ),
    ] = None
    sensor_width_mm: Annotated[
        float | None,
        typer.Option(
            help="Width that the frame spans on the sensor, mm", rich_help_panel=_PANEL
        ),
    ] = None

    def overrides(self) -> "StateOverrides":
        """As plates are rendered with it."""
        from lensfit.workflow.plate_state import StateOverrides

        return StateOverrides(
            self.focal_length_mm,
            self.f_number,
            self.focus_distance_mm,
            self.sensor_width_mm,
        )
