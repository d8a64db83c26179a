"""`lensfit calibrate`: photographs of grids in; preset, UV maps and report out."""

import json
from pathlib import Path
from typing import Annotated

import typer

from lensfit.cli._door import say_error, say_note
from lensfit.cli._options import EffortOption, RequireOption, require_level
from lensfit.cli._terminal import progress_bars


def calibrate(
    shoot: Annotated[Path, typer.Argument(help="Shoot file (TOML)")],
    out: Annotated[Path, typer.Option("--out", help="Folder for the results")],
    images: Annotated[
        Path | None,
        typer.Option(
            "--images", help="Folder of the photographs; else the shoot file's own"
        ),
    ] = None,
    effort: EffortOption = "normal",
    require: RequireOption = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the report as JSON")
    ] = False,
) -> None:
    """Measure a lens from photographs of grids.

    Writes preset.json, stmaps/*.exr, report.html and report.json into the folder, at
    the end and in place of what an earlier run wrote; a run that fails or is
    interrupted leaves that as it was.
    A photograph that cannot be used is named in one line while the others go on. The
    exit code is 0 when results are written; with --require, 1 if they are not good for
    that.

    Example: lensfit calibrate shoot.toml --out takumar_50
    """
    from lensfit.workflow.shoot.shoot_file import load_shoot

    described = load_shoot(shoot, images)
    for note in described.notes:
        say_note(f"{shoot}: {note}")

    # The heavy part, imported only once there is something to calibrate.
    from lensfit.cli._summary import failed_takes, print_files, print_summary
    from lensfit.workflow.calibrate import calibrate as calibrate_shoot

    with progress_bars() as progress:
        report = calibrate_shoot(described, out, progress=progress, effort=effort)
    if as_json:
        typer.echo(json.dumps(report))
    else:
        print_summary(report)
        print_files(out, report.get("files") or {})
    for line in failed_takes(report):
        say_error(line)
    require_level(report["verdict"], require)
