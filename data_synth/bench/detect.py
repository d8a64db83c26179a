"""Detection and indexing by themselves, beside OpenCV's blob detector.

The peer finds blobs and numbers none of them: there is no other detector of dots that
numbers a grid of unknown size, which is why its count is given with its time.

What other code found on the same photographs is compared too. The other code's points
are a file of arrays: `px` (centres of pixels at whole numbers) and `idx`, the lattice
place of each. Who is right where the two differ nobody knows; so recall is the share of
the other's points that lensfit has too, and a detection counts as misnumbered if its
place contradicts the one lattice symmetry (turn, flip, shift) under which most
detections of both agree.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from data_synth.bench.result import Row, as_tables, bench_result, machine
from data_synth.bench.sets import (
    LEAST_PART_OF_DETECTIONS,
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

_NEAR_PX = 1.0


class Agreement(NamedTuple):
    """How two detections of one photograph agree.

    Attributes
    ----------
    recall : Share of the other's points that have a detection within a pixel.
    apart_px : Median distance of those.
    misnumbered : Detections of them whose place contradicts the rest.
    more : Detections that the other lacks.
    """

    recall: float
    apart_px: float
    misnumbered: int
    more: int


def agreement(found: Observations, path: Path) -> Agreement | None:
    """Against the points in a file; None if they are of several photographs."""
    with np.load(path) as other:
        if len(np.unique(other["view"])) != 1:
            return None
        points, places = other["px"] + 0.5, other["idx"]
    queried = KDTree(found.points_px).query(points)
    apart, nearest = (np.asarray(part) for part in queried)
    near = apart < _NEAR_PX
    mine = np.asarray(found.lattice)[nearest[near]]
    return Agreement(
        recall=float(near.mean()),
        apart_px=float(np.median(apart[near])) if near.any() else float("nan"),
        misnumbered=misnumbered(mine, places[near]),
        more=len(found) - len(np.unique(nearest[near])),
    )


def misnumbered(
    mine: Int[np.ndarray, "detections 2"], other: Int[np.ndarray, "detections 2"]
) -> int:
    """Detections whose places differ under the symmetry that most agree with."""
    if not len(mine):
        return 0
    return min(_contradictions(mine @ turn, other) for turn in _symmetries())


def _contradictions(
    turned: Float[np.ndarray, "detections 2"], other: Int[np.ndarray, "detections 2"]
) -> int:
    shift = np.rint(other - turned).astype(int)
    _, counts = np.unique(shift, axis=0, return_counts=True)
    return len(turned) - int(counts.max())


def _symmetries() -> list[np.ndarray]:
    """Quarter turns and flips of a square lattice."""
    turn = np.array([[0, 1], [-1, 0]])
    turns = [np.linalg.matrix_power(turn, k) for k in range(4)]
    return turns + [one @ np.diag([1, -1]) for one in turns]


def bench_detect(
    data: str | Path,
    out_dir: str | Path | None = None,
    *,
    only: str | Sequence[str] | None = None,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Detect and number the points of every set, or of one or several.

    Returns
    -------
    "rows" (counts against those of independent code; seconds), "errors", "machine".
    Where the data folder has the points that other code found (points/), detections are
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
    count = float(sum(len(take.observations) for take in takes))
    blobs, of_blobs = timed(lambda: _blobs(shoot), 1)
    least = None
    if one.detections is not None:
        least = float(np.ceil(LEAST_PART_OF_DETECTIONS * one.detections))
    peers = {"OpenCV blobs, not numbered": float(blobs)}
    seconds = times.as_peers() | {"OpenCV blobs, s": of_blobs.first_s}
    what = "reading, finding, numbering, s"
    numbered = "points found and numbered"
    return [
        Row(one.name, numbered, count, least, one.detections, peers, True),
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
    least = LEAST_PART_OF_DETECTIONS
    peers = {"apart, px": agreed.apart_px, "points it lacks": float(agreed.more)}
    wrong = float(agreed.misnumbered)
    return [
        Row(one.name, "recall of the other code's points", agreed.recall, least,
            peers=peers, least=True),
        Row(one.name, "points numbered otherwise", wrong, 0.0),
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
