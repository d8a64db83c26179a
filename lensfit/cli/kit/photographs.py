"""`lensfit kit plan`, `check`: what to photograph of every lens, what is missing."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lensfit.cli._console import say_line
from lensfit.cli.kit.options import AsJson, KitPath, Lenses

if TYPE_CHECKING:
    from lensfit.workflow.kit.lens_shoot import LensShoot

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
            say_line("  " + _line(view))
        for note in one.notes:
            say_line(f"  ! {note}")
    views = sum(len(one.views) for one in plans)
    seconds = sum(one.seconds for one in plans)
    say_line(f"{len(plans)} lenses, {views} views, about {duration_text(seconds)}")
    if out is not None:
        say_line(str(out))


def _line(view) -> str:
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
            _print(rows[-1])
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


def _print(row: dict) -> None:
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
