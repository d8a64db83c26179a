"""`lensfit kit plan`: what to photograph of every lens."""

import json
from pathlib import Path
from typing import Annotated

import typer

from lensfit.cli._console import say_line
from lensfit.cli.kit.options import AsJson, KitPath


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
