"""`lensfit submit`: hand a sequence to a render farm."""

import json
import shlex
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from lensfit.cli.apply import apply
from lensfit.cli.groups import takes_groups
from lensfit.cli.groups.handed_on import hands_on
from lensfit.cli.groups.library import PRESET_HELP, LibraryGroup
from lensfit.workflow.farm.job import FarmJob, HandedOption, absolute, farm_job


class Farm(StrEnum):
    """Which farm the job is written for."""

    openjd = "openjd"
    opencue = "opencue"


_OWN = ("preset", "plates", "out", "frames", "library", "as_json")
_SUFFIX = {Farm.openjd: "openjd.json", Farm.opencue: "outline"}


@hands_on(
    apply,
    except_for=(
        "preset",
        "plates",
        "out",
        "frames",
        "library",
        "as_json",
        "progress_as",
    ),
    files=("filter_image",),
)
@takes_groups
def submit(
    preset: Annotated[str, typer.Argument(help=PRESET_HELP)],
    plates: Annotated[
        str, typer.Argument(help="EXR plate, or plate.####.exr for a sequence")
    ],
    *,
    library: LibraryGroup,
    out: Annotated[Path, typer.Option("--out", help="Folder for the results")],
    frames: Annotated[
        str | None, typer.Option(help="Frames of the sequence: 1001-1100x2,1200")
    ] = None,
    chunk: Annotated[int, typer.Option(min=1, help="Frames of one task")] = 10,
    to: Annotated[
        Farm,
        typer.Option(help="Open Job Description, or OpenCue (needs its PyOutline)"),
    ] = Farm.openjd,
    write: Annotated[
        Path | None,
        typer.Option(help="File of the job; apply.openjd.json or apply.outline in OUT"),
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Say the outcome as JSON")
    ] = False,
    handed: tuple[HandedOption, ...],
) -> None:
    """Write a job for a render farm: `lensfit apply` on chunks of a sequence.

    Takes every option of apply and hands it on as given. The job is an Open Job
    Description template with its paths in a file beside it, or an outline of OpenCue;
    nothing is rendered here. A task that is run again skips its finished frames. A lens
    of the library is handed on as it is now; one with edits is written beside the job.

    Example: lensfit submit takumar/preset.json plate.####.exr --out rendered --chunk 20
    """
    from lensfit.cli._door import say_note

    path = absolute(write or out / f"apply.{_SUFFIX[to]}")
    file, edited = library.file(preset)
    job = farm_job(
        file,
        plates,
        out,
        frames,
        chunk=chunk,
        options=handed,
        preset_beside=None if edited is None else path.with_suffix(".preset.json"),
    )
    if edited is not None:
        from lensfit.preset.store import save_preset

        save_preset(edited.taken_out("lensfit submit"), job.preset)
    files, run = _written(job, to, path)
    if job.gaps is not None:
        say_note(job.gaps)
    if job.missing:
        say_note(
            f"frames {job.missing} do not exist yet; their tasks fail without them"
        )
    if as_json:
        said = {
            "files": [str(file) for file in files],
            "tasks": len(job.chunks) or 1,
            "run": run,
        }
        typer.echo(json.dumps(said, indent=1))
        return
    for file in files:
        typer.echo(file)
    count = len(job.chunks) or 1
    typer.echo(f"{count} {'task' if count == 1 else 'tasks'}; {shlex.join(run)}")


def _written(job: FarmJob, to: Farm, path: Path) -> tuple[list[Path], list[str]]:
    """The files of the job, and the command that runs or submits it."""
    if to is Farm.opencue:
        from lensfit.workflow.farm.opencue_outline import write_outline

        write_outline(job, path)
        return [path], ["pycuerun", str(path)]
    from lensfit.atomic import write_text_atomic
    from lensfit.workflow.farm.openjd_template import openjd_template

    template, paths = openjd_template(job)
    beside = path.with_name(f"{path.stem}.parameters.json")
    write_text_atomic(path, json.dumps(template, indent=1))
    write_text_atomic(beside, json.dumps(paths, indent=1))
    return [path, beside], ["openjd", "run", str(path), "-p", f"file://{beside}"]
