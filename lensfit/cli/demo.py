"""`lensfit demo`: the whole job on a bundled small shoot, in a few minutes."""

from pathlib import Path
from typing import Annotated

import typer

from lensfit.cli._terminal import progress_bars


def demo(
    out: Annotated[Path, typer.Option("--out", help="Folder for the results")] = Path(
        "lensfit_demo"
    ),
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the results as JSON")
    ] = False,
) -> None:
    """Calibrate a bundled small shoot and put its lens on a bundled CG plate.

    Example: lensfit demo --out demo
    """
    from lensfit.workflow.demo import run_demo

    with progress_bars() as progress:
        made = run_demo(out, progress=progress)
    if as_json:
        import json

        paths = {"preset": str(made.preset), "frame": str(made.frame)}
        typer.echo(json.dumps({"report": made.report, **paths}))
        return
    from lensfit.cli._summary import print_files, print_summary

    print_summary(made.report)
    files = made.report.get("files") or {}
    print_files(out, files | {"frame": str(made.frame.relative_to(out))})
