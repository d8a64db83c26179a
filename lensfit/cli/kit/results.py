"""`lensfit kit calibrate`, `report`, `submit`: the lenses of a kit, and their page.

Lenses are calibrated here, as many at once as there are cores, or by a render farm.
"""

import json
import shlex
from collections.abc import Container
from pathlib import Path
from typing import Annotated, Any

import typer

from lensfit.cli._bars import progress_bars
from lensfit.cli._console import say_line
from lensfit.cli._door import say_error
from lensfit.cli._efforts import EffortOption
from lensfit.cli.kit.options import AsJson, KitPath, Lenses, RequireOfAll
from lensfit.preset.verdict import is_at_least


def calibrate(
    kit: KitPath,
    out: Annotated[Path, typer.Option("--out", help="Folder for the results")],
    lens: Lenses = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Lenses at once; one per core by default")
    ] = None,
    effort: EffortOption = "normal",
    again: Annotated[
        bool, typer.Option("--again", help="Calibrate those too that are done")
    ] = False,
    require: RequireOfAll = None,
    as_json: AsJson = False,
) -> None:
    """Measure every lens of a kit; run again, it goes on where it was stopped.

    Each lens gets a folder as calibrate writes it; kit.html and kit.json beside them
    hold all lenses. A lens that fails does not stop the others: it is named in a line,
    and the exit code is 1.

    Example: lensfit kit calibrate kit.toml --out results
    """
    from lensfit.workflow.kit.calibrate import calibrate_kit, chosen_lenses
    from lensfit.workflow.kit.kit_file import load_kit

    described = load_kit(kit)
    with progress_bars() as progress:
        table = calibrate_kit(
            described,
            out,
            only=lens or [],
            effort=effort,
            workers=workers,
            again=again,
            progress=progress,
        )
    chosen = set(chosen_lenses(described, lens or []))
    show_kit(table, out, as_json, require, chosen)


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


def show_kit(
    table: dict[str, Any],
    out: Path,
    as_json: bool,
    require: str | None,
    only: Container[str] | None = None,
) -> None:
    """A line for each lens, then the files; the exit code is 1 when a lens failed, or
    is not calibrated though it was asked for, or is below the level required.

    Parameters
    ----------
    only : Folders of the lenses that were asked for; None for all.
    """
    from lensfit.report.markup import number
    from lensfit.workflow.kit.kit_page import summary

    lenses = table["lenses"]
    if as_json:
        typer.echo(json.dumps(table))
    else:
        say_line(summary(lenses))
        for lens in lenses:
            judged = lens.get("verdict") or {}
            level = judged.get("level") or lens["state"]
            accuracy = number(judged.get("accuracy_px"), "px", 2)
            say_line(f"{lens['folder']:<28} {level:<14} {accuracy}")
        for name in ("kit.html", "kit.json"):
            say_line(str(out / name))
    bad = False
    for lens in lenses:
        if only is not None and lens["folder"] not in only:
            continue
        why = _why_not(lens, require)
        if why is not None:
            say_error(f"{lens['folder']}: {why}")
            bad = True
    if bad:
        raise typer.Exit(1)


def _why_not(lens: dict[str, Any], require: str | None) -> str | None:
    if lens["failed"]:
        return str(lens["failed"])
    judged = lens.get("verdict")
    if require is None:
        return None
    if judged is None:
        return "not calibrated yet"
    if is_at_least(judged["level"], require):  # pyright: ignore[reportArgumentType]
        return None
    return f"the verdict is {judged['level']}, below {require}: {judged['headline']}"
