"""Frames on several processes, each with its own lens, its own JAX and its own cores.

Processes are started afresh (a forked JAX hangs). Where the system allows, each is
bound to its share of the cores, which bounds the threads of JAX, OpenCV and OpenEXR.
A process that dies, killed for memory say, costs its frames a failure, not the batch;
when the whole run is killed, none of them stays.
"""

import multiprocessing
import os
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path

from lensfit.errors import ImageError
from lensfit.preset.schema import Preset
from lensfit.workflow.apply_frame import FrameOutcome, apply_frame
from lensfit.workflow.apply_options import ApplyOptions
from lensfit.workflow.end_with_parent import end_with_parent
from lensfit.workflow.frame_renderer import FrameRenderer

_renderer: FrameRenderer | None = None


@contextmanager
def worker_outcomes(
    preset: Preset,
    options: ApplyOptions,
    pictures: list[Path],
    targets: list[Path | FrameOutcome],
    workers: int,
) -> Iterator[Iterator[tuple[int, FrameOutcome]]]:
    """Frames as processes finish them, with their place in the list.

    Parameters
    ----------
    targets : Where each result goes, or what became of a frame already.
    """
    context = multiprocessing.get_context("spawn")
    counter = context.Value("i", 0)
    pool = ProcessPoolExecutor(
        workers, context, _start_worker, (preset, options, counter, workers)
    )
    try:
        jobs: dict[Future[FrameOutcome], int] = {}
        for index, (path, target) in enumerate(zip(pictures, targets, strict=True)):
            if isinstance(target, Path):
                jobs[pool.submit(_work, path, target)] = index
        yield _finished(jobs, pictures, targets)
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _finished(
    jobs: dict[Future[FrameOutcome], int],
    pictures: list[Path],
    targets: list[Path | FrameOutcome],
) -> Iterator[tuple[int, FrameOutcome]]:
    for index, target in enumerate(targets):
        if isinstance(target, FrameOutcome):
            yield index, target
    for job in as_completed(jobs):
        index = jobs[job]
        try:
            yield index, job.result()
        except BrokenProcessPool:
            error = ImageError(
                "was not rendered: a worker process died",
                where=pictures[index],
                remedy="run again with fewer --workers, if memory ran out",
            )
            yield index, FrameOutcome(failure=str(error))


def _start_worker(preset: Preset, options: ApplyOptions, counter, workers: int) -> None:
    global _renderer
    end_with_parent()
    with counter.get_lock():
        index = counter.value
        counter.value += 1
    _bind_to_cores(index, workers)
    _renderer = FrameRenderer(preset, options)


def _bind_to_cores(index: int, workers: int) -> None:
    """Before JAX counts its cores."""
    import cv2
    import OpenEXR

    cores = os.cpu_count() or 1
    if hasattr(os, "sched_setaffinity"):
        own = sorted(os.sched_getaffinity(0))
        share = own[index % workers :: workers] or [own[index % len(own)]]
        os.sched_setaffinity(0, share)
        cores = len(share)
    cv2.setNumThreads(max(1, min(cores, (os.cpu_count() or 1) // workers)))
    OpenEXR.set_global_thread_count(max(1, cores))


def _work(path: Path, target: Path) -> FrameOutcome:
    assert _renderer is not None
    return apply_frame(_renderer, path, target)
