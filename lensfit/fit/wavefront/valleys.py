"""Valleys of the misfit, each followed until the photographs tell them apart.

Smoothed photographs of small blurs suit many lenses: with defocus of all takes moved
together, or mirrored through focus, other aberrations make up for it. Which of them it
was shows on full pixels, where the fit no longer gets from one valley to another. So
every valley that is still open goes on to the next stage.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from lensfit.fit.wavefront.parameters import mirrored
from lensfit.fit.wavefront.stages import Stage, chi_squared, solved

_DECISIVE = 1.1
"""How much better a sign of defocus must explain the photographs."""
_SAME = 0.1
"""Apart by less than this share of the largest defocus, valleys are one."""


class Valley(NamedTuple):
    """A place that the fit was led to.

    Attributes
    ----------
    pattern : Of the signs of defocus it started with, by number.
    stage : The fit there.
    cost : How badly it explains the photographs.
    """

    pattern: int
    stage: Stage
    cost: float


def valley(
    pattern: int, stage: Stage, cost: Callable[[Stage], float] = chi_squared
) -> Valley:
    """The one where a solve ended; one that failed costs without bound."""
    return Valley(pattern, stage, float(np.nan_to_num(cost(stage), nan=np.inf)))


def other_side(one: Valley) -> Valley:
    """The valley that the photographs can hardly tell from this one (`mirrored`)."""
    stage = one.stage
    start = replace(
        stage,
        parameters=mirrored(stage.parameters, stage.layout),
        mean=mirrored(stage.mean, stage.layout),
    )
    return valley(~one.pattern, solved(start))


def still_open(found: list[Valley], hopeless: float, most: int) -> list[Valley]:
    """Those that may yet be the lens, the best first, each place once.

    Parameters
    ----------
    hopeless : How much worse than the best is beyond hope.
    most : How many of each pattern of signs.
    """
    ranked = sorted(found, key=lambda one: one.cost)
    kept: list[Valley] = []
    for one in ranked:
        mine = [other for other in kept if other.pattern == one.pattern]
        known = any(_is_same(one, other) for other in kept)
        if not known and len(mine) < most and one.cost <= hopeless * ranked[0].cost:
            kept.append(one)
    return kept


def sign_is_told(found: list[Valley]) -> bool:
    """Whether the photographs prefer one pattern of signs."""
    best, *others = sorted(found, key=lambda one: one.cost)
    rivals = [one.cost for one in others if one.pattern != best.pattern]
    return not rivals or min(rivals) > _DECISIVE * best.cost


def _is_same(one: Valley, other: Valley) -> bool:
    where = one.stage.layout.blocks["defocus"]
    mine, theirs = one.stage.parameters[where], other.stage.parameters[where]
    size = max(np.abs(mine).max(), np.abs(theirs).max())
    return bool(np.abs(mine - theirs).max() <= _SAME * size)
