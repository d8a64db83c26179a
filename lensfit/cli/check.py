"""`lensfit check`: photographs judged while the camera still stands there."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lensfit.cli._terminal import say_line

if TYPE_CHECKING:
    from lensfit.workflow.check.check_records import Check
    from lensfit.workflow.check.session import CheckSession


def check(
    images: Annotated[
        list[Path] | None, typer.Argument(help="Photographs, in the order taken")
    ] = None,
    shoot: Annotated[
        Path | None,
        typer.Option("--shoot", help="Plan (shoot file): targets, views, statements"),
    ] = None,
    watch: Annotated[
        Path | None,
        typer.Option("--watch", help="Check every photograph that arrives here"),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for a picture of each check")
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print one line of JSON per photograph")
    ] = False,
) -> None:
    """Judge photographs of a chart before the camera moves on.

    Finds the chart as `lensfit calibrate` will, and shows how much of the frame it
    covers, how it is exposed, how sharp each part is, whether anything moved, on which
    side of focus it is, and which views of the plan are missing. With --shoot alone it
    checks every view that is there. Exit code 1 if a photograph should be shot again.

    Example: lensfit check IMG_0042.dng --shoot shoot.toml
    Example: lensfit check --watch tethered --shoot shoot.toml --out checks
    """
    if not images and shoot is None and watch is None:
        raise typer.BadParameter("give photographs, --shoot or --watch")
    from lensfit.workflow.check.session import CheckSession
    from lensfit.workflow.shoot.shoot_file import load_shoot

    described = None if shoot is None else load_shoot(shoot)
    session = CheckSession(described, out)
    bad = False
    for path in _paths(session, images or [], watch):
        bad |= not _check_and_print(session, path, as_json)
    if bad:
        raise typer.Exit(1)


def _paths(
    session: "CheckSession", images: list[Path], watch: Path | None
) -> Iterator[Path]:
    """Those given, else those of the plan; then those that arrive, until Ctrl-C."""
    yield from images
    if watch is not None:
        from lensfit.workflow.check.photographs import new_photographs

        yield from new_photographs(watch)
    elif not images and session.shoot is not None:
        from lensfit.workflow.check.photographs import photographs_of_plan

        yield from photographs_of_plan(session.shoot)


def _check_and_print(session: "CheckSession", path: Path, as_json: bool) -> bool:
    """Check one and print it: whether it may stay as it is."""
    from lensfit.cli._door import say_error
    from lensfit.errors import LensfitError

    try:
        judged = session.check(path)
    except LensfitError as error:
        say_error(str(error))
        return False
    if as_json:
        _print_json(session, judged)
    else:
        _print_lines(session, judged)
    return judged.level != "bad"


def _print_json(session: "CheckSession", judged: "Check") -> None:
    import json
    from dataclasses import asdict

    views = [asdict(view) for view in session.plan]
    typer.echo(json.dumps(judged.as_json() | {"plan": views}))


def _print_lines(session: "CheckSession", judged: "Check") -> None:
    from lensfit.workflow.check.sentences import plan_sentence, sentences

    say_line(f"{judged.image}: {judged.level}")
    for name, text in sentences(judged):
        say_line(f"  {name:<10} {text}")
    if session.plan:
        say_line(f"  {'plan':<10} {plan_sentence(session.plan)}")
    if judged.picture is not None:
        say_line(f"  {'picture':<10} {judged.picture}")
    for problem in judged.problems:
        sign = "x" if problem.level == "bad" else "!"
        say_line(f"  {sign} {problem.text}; {problem.remedy}")
