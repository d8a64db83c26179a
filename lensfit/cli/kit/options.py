"""Arguments that the commands of a kit share."""

from pathlib import Path
from typing import Annotated

import typer

from lensfit.cli._levels import LEVELS, one_of_or_none

KitPath = Annotated[Path, typer.Argument(metavar="KIT", help="Kit file (TOML)")]
Lenses = Annotated[
    list[str] | None,
    typer.Option(
        "--lens", help="Only this lens: folder, name or serial; may be repeated"
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print as JSON")]
RequireOfAll = Annotated[
    str | None,
    typer.Option(
        help="Exit with 1 if a lens' verdict is lower: " + " | ".join(LEVELS),
        callback=one_of_or_none(LEVELS),
    ),
]
