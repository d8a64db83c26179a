"""Options that benchmarks share."""

from pathlib import Path
from typing import Annotated

import typer

SetsFolder = Annotated[
    Path, typer.Option("--data", help="Folder with real/ and oracle/")
]
OnlySet = Annotated[
    str | None, typer.Option("--only", help="Name of the one set to measure")
]
JsonFolder = Annotated[Path | None, typer.Option("--out", help="Folder for JSON")]
SmallFrames = Annotated[
    bool, typer.Option("--quick", help="Leave frames of 8 megapixels out")
]
AsJson = Annotated[bool, typer.Option("--json", help="Print the figures as JSON")]
