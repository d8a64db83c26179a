"""Valleys of the misfit, each followed until the photographs tell them apart.

Smoothed photographs of small blurs suit many lenses: with defocus of all takes moved
together, or mirrored through focus, other aberrations make up for it. Which of them it
was shows on full pixels, where the fit no longer gets from one valley to another. So
every valley that is still open goes on to the next stage.

What the photographs leave open, statements rank: of valleys that explain as much, those
go on that agree best with the stated distances.

Valleys are known by defocus alone: what else differs between two that agree in it, the
fit finds its way through.
"""

from collections.abc import Callable
from dataclasses import replace
from operator import attrgetter
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lensfit.errors import FitError
from lensfit.fitting.wavefront.parameters import mirrored
from lensfit.fitting.wavefront.stages import Stage, chi_squared, solved
from lensfit.fitting.wavefront.start import IN_FOCUS_MM, stated_defocus_mm
from lensfit.fitting.wavefront.stated import stated_opening

DECISIVE = 1.1
"""How much better one must explain the photographs to be preferred for it."""
_SAME = 0.2
"""Apart by less than this share of the largest defocus, valleys are one."""
_FAR_APART = 0.4
"""Of the distance of the farthest two takes: most shoots lie in focus, nearer and
farther by about half of it, and neighbours are to count."""
_COST = attrgetter("cost")


class Valley(NamedTuple):
    """A place that the fit was led to.

    Attributes
    ----------
    stage : The fit there.
    cost : How badly it explains the photographs.
    off_mm : Its defocus against what was stated, rms; 0 where nothing was.
    """

    stage: Stage
    cost: float
    off_mm: float


def valley_at(stage: Stage, cost: Callable[[Stage], float] = chi_squared) -> Valley:
    """The one where a solve ended; one that failed costs without bound."""
    found = float(np.nan_to_num(cost(stage), nan=np.inf, posinf=np.inf))
    return Valley(stage, found, _off_mm(stage))


def other_side(one: Valley) -> Valley:
    """The valley that the photographs can hardly tell from this one (`mirrored`)."""
    stage = one.stage
    start = replace(
        stage,
        parameters=mirrored(stage.parameters, stage.layout),
        mean=mirrored(stage.mean, stage.layout),
        # Distances say on which side it is: here they are in question.
        stated=stated_opening(stage.layout),
    )
    return valley_at(solved(start))


def deepest(found: list[Valley]) -> Valley:
    """The one that explains the photographs best.

    Raises
    ------
    FitError : None of them explains anything.
    """
    best = min(found, key=_COST)
    if not np.isfinite(best.cost):
        raise FitError(
            "no lens was found that explains the shape of the dots at all",
            remedy="look at the overlays: are these dots, sharp or evenly blurred?",
        )
    return best


def still_open(
    found: list[Valley], hopeless: float, most: int, *, both_sides: bool = False
) -> list[Valley]:
    """Those that may yet be the lens, each place once.

    Parameters
    ----------
    hopeless : How much worse than the best is beyond hope.
    most : How many.
    both_sides : Whether the best one on the other side of focus is to be among them.

    Raises
    ------
    FitError : As `deepest` does.
    """
    best = deepest(found)
    apart = _each_once([one for one in found if one.cost <= hopeless * best.cost])
    decisive = DECISIVE * best.cost
    alike = [one for one in apart if one.cost <= decisive]
    worse = [one for one in apart if one.cost > decisive]
    kept = [*sorted(alike, key=attrgetter("off_mm")), *worse][:most]
    rival = _rival(best, apart)
    if both_sides and rival is not None and all(rival is not one for one in kept):
        kept[-1] = rival
    return kept


def left_of(found: list[Valley], kept: list[Valley]) -> list[Valley]:
    """Those that were not kept, the deepest first; none that failed."""
    left = [one for one in found if all(one is not other for other in kept)]
    return sorted((one for one in left if np.isfinite(one.cost)), key=_COST)


def side_is_told(found: list[Valley]) -> bool:
    """Whether the photographs prefer one side of focus."""
    best = deepest(found)
    rival = _rival(best, found)
    return rival is None or rival.cost > DECISIVE * best.cost


def runs_against_statements(stage: Stage) -> bool:
    """Whether takes lie in another order along the axis than was stated.

    All may be moved together, as a curved field or a barrel's scale does it; but not a
    far focus before a near one. Only pairs that are far apart for this shoot count.
    """
    stated_mm = stated_defocus_mm(stage.gathered)
    defocus_mm = stage.parameters[stage.layout.blocks["defocus"]][: len(stated_mm)]
    told = np.isfinite(stated_mm)
    if not told.any():
        return False
    apart_mm = np.subtract.outer(stated_mm[told], stated_mm[told])
    found_mm = np.subtract.outer(defocus_mm[told], defocus_mm[told])
    least_mm = max(_FAR_APART * np.abs(apart_mm).max(), IN_FOCUS_MM)
    return bool(np.any(found_mm[apart_mm > least_mm] < 0))


def _off_mm(stage: Stage) -> float:
    stated_mm = stated_defocus_mm(stage.gathered)
    defocus_mm = stage.parameters[stage.layout.blocks["defocus"]][: len(stated_mm)]
    off_mm = (defocus_mm - stated_mm)[np.isfinite(stated_mm)]
    return float(np.sqrt(np.mean(off_mm**2))) if off_mm.size else 0.0


def _each_once(found: list[Valley]) -> list[Valley]:
    """The deepest of those that are one."""
    apart: list[Valley] = []
    for one in sorted(found, key=_COST):
        if not any(_is_same(one, other) for other in apart):
            apart.append(one)
    return apart


def _rival(best: Valley, found: list[Valley]) -> Valley | None:
    """The deepest one on the other side of focus."""
    across = [one for one in found if _is_across(one, best)]
    return min(across, key=_COST, default=None)


def _is_same(one: Valley, other: Valley) -> bool:
    mine, theirs, least = _compared(one, other)
    return bool(np.abs(mine - theirs).max() <= least)


def _is_across(one: Valley, other: Valley) -> bool:
    """Whether some take lies on the other side of focus."""
    mine, theirs, least = _compared(one, other)
    opposite = np.sign(mine) != np.sign(theirs)
    return bool(np.any(opposite & (np.minimum(abs(mine), abs(theirs)) > least)))


def _compared(
    one: Valley, other: Valley
) -> tuple[Float[np.ndarray, " groups"], Float[np.ndarray, " groups"], float]:
    """Defocus of both, and what of it makes no difference."""
    where = one.stage.layout.blocks["defocus"]
    mine, theirs = one.stage.parameters[where], other.stage.parameters[where]
    size = max(np.abs(mine).max(), np.abs(theirs).max())
    return mine, theirs, float(_SAME * size)
