"""A process that calibrates lenses of a kit, one after the other, on its own core.

Processes are started afresh (a forked JAX hangs), and bound to their share of the cores
where the system allows it. If one dies, for instance killed for memory, its present
lens fails; if the whole run is killed, none of them stays.
"""

import os
import signal
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from lensfit.cores import bind_to_share_of_cores
from lensfit.plate.frame.end_with_parent import end_with_parent
from lensfit.workflow.kit.kit_file import load_kit

Job = tuple[Path, str, Path, str, str]
"""Kit file, folder of the lens, folder of its results, fingerprint, effort."""


def work(jobs: Connection, index: int, workers: int) -> None:
    """The life of a process: lens after lens, until nobody gives it any.

    Parameters
    ----------
    jobs : Receives a `Job` each; answers with the reason of a failure, or None.
    index, workers : Which of how many processes it is.
    """
    end_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the run that started it hears it too
    _bind_to_cores(index, workers)
    while (job := _next(jobs)) is not None:
        try:
            jobs.send(calibrate_lens(*job))
        except OSError:
            return


def calibrate_lens(
    kit_file: Path, folder: str, out: Path, made_of: str, effort: str
) -> str | None:
    """Calibrate one lens, keep what became of it, and say why it failed, if it did."""
    from lensfit.errors import LensfitError, sentence_of
    from lensfit.workflow.kit.lens_record import write_record

    try:
        facts = _facts(kit_file, folder, out, effort)
    except LensfitError as error:
        failed = str(error)
    except Exception as error:  # one lens must not take the others with it
        failed = (
            f"{sentence_of(error)}; run lensfit calibrate --debug on its shoot file"
        )
    else:
        write_record(out, made_of, None, facts)
        return None
    write_record(out, made_of, failed, None)
    return failed


def _facts(kit_file: Path, folder: str, out: Path, effort: str) -> dict[str, Any]:
    from lensfit.preset.store import load_preset
    from lensfit.workflow.calibrate import calibrate
    from lensfit.workflow.calibration.results_folder import PRESET
    from lensfit.workflow.kit.lens_record import blur_widths, lens_facts
    from lensfit.workflow.kit.lens_shoot import lens_shoot

    kit = load_kit(kit_file)
    shoot = lens_shoot(kit, folder).shoot()
    report = calibrate(shoot, out, effort=effort)
    widths = blur_widths(load_preset(out / PRESET))
    return lens_facts(kit.lenses[folder], report) | {"blur_widths": widths}


def _next(jobs: Connection) -> Job | None:
    try:
        return jobs.recv()
    except (EOFError, OSError):
        return None


def _bind_to_cores(index: int, workers: int) -> None:
    """Before JAX counts its cores."""
    if hasattr(os, "sched_setaffinity"):
        bind_to_share_of_cores(index, workers)
        import cv2

        cv2.setNumThreads(len(os.sched_getaffinity(0)))
