"""The camera state on the command line: options that count in place of the header."""

from typing import Annotated

import typer

FocalLength = Annotated[float | None, typer.Option(help="In place of the header's, mm")]
FNumber = Annotated[float | None, typer.Option(help="In place of the header's")]
FocusDistance = Annotated[
    float | None,
    typer.Option(help="In place of the header's, mm from the sensor; inf is allowed"),
]
SensorWidth = Annotated[
    float | None, typer.Option(help="Width that the frame spans on the sensor, mm")
]
