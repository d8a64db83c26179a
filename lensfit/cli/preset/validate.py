"""`lensfit preset validate`: whether presets, change sets and libraries are sound."""

import json
from pathlib import Path
from typing import Annotated

import typer

from lensfit.cli._console import say_line


def validate(
    presets: Annotated[
        list[Path],
        typer.Argument(help="Presets, change sets, folders of lenses or libraries"),
    ],
    as_json: Annotated[bool, typer.Option("--json", help="Print as JSON")] = False,
) -> None:
    """Check presets against the schema; every fault is one line with its key.

    Of a library, every version at the named level and those around it is put together
    and checked.

    Example: lensfit preset validate presets/*.json
    """
    from lensfit.cli._door import say_error
    from lensfit.errors import LensfitError
    from lensfit.preset.library.catalogue import validation_faults

    faults: dict[str, str | None] = {}
    for path in presets:
        try:
            faults |= validation_faults(path)
        except LensfitError as error:
            faults[str(path)] = str(error)
    if as_json:
        typer.echo(json.dumps(faults))
    for name, fault in faults.items():
        if fault is None and not as_json:
            say_line(f"{name}: valid")
    # Edits of a bad version are bad for the same reason, which is said once.
    for fault in dict.fromkeys(filter(None, faults.values())):
        say_error(fault)
    if any(faults.values()):
        raise typer.Exit(1)
