"""Lens state and picture on the command line, for what is handed to other programs."""

from dataclasses import dataclass
from typing import Annotated

import typer


@dataclass(frozen=True)
class StateGroup:
    """Which state of the lens is meant."""

    focal_length_mm: Annotated[
        float | None, typer.Option(help="Of the lens, mm", rich_help_panel="Lens")
    ] = None
    focus_distance_mm: Annotated[
        float | None,
        typer.Option(
            help="Of the lens, mm from the sensor; inf is allowed",
            rich_help_panel="Lens",
        ),
    ] = None
    f_number: Annotated[
        float | None, typer.Option(help="Of the lens", rich_help_panel="Lens")
    ] = None


@dataclass(frozen=True)
class FrameGroup:
    """The picture that the other program sees."""

    size: Annotated[
        str | None,
        typer.Option(
            help="Of the frame, as 4096x3072; that of the photographs by default",
            rich_help_panel="Picture",
        ),
    ] = None
    overscan: Annotated[
        float,
        typer.Option(
            min=0.0,
            max=200.0,
            help="Percent beyond the frame in total: 10 is 5 on each side",
            rich_help_panel="Picture",
        ),
    ] = 0.0
    sensor_width_mm: Annotated[
        float | None,
        typer.Option(
            min=0.01,
            help="Width that the frame spans on the sensor, mm",
            rich_help_panel="Picture",
        ),
    ] = None
