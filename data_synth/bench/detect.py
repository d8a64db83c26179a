"""Detection and indexing by themselves, beside OpenCV's blob detector.

The peer finds blobs and numbers none of them: there is no other detector of dots that
numbers a grid of unknown size, which is why its count is given with its time.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from data_synth.bench.machine import machine
from data_synth.bench.points import agreement
from data_synth.bench.result import bench_result
from data_synth.bench.rows import Row, as_tables
from data_synth.bench.sets import (
    LEAST_PART_OF_MARKS,
    BenchSet,
    chosen_sets,
    shoot_of,
)
from data_synth.bench.times import timed
from lensfit.detect.observations import Observations
from lensfit.errors import LensfitError
from lensfit.io.image import read_photograph
from lensfit.progress import Progress, silent
from lensfit.workflow.calibration.observe import observe_shoot
from lensfit.workflow.shoot.shoot_file import Shoot


def bench_detect(
    data: str | Path,
    out_dir: str | Path | None = None,
    *,
    only: str | Sequence[str] | None = None,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Find and number the marks of every set, or of one or several.

    Returns
    -------
    "rows" (marks against what independent code found; seconds), "errors", "machine".
    Where the data folder has the points that other code found (points/), marks are
    compared with them one by one.

    Raises
    ------
    LensfitError : There is no set of that name, or the results cannot be written.
    """
    on, rows, errors = machine(), [], []
    chosen = chosen_sets(only)
    for done, one in enumerate(chosen):
        progress("sets", done, len(chosen))
        try:
            rows += _rows(one, shoot_of(one, Path(data)), Path(data))
        except LensfitError as error:
            errors.append(f"{one.name}: {error}")
    progress("sets", len(chosen), len(chosen))
    return bench_result("detect", on, out_dir, rows=as_tables(rows), errors=errors)


def _rows(one: BenchSet, shoot: Shoot, data: Path) -> list[Row]:
    found, times = timed(lambda: observe_shoot(shoot, None, silent))
    takes = [o.take for o in found if o.take is not None]
    marks = float(sum(len(take.observations) for take in takes))
    blobs, of_blobs = timed(lambda: _blobs(shoot), 1)
    least = None
    if one.marks is not None:
        least = float(np.ceil(LEAST_PART_OF_MARKS * one.marks))
    peers = {"OpenCV blobs, not numbered": float(blobs)}
    seconds = times.as_peers() | {"OpenCV blobs, s": of_blobs.first_s}
    what = "reading, finding, numbering, s"
    return [
        Row(one.name, "marks found and numbered", marks, least, one.marks, peers, True),
        *_against_points(one, [take.observations for take in takes], data),
        Row(one.name, what, times.steady_s, one.detect_bar_s, peers=seconds),
    ]


def _against_points(one: BenchSet, found: list[Observations], data: Path) -> list[Row]:
    """One by one with those of other code, where its file is there."""
    path = data / "points" / (one.points or "")
    if one.points is None or not path.is_file() or len(found) != 1:
        return []
    agreed = agreement(found[0], path)
    if agreed is None:
        return []
    least = LEAST_PART_OF_MARKS
    peers = {"apart, px": agreed.apart_px, "marks it lacks": float(agreed.more)}
    wrong = float(agreed.misnumbered)
    return [
        Row(one.name, "recall of the other code's marks", agreed.recall, least,
            peers=peers, least=True),
        Row(one.name, "marks numbered otherwise", wrong, 0.0),
    ]  # fmt: skip


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
