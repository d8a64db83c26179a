"""`lensfit kit`: a set of lenses planned, checked and calibrated as one job.

`plan` and `check` list what to photograph of every lens and what is missing;
`calibrate`, `report` and `submit` measure the lenses, as many at once as there are
cores or on a render farm, and write their page.
"""

import json
import shlex
from collections.abc import Container
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lensfit.cli._door import say_error
from lensfit.cli._options import EffortOption, one_of_or_none
from lensfit.cli._terminal import progress_bars, say_line
from lensfit.preset.verdict_levels import LEVELS, is_at_least

if TYPE_CHECKING:
    from lensfit.workflow.kit.lens_shoot import LensShoot

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

_MOST_NAMES = 6


def plan(
    kit: KitPath,
    out: Annotated[
        Path | None,
        typer.Option("--out", help="File of the take lists to print (HTML)"),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """List every view to photograph, with slate, exposure and expected blur.

    Chart distances that are not stated are those where its pattern fills the frame.
    With --out it also writes a page for each lens, to print and tick off.

    Example: lensfit kit plan kit.toml --out takes.html
    """
    from lensfit.workflow.kit.checklist import checklist, duration_text
    from lensfit.workflow.kit.kit_file import load_kit
    from lensfit.workflow.kit.kit_plan import kit_plan, plan_as_json

    described = load_kit(kit)
    plans = kit_plan(described)
    if out is not None:
        from lensfit.atomic import write_text_atomic

        write_text_atomic(out, checklist(described, plans))
    if as_json:
        typer.echo(json.dumps(plan_as_json(plans)))
        return
    for one in plans:
        distances = ", ".join(f"{mm:.0f}" for mm in one.target_distance_mm)
        say_line(
            f"{one.folder}: {one.lens.title}, {len(one.views)} views, about "
            f"{duration_text(one.seconds)}, chart at {distances} mm"
        )
        for view in one.views:
            say_line("  " + _view_line(view))
        for note in one.notes:
            say_line(f"  ! {note}")
    views = sum(len(one.views) for one in plans)
    seconds = sum(one.seconds for one in plans)
    say_line(f"{len(plans)} lenses, {views} views, about {duration_text(seconds)}")
    if out is not None:
        say_line(str(out))


def _view_line(view) -> str:
    from lensfit.workflow.kit.checklist import chart_text, shutter_text

    words = [
        f"{view.slate:<28}",
        f"{view.focal_length_mm:g} mm",
        f"f/{view.f_number:<4g}",
        f"focus {view.mark:<8}",
        f"{chart_text(view):<17}",
    ]
    if view.shutter_s is not None:
        words.append(f"{shutter_text(view.shutter_s):>8}")
    if view.blur_px is not None:
        words.append(
            f"blur {view.blur_px:.1f} px" + ", dots overlap" * view.overlapping
        )
    return "  ".join(words).rstrip()


def check(
    kit: KitPath,
    lens: Lenses = None,
    look: Annotated[
        bool,
        typer.Option(
            "--look", help="Judge every photograph too, as lensfit check does"
        ),
    ] = False,
    as_json: AsJson = False,
) -> None:
    """List the missing views of every lens, and the files that are no view.

    Exit code 1 if a view is missing or, with --look, should be shot again.

    Example: lensfit kit check kit.toml
    """
    from lensfit.workflow.kit.calibrate import chosen_lenses
    from lensfit.workflow.kit.kit_file import load_kit
    from lensfit.workflow.kit.lens_shoot import lens_shoot

    described = load_kit(kit)
    rows, missing = [], 0
    for folder in chosen_lenses(described, lens or []):
        found = lens_shoot(described, folder)
        again = _looked_at(found) if look else []
        missing += len(found.missing) + len(again)
        rows.append(
            {
                "folder": folder,
                "name": described.lenses[folder].title,
                "planned": len(found.planned.takes),
                "missing": list(found.missing),
                "photographs": {k: str(v) for k, v in found.photographs.items()},
                "beside": list(found.beside),
                "shoot_again": again,
            }
        )
        if not as_json:
            _print_missing(rows[-1])
    if as_json:
        typer.echo(json.dumps({"lenses": rows}))
    if missing:
        raise typer.Exit(1)


def _looked_at(found: "LensShoot") -> list[dict[str, str]]:
    """Photographs that should be shot again, each with its reason."""
    from lensfit.errors import LensfitError
    from lensfit.workflow.check.session import CheckSession

    if not found.photographs:
        return []
    shoot, again = found.shoot(), []
    session = CheckSession(shoot)
    for take in shoot.takes:
        try:
            judged = session.check(shoot.image_path(take))
        except LensfitError as error:
            again.append({"image": take.image, "why": str(error)})
            continue
        bad = [one for one in judged.problems if one.level == "bad"]
        if bad:
            why = f"{bad[0].text}; {bad[0].remedy}"
            again.append({"image": take.image, "why": why})
    return again


def _print_missing(row: dict) -> None:
    missing, planned = row["missing"], row["planned"]
    line = (
        f"{row['folder']}: {row['name']}, {planned - len(missing)} of {planned} views"
    )
    if missing:
        more = len(missing) - _MOST_NAMES
        names = ", ".join(missing[:_MOST_NAMES]) + (f" and {more} more" * (more > 0))
        line += f"; missing: {names}"
    say_line(line)
    for one in row["shoot_again"]:
        say_line(f"  x {one['image']}: {one['why']}")
    for name in row["beside"]:
        say_line(f"  ! {name} is no view of the plan; name it after one, or remove it")


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
    from lensfit.workflow.kit.kit_page import write_kit

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
    from lensfit.workflow.kit.calibrate import chosen_lenses, kit_template
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


app = typer.Typer(
    no_args_is_help=True,
    help="Plan, check and calibrate a kit of lenses as one job.",
)
for command in (plan, check, calibrate, report, submit):
    app.command()(command)
