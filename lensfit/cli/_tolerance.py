"""The accepted error of a picture, the same for rendering and for planning it."""

from typing import Annotated

import typer

ToleranceOption = Annotated[
    float,
    typer.Option(
        min=1e-7, max=1.0, help="Accepted rms error of the picture, display-referred"
    ),
]
