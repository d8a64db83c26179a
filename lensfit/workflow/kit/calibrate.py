"""Calibrate every lens of a kit: as many at once as there are cores, or on a farm.

Each lens' results are an atomic output set, with a record of the outcome beside them. A
run that is killed loses only the lenses that it was working on; the next run goes on
with those. The kit's page is made again after every lens.

The job of a render farm has a task for each lens, then one for the kit's page. It is an
Open Job Description template, as `lensfit submit` writes one: the folder of the kit
file and that of the results are PATH parameters, so that a farm may map them. Every
task writes the page with the results so far, so that it exists even if a lens fails and
the farm never starts the last step.
"""

import multiprocessing
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from lensfit._strict import did_you_mean
from lensfit.cores import available_cores
from lensfit.errors import LensfitError, ShootError
from lensfit.plate.farm.job import absolute
from lensfit.plate.farm.job_files import (
    checked_template,
    path_parameter,
    text_parameter,
)
from lensfit.progress import Progress, silent
from lensfit.workflow.calibration.results_folder import require_writable_folder
from lensfit.workflow.kit.kit_file import Kit
from lensfit.workflow.kit.kit_page import write_kit
from lensfit.workflow.kit.lens_record import fingerprint, is_done, write_record
from lensfit.workflow.kit.lens_shoot import lens_shoot
from lensfit.workflow.kit.lens_worker import Job, work


def kit_template(
    kit: Kit, out: Path, lenses: list[str], effort: str
) -> tuple[dict[str, Any], dict[str, str]]:
    """The template, and the values of its parameters that are paths.

    Parameters
    ----------
    lenses : Folders of those to calibrate.

    Raises
    ------
    OutputError : The job is larger than the specification allows.
    """
    definitions = [
        text_parameter(
            "Command", "lensfit", "The program, where it is not on the PATH"
        ),
        path_parameter("KitFolder", "DIRECTORY", "IN", "Folder of the kit file"),
        text_parameter("KitName", kit.path.name, "Name of the kit file"),
        path_parameter("Out", "DIRECTORY", "OUT", "Folder for the results"),
        text_parameter("Effort", effort, "Speed against error of the blur"),
    ]
    paths = {
        "KitFolder": str(absolute(kit.path.parent)),
        "Out": str(absolute(out)),
    }
    file = "{{Param.KitFolder}}/{{Param.KitName}}"
    one = ["kit", "calibrate", file, "--out={{Param.Out}}", "--workers=1"]
    one += ["--effort={{Param.Effort}}", "--lens={{Task.Param.Lens}}"]
    lens = {"name": "Lens", "type": "STRING", "range": lenses}
    calibrate = {
        "name": "calibrate",
        "parameterSpace": {"taskParameterDefinitions": [lens]},
        "script": _script(one),
    }
    page = {
        "name": "page",
        "dependencies": [{"dependsOn": "calibrate"}],
        "script": _script(["kit", "report", file, "--out={{Param.Out}}"]),
    }
    name = f"lensfit kit {kit.path.stem}"
    return checked_template(name, definitions, [calibrate, page], lenses, paths), paths


def _script(words: list[str]) -> dict[str, Any]:
    return {"actions": {"onRun": {"command": "{{Param.Command}}", "args": words}}}


_STAGE = "lenses"
_Worker = tuple[BaseProcess, Connection]


def calibrate_kit(
    kit: Kit,
    out: str | Path,
    *,
    only: Sequence[str] = (),
    effort: str = "normal",
    workers: int | None = None,
    again: bool = False,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Calibrate the lenses of a kit and write its page.

    Parameters
    ----------
    out : Folder of the results; each lens has one of its own in it.
    only : Lenses to calibrate, by folder, name or serial; all if empty.
    effort : As of `lensfit.workflow.calibrate.calibrate`.
    workers : Processes at once; one per core, and no more than lenses, if None.
    again : Calibrate those too that are done.

    Returns
    -------
    The kit's table, as in kit.json. A lens that failed has its reason under "failed".

    Raises
    ------
    LensfitError : No lens is called so, or the folder cannot be written.
    """
    out = Path(out)
    chosen = chosen_lenses(kit, only)
    require_writable_folder(out)
    waiting: list[Job] = []
    for folder in chosen:
        job = _job(kit, folder, out, effort, again)
        if job is not None:
            waiting.append(job)
    done = len(chosen) - len(waiting)
    progress(_STAGE, done, len(chosen))
    table = write_kit(kit, out)
    if waiting:
        count = min(workers or available_cores(), len(waiting))
        for _ in _outcomes(waiting, count):
            done += 1
            progress(_STAGE, done, len(chosen))
            table = write_kit(kit, out)
    return table


def chosen_lenses(kit: Kit, requested: Sequence[str]) -> list[str]:
    """Folders of the lenses that are meant.

    Raises
    ------
    ShootError : One is none of the kit.
    """
    if not requested:
        return list(kit.lenses)
    known: dict[str, list[str]] = {}
    for folder, lens in kit.lenses.items():
        for word in {folder, lens.name, lens.serial or folder}:
            known.setdefault(word.lower(), []).append(folder)
    chosen: list[str] = []
    for word in requested:
        if word.lower() not in known:
            raise ShootError(
                f'no lens of the kit is "{word}"',
                where=kit.path,
                remedy=did_you_mean(word, list(kit.lenses)),
            )
        chosen += known[word.lower()]
    return list(dict.fromkeys(chosen))


def _job(kit: Kit, folder: str, out: Path, effort: str, again: bool) -> Job | None:
    """What is left to do of a lens; None of one that is done, or cannot begin."""
    results = out / folder
    try:
        made_of = fingerprint(lens_shoot(kit, folder).shoot(), effort)
    except LensfitError as error:
        write_record(results, "", str(error), None)
        return None
    if not again and is_done(results, made_of):
        return None
    return kit.path, folder, results, made_of, effort


def _outcomes(waiting: list[Job], count: int) -> Iterator[str | None]:
    """Of every lens as it ends: why it failed, or None."""
    with _pool(count) as pool:
        busy: dict[Connection, Job] = {}
        index: dict[Connection, int] = {}
        free = list(enumerate(pool))
        while waiting or busy:
            while waiting and free:
                k, (_, connection) = free.pop(0)
                job = waiting.pop(0)
                connection.send(job)
                busy[connection], index[connection] = job, k
            for answered in wait(list(busy)):
                assert isinstance(answered, Connection)
                job, k = busy.pop(answered), index.pop(answered)
                try:
                    yield answered.recv()
                except (EOFError, OSError):
                    died = "the process that calibrated it died; run again with fewer "
                    died += "--workers, if memory ran out"
                    write_record(job[2], job[3], died, None)
                    answered.close()
                    pool[k] = _start(k, count)
                    yield died
                free.append((k, pool[k]))


@contextmanager
def _pool(count: int) -> Iterator[list[_Worker]]:
    pool: list[_Worker] = []
    try:
        for k in range(count):
            pool.append(_start(k, count))
        yield pool
    except BaseException:
        for process, _ in pool:
            process.kill()  # nothing that they write is there before it is whole
        raise
    finally:
        for _, connection in pool:
            connection.close()
        for process, _ in pool:
            process.join()


def _start(index: int, count: int) -> _Worker:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=work, args=(theirs, index, count), daemon=True)
    process.start()
    theirs.close()  # so that the death of the process ends what is read from it
    return process, ours
