"""`lensfit kit submit`: hand a kit to a render farm."""

import json
import shlex
from pathlib import Path
from typing import Annotated

import typer

from lensfit.cli._console import say_line
from lensfit.cli._efforts import EffortOption
from lensfit.cli.kit.options import AsJson, KitPath, Lenses


def submit(
    kit: KitPath,
    out: Annotated[Path, typer.Option("--out", help="Folder for the results")],
    lens: Lenses = None,
    effort: EffortOption = "normal",
    write: Annotated[
        Path | None, typer.Option(help="File of the job; kit.openjd.json in OUT")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Write an Open Job Description job: a task for each lens, then the kit's page.

    Nothing is calibrated here. A task that is run again skips its lens if it is done.

    Example: lensfit kit submit kit.toml --out results
    """
    from lensfit.atomic import write_text_atomic
    from lensfit.workflow.kit.calibrate import chosen_lenses
    from lensfit.workflow.kit.farm import kit_template
    from lensfit.workflow.kit.kit_file import load_kit

    described = load_kit(kit)
    lenses = chosen_lenses(described, lens or [])
    template, paths = kit_template(described, out, lenses, effort)
    path = write or out / "kit.openjd.json"
    beside = path.with_name(f"{path.stem}.parameters.json")
    write_text_atomic(path, json.dumps(template, indent=1))
    write_text_atomic(beside, json.dumps(paths, indent=1))
    run = ["openjd", "run", str(path), "-p", f"file://{beside.absolute()}"]
    if as_json:
        said = {"files": [str(path), str(beside)], "tasks": len(lenses), "run": run}
        typer.echo(json.dumps(said, indent=1))
        return
    for file in (path, beside):
        say_line(str(file))
    say_line(f"{len(lenses)} tasks and the page; {shlex.join(run)}")
