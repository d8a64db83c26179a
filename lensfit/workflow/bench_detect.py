"""Detection and indexing by themselves, beside OpenCV's blob detector.

The peer finds blobs and numbers none of them: there is no other detector of dots that
numbers a grid of unknown size, which is why its count is given with its time.
"""

import json
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from lensfit.atomic import write_text_atomic
from lensfit.errors import LensfitError
from lensfit.io.image import read_photograph
from lensfit.progress import Progress, silent
from lensfit.workflow import bench_sets
from lensfit.workflow.bench_rows import Row, as_tables
from lensfit.workflow.bench_sets import BenchSet
from lensfit.workflow.calibration.observe import observe_shoot
from lensfit.workflow.machine import machine
from lensfit.workflow.shoot.file import Shoot

RESULT = "bench_detect.json"
_RUNS = 3


def bench_detect(
    data: str | Path,
    out_dir: str | Path | None = None,
    *,
    only: str | None = None,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Find and number the marks of every set, or of one.

    Returns
    -------
    "rows" (marks against what independent code found; seconds), "errors", "machine".

    Raises
    ------
    LensfitError : There is no set of that name, or the results cannot be written.
    """
    on, rows, errors = machine(), [], []
    chosen = bench_sets.chosen_sets(only)
    for done, one in enumerate(chosen):
        progress("sets", done, len(chosen))
        try:
            rows += _rows(one, bench_sets.shoot_of(one, Path(data)))
        except LensfitError as error:
            errors.append(f"{one.name}: {error}")
    progress("sets", len(chosen), len(chosen))
    result = {
        "schema": "lensfit.bench.1",
        "bench": "detect",
        "machine": on,
        "rows": as_tables(rows),
        "errors": errors,
    }
    if out_dir is not None:
        write_text_atomic(Path(out_dir) / RESULT, json.dumps(result, indent=1))
    return result


def _rows(one: BenchSet, shoot: Shoot) -> list[Row]:
    found, spent = _timed(lambda: observe_shoot(shoot, None, silent))
    takes = [o.take for o in found if o.take is not None]
    marks = float(sum(len(take.observations) for take in takes))
    blobs, blobs_s = _timed(lambda: _blobs(shoot), 1)
    least = None
    if one.marks is not None:
        least = float(np.ceil(bench_sets.LEAST_PART_OF_MARKS * one.marks))
    peers = {"OpenCV blobs, not numbered": float(blobs)}
    seconds = {"OpenCV blobs, s": blobs_s}
    return [
        Row(one.name, "marks found and numbered", marks, least, one.marks, peers, True),
        Row(one.name, "reading, finding, numbering, s", spent, peers=seconds),
    ]


def _timed(work: Callable[[], Any], runs: int = _RUNS) -> tuple[Any, float]:
    """The result, and the median of the wall seconds of several runs."""
    seconds, result = [], None
    for _ in range(runs):
        began = time.perf_counter()
        result = work()
        seconds.append(time.perf_counter() - began)
    return result, statistics.median(seconds)


def _blobs(shoot: Shoot) -> int:
    """How many OpenCV finds, bright or dark, whichever are more."""
    total = 0
    for take in shoot.takes:
        photograph = read_photograph(shoot.image_path(take), take.encoding)
        grey = photograph.luminance_channel
        top = max(float(np.quantile(grey, 0.999)), 1e-9)
        codes = np.clip(255 * np.sqrt(np.maximum(grey, 0) / top), 0, 255)
        picture = codes.astype(np.uint8)
        total += max(_count(picture, colour) for colour in (0, 255))
    return total


def _count(picture: np.ndarray, colour: int) -> int:
    settings = cv2.SimpleBlobDetector.Params()
    settings.filterByColor, settings.blobColor = True, colour
    settings.minArea, settings.maxArea = 4.0, 1e5
    return len(cv2.SimpleBlobDetector.create(settings).detect(picture))
