"""The shape of a plate's pixels on the command line."""

from dataclasses import dataclass
from typing import Annotated

import typer


@dataclass(frozen=True)
class PixelGroup:
    """What counts in place of the header's ``pixelAspectRatio``."""

    pixel_aspect: Annotated[
        float | None,
        typer.Option(
            min=0.1,
            max=10.0,
            help="Width of a pixel over its height as displayed, in place of a "
            "header's; of an anamorphic lens 1 is a desqueezed plate, its squeeze a "
            "squeezed one",
            rich_help_panel="Camera",
        ),
    ] = None
