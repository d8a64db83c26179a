"""One exposure that stands for several views: a copy, or the same file saved again.

Two exposures of one scene differ by their noise. Where the points of two photographs
agree better than that, they are one exposure. It is counted once.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lensfit.fitting.chart_view import View
from lensfit.workflow.calibration.observe import Observed
from lensfit.workflow.statements.contradiction import Contradiction

_OF_NOISE = 0.25
"""Rms difference of positions, in standard deviations of one, of what is no exposure of
its own; two exposures have the square root of two."""
_MOST_PX = 0.003
"""Stated deviations may be too large; no two exposures agree as well as this."""
_LEAST_COMMON = 20
_FAR_PX = 2.0


def without_repeated_exposures(
    observed: Sequence[Observed],
) -> tuple[list[Observed], list[Contradiction]]:
    """The photographs without repetitions, and a contradiction for each of these."""
    kept: list[Observed] = []
    result: list[Observed] = []
    repeats: dict[str, list[str]] = {}
    for one in observed:
        first = next((other for other in kept if _is_same(one, other)), None)
        if one.take is None or first is None:
            kept += [one] if one.take is not None else []
            result.append(one)
            continue
        repeats.setdefault(first.image, []).append(one.image)
        why = f"{one.image}: holds the very exposure of {first.image}, counted once"
        result.append(replace(one, take=None, failed=why))
    found = [_contradiction(first, copies) for first, copies in repeats.items()]
    return result, found


def _contradiction(first: str, copies: list[str]) -> Contradiction:
    times = "once" if len(copies) == 1 else f"{len(copies)} times"
    return Contradiction(
        kind="repeated_exposure",
        limit="match-moving",
        text=f"one exposure is repeated: {first} is there {times} more, as "
        f"{', '.join(copies[:4])}, and counts as one view",
        remedy="shoot the missing views: a copy adds nothing",
        images=(first, *copies),
    )


def _is_same(one: Observed, other: Observed) -> bool:
    if one.take is None or other.take is None:
        return False
    if one.sha256 and one.sha256 == other.sha256:
        return True
    return _same_points(one.take, other.take)


def _same_points(one: View, other: View) -> bool:
    mine, theirs = one.observations, other.observations
    if mine.image_size_px != theirs.image_size_px or one.target != other.target:
        return False
    if abs(len(mine) - len(theirs)) > 0.1 * len(mine):
        return False
    apart = theirs.points_px[None, : len(theirs)] - mine.points_px[:200, None]
    distance = np.linalg.norm(apart, axis=-1)
    nearest = distance.argmin(1)
    row = np.arange(len(nearest))
    common = distance[row, nearest] < _FAR_PX
    if common.sum() < max(_LEAST_COMMON, 0.5 * len(nearest)):
        return False
    variance = np.trace(mine.covariance_px2[:200], axis1=1, axis2=2)
    ratio = distance[row, nearest][common] ** 2 / np.maximum(variance[common], 1e-12)
    apart_px = float(np.median(distance[row, nearest][common]))
    return bool(np.sqrt(np.median(ratio)) < _OF_NOISE and apart_px < _MOST_PX)
