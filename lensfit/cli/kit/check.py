"""`lensfit kit check`: what is missing in the folders of a kit."""

import json
from typing import TYPE_CHECKING, Annotated

import typer

from lensfit.cli._console import say_line
from lensfit.cli.kit.options import AsJson, KitPath, Lenses

if TYPE_CHECKING:
    from lensfit.workflow.kit.lens_shoot import LensShoot

_MOST_NAMES = 6


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
