"""The frames of a batch: rendered, skipped or failed, here or by other processes.

Each of several processes has its own lens, JAX and cores. Processes are started afresh
(a forked JAX hangs). Where the system allows, each is bound to its share of the cores,
which bounds the threads of JAX, OpenCV and OpenEXR. If a process dies, for instance
killed for memory, its present frame fails and the others take over its share; if the
whole run is killed, none of them stays.

Each process has a pipe of its own. The queues of a process pool need named semaphores
of the system, which a killed run leaves behind: Python then removes them, with a
warning that looks like a failure.
"""

import multiprocessing
import signal
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import NamedTuple

from lensfit.cores import available_cores, bind_to_share_of_cores, limit_cores
from lensfit.errors import ImageError, LensfitError, error_at_frame, sentence_of
from lensfit.io.exr import ExrPart
from lensfit.plate.apply_options import ApplyOptions
from lensfit.plate.frame.end_with_parent import end_with_parent
from lensfit.plate.frame.provenance import Fingerprint, write_with_digest
from lensfit.plate.frame.renderer import FrameRenderer, with_fingerprint
from lensfit.preset.schema import Preset


@dataclass(frozen=True)
class FrameOutcome:
    """What became of a frame.

    Attributes
    ----------
    target : The result; None if there is none.
    skipped : It was finished before.
    failure : Why there is none, as one line that names the frame.
    notes : What was noted so far.
    size_px : Width and height of the plate's display window; None of one that failed.
    """

    target: Path | None = None
    skipped: bool = False
    failure: str | None = None
    notes: tuple[str, ...] = ()
    size_px: tuple[int, int] | None = None


def apply_frame(renderer: FrameRenderer, path: Path, target: Path) -> FrameOutcome:
    """Render a frame to its place, unless it is there as it would be rendered now."""
    try:
        made_of = renderer.fingerprint(path)
        found = ()
        if not renderer.options.overwrite:
            found = renderer.finished(path, target, made_of)
        parts = found or _write_frame(renderer, path, target, made_of)
    except (LensfitError, ValueError, MemoryError, ArithmeticError) as error:
        failure = error_line(error, path)
        return FrameOutcome(failure=failure, notes=tuple(renderer.notes))
    window = parts[0].display_window
    return FrameOutcome(
        target,
        skipped=bool(found),
        notes=tuple(renderer.notes),
        size_px=(window.width, window.height),
    )


def _write_frame(
    renderer: FrameRenderer, path: Path, target: Path, made_of: Fingerprint
) -> tuple[ExrPart, ...]:
    """The headers of the frame that was written."""
    image = with_fingerprint(renderer.render(path), made_of)
    write_with_digest(target, image)
    return image.parts


def error_line(error: Exception, path: Path) -> str:
    """The error as one line, with the frame it happened at."""
    if not isinstance(error, LensfitError):
        return str(ImageError(sentence_of(error), where=path))
    return str(error_at_frame(error, path))


class _Worker(NamedTuple):
    process: BaseProcess
    connection: Connection


@contextmanager
def worker_outcomes(
    preset: Preset,
    options: ApplyOptions,
    pictures: list[Path],
    targets: list[Path | FrameOutcome],
    workers: int,
) -> Iterator[Iterator[tuple[int, FrameOutcome]]]:
    """Frames as processes finish them, with their place in the list.

    Whoever leaves early waits for the frames that are being rendered.

    Parameters
    ----------
    targets : Where each result goes, or what became of a frame already.
    """
    started: list[_Worker] = []
    try:
        for index in range(workers):
            started.append(_start(preset, options, index, workers))
        yield _outcomes_as_finished(
            [one.connection for one in started], pictures, targets
        )
    finally:
        for one in started:
            one.connection.close()
        for one in started:
            one.process.join()


def _outcomes_as_finished(
    free: list[Connection],
    pictures: list[Path],
    targets: Sequence[Path | FrameOutcome],
) -> Iterator[tuple[int, FrameOutcome]]:
    waiting: deque[int] = deque()
    for index, target in enumerate(targets):
        if isinstance(target, FrameOutcome):
            yield index, target
        else:
            waiting.append(index)
    busy: dict[Connection, int] = {}
    while waiting or busy:
        while waiting and free:
            worker, index = free.pop(), waiting.popleft()
            if _takes(worker, (pictures[index], targets[index])):
                busy[worker] = index
            else:
                waiting.appendleft(index)
        if not busy:
            break
        for worker in wait(list(busy)):
            assert isinstance(worker, Connection)
            index = busy.pop(worker)
            try:
                outcome = worker.recv()
                free.append(worker)
            except (EOFError, OSError):
                outcome = _lost(pictures[index])
            if isinstance(outcome, Exception):
                raise outcome
            yield index, outcome
    for index in waiting:
        yield index, _lost(pictures[index])


def _takes(other: Connection, message: object) -> bool:
    """Whether the process at the other end is still there to be told this."""
    try:
        other.send(message)
    except OSError:
        return False
    return True


def _lost(picture: Path) -> FrameOutcome:
    error = ImageError(
        "was not rendered: a worker process died",
        where=picture,
        remedy="run again with fewer --workers, if memory ran out",
    )
    return FrameOutcome(failure=str(error))


def _start(preset: Preset, options: ApplyOptions, index: int, workers: int) -> _Worker:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(
        target=_work, args=(theirs, preset, options, index, workers), daemon=True
    )
    process.start()
    theirs.close()  # so that the death of the process ends what is read from it
    return _Worker(process, ours)


def _work(
    jobs: Connection, preset: Preset, options: ApplyOptions, index: int, workers: int
) -> None:
    """The life of a process: frame after frame, until nobody gives it any."""
    end_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the run that started it hears it too
    _bind_to_cores(index, workers)
    renderer = FrameRenderer(preset, options)
    while (job := _next(jobs)) is not None:
        try:
            outcome = apply_frame(renderer, *job)
        except Exception as error:  # the run that asked has to tell it
            outcome = error
        if not _takes(jobs, outcome):
            return


def _next(jobs: Connection) -> tuple[Path, Path] | None:
    try:
        return jobs.recv()
    except (EOFError, OSError):
        return None


def _bind_to_cores(index: int, workers: int) -> None:
    """Before JAX counts its cores."""
    import cv2
    import OpenEXR

    share_of_limit = max(1, available_cores() // workers)
    bind_to_share_of_cores(index, workers)
    limit_cores(share_of_limit)
    cv2.setNumThreads(available_cores())
    OpenEXR.set_global_thread_count(available_cores())
