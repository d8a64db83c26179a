"""The option for cores: how many of them one run takes."""

from typing import Annotated

import typer

CoresOption = Annotated[
    int | None,
    typer.Option(
        "--cores",
        min=1,
        envvar="LENSFIT_CORES",
        help="Processor cores that it takes at most; all that there are if left out",
    ),
]
