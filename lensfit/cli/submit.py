"""`lensfit submit`: hand a sequence to a render farm."""

import json
import shlex
from collections.abc import Callable
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lensfit.cli._terminal import say_line
from lensfit.cli.apply import apply, apply_options
from lensfit.cli.groups import options_in_groups, takes_groups
from lensfit.cli.groups.forwarded_options import hands_on
from lensfit.cli.groups.library import PRESET_HELP, LibraryGroup
from lensfit.plate.farm.job import (
    FarmJob,
    HandedOption,
    HostNeeds,
    absolute,
    farm_job,
    with_needs,
)

if TYPE_CHECKING:
    from lensfit.preset.schema import Preset

TASK_CORES = 4
"""Of a task, where nobody states them."""


class Farm(StrEnum):
    """Which farm the job is written for."""

    openjd = "openjd"
    opencue = "opencue"


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
    plan: Annotated[
        bool,
        typer.Option(
            "--plan/--no-plan",
            help="Ask for hosts with the memory that `lensfit plan` expects",
        ),
    ] = True,
    memory_gib: Annotated[
        float | None,
        typer.Option(
            min=0.1, help="Memory of a host, in place of what the plan expects, GiB"
        ),
    ] = None,
    handed: tuple[HandedOption, ...],
    taken: dict[str, Any],
) -> None:
    """Write a job for a render farm: `lensfit apply` on chunks of a sequence.

    Takes every option of apply and hands it on as given. The job is an Open Job
    Description template with its paths in a file beside it, or an outline of OpenCue;
    nothing is rendered here. Its tasks take --cores cores (4 if left out) and request
    the memory that `lensfit plan` expects of the first frame. A task that is run again
    skips its finished frames. A lens of the library is handed on as it is now; one with
    edits is written beside the job.

    Example: lensfit submit takumar/preset.json plate.####.exr --out rendered --chunk 20
    """
    path = absolute(write or out / f"apply.{_SUFFIX[to]}")
    file, edited = library.file(preset)
    beside = None if edited is None else path.with_suffix(".preset.json")
    job = farm_job(
        file, plates, out, frames, chunk=chunk, options=handed, preset_beside=beside
    )
    needs, notes = None, []
    if plan or memory_gib is not None:
        # The preset as its tasks will read it, with the edits of its levels.
        read = partial(_preset, file) if edited is None else lambda: edited.preset
        needs, notes = _needs(read, job, taken, memory_gib)
    job = with_needs(job, needs)
    if edited is not None:
        from lensfit.preset.store import save_preset

        save_preset(edited.taken_out("lensfit submit"), job.preset)
    files, run = _written(job, to, path)
    _say(job, notes, files, run, as_json)


def _preset(file: Path) -> "Preset":
    from lensfit.preset.store import load_preset

    return load_preset(file)


def _needs(
    preset: "Callable[[], Preset]",
    job: FarmJob,
    taken: dict[str, Any],
    memory_gib: float | None,
) -> tuple[HostNeeds | None, list[str]]:
    """What a task needs, and remarks; nothing where its first frame cannot be planned,
    which may well be since it does not exist yet.
    """
    from lensfit.errors import LensfitError

    cores, workers = taken["cores"] or TASK_CORES, taken["workers"]
    if memory_gib is not None:
        return HostNeeds(cores, memory_gib), []
    from lensfit.workflow.plan_plate import plan_plate

    options = apply_options(**options_in_groups(apply, taken))
    try:
        found, _ = plan_plate(
            preset(), job.plates, options, cores=max(1, cores // workers)
        )
    except LensfitError as error:
        return None, [f"no memory is asked for, since nothing is planned: {error}"]
    return HostNeeds(cores, workers * found.gib), []


def _say(
    job: FarmJob, notes: list[str], files: list[Path], run: list[str], as_json: bool
) -> None:
    """The files of the job, what it asks for and how it is run."""
    from lensfit.cli._door import say_note

    for note in filter(None, (job.gaps, *notes)):
        say_note(note)
    if job.missing:
        say_note(
            f"frames {job.missing} do not exist yet; their tasks fail without them"
        )
    tasks, needs = len(job.chunks) or 1, job.needs
    if as_json:
        said = {"files": [str(file) for file in files], "tasks": tasks, "run": run}
        if needs is not None:
            said["host"] = {"cores": needs.cores, "gib": round(needs.gib, 3)}
        typer.echo(json.dumps(said, indent=1))
        return
    for file in files:
        say_line(file)
    needed = f" of {needs.cores} cores and {needs.gib:.1f} GiB" if needs else ""
    say_line(f"{tasks} {'task' if tasks == 1 else 'tasks'}{needed}; {shlex.join(run)}")


def _written(job: FarmJob, to: Farm, path: Path) -> tuple[list[Path], list[str]]:
    """The files of the job, and the command that runs or submits it."""
    if to is Farm.opencue:
        from lensfit.plate.farm.job_files import write_outline

        write_outline(job, path)
        return [path], ["pycuerun", str(path)]
    from lensfit.atomic import write_text_atomic
    from lensfit.plate.farm.job_files import openjd_template

    template, paths = openjd_template(job)
    beside = path.with_name(f"{path.stem}.parameters.json")
    write_text_atomic(path, json.dumps(template, indent=1))
    write_text_atomic(beside, json.dumps(paths, indent=1))
    return [path, beside], ["openjd", "run", str(path), "-p", f"file://{beside}"]
