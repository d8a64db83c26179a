"""`lensfit report`: the page and the table of a finished calibration, made again."""

import json
from pathlib import Path
from typing import Annotated

import typer

from lensfit.cli._options import RequireOption, require_level
from lensfit.errors import LensfitError


def report(
    results: Annotated[
        Path,
        typer.Argument(help="Folder of a calibration, or its report.json"),
    ],
    require: RequireOption = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the report as JSON")
    ] = False,
    open_page: Annotated[
        bool, typer.Option("--open", help="Show the page in a browser")
    ] = False,
) -> None:
    """Print the verdict of a calibration, and write its report.html again.

    Example: lensfit report takumar_50
    """
    path = results / "report.json" if results.is_dir() else results
    from lensfit.report.report_page import read_report

    tables = read_report(path)

    import msgspec

    from lensfit.cli._summary import print_files, print_summary
    from lensfit.report.report_page import write_report
    from lensfit.report.verdict import verdict_of

    try:
        judged = msgspec.to_builtins(verdict_of(tables))
        if as_json:
            typer.echo(json.dumps(tables | {"verdict": judged}))
            require_level(judged, require)
            return
        page = write_report(tables, path.parent)
        print_summary(tables)
    except (TypeError, ValueError, LookupError, AttributeError, ArithmeticError) as why:
        raise LensfitError(
            f"holds what no report of lensfit does ({why})",
            where=path,
            remedy="calibrate again",
        ) from why
    print_files(page.parent, {"report": page.name})
    require_level(judged, require)
    if open_page:
        typer.launch(str(page))
