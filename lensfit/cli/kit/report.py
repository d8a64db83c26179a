"""`lensfit kit report`: the page of a kit, made again."""

from pathlib import Path
from typing import Annotated

import typer

from lensfit.cli.kit.options import AsJson, KitPath, RequireOfAll
from lensfit.cli.kit.outcome import show_kit


def report(
    kit: KitPath,
    out: Annotated[Path, typer.Option("--out", help="Folder of the results")],
    require: RequireOfAll = None,
    as_json: AsJson = False,
) -> None:
    """Write kit.html and kit.json again, from what is calibrated so far.

    Example: lensfit kit report kit.toml --out results
    """
    from lensfit.workflow.kit.kit_file import load_kit
    from lensfit.workflow.kit.write_kit import write_kit

    show_kit(write_kit(load_kit(kit), out), out, as_json, require)
