"""Candidates (local minima of the misfit), followed until the photographs decide.

Smoothed photographs of small blurs are explained by many lenses: with the defocus of
all takes shifted by the same amount, or mirrored through focus, other aberrations
compensate. Full pixels show which of them is right, but there the solve no longer gets
from one local minimum to another. So every candidate that is still possible goes on to
the next stage.

Candidates that explain the photographs equally well are ranked by their agreement with
the stated distances.

Candidates are distinguished by defocus alone: if two agree in it, the fit finds its way
from one to the other.
"""

from collections.abc import Callable
from dataclasses import replace
from operator import attrgetter
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lensfit.errors import FitError
from lensfit.fitting.wavefront.parameters import mirror_through_focus
from lensfit.fitting.wavefront.stages import Stage, chi_squared, solve_stage
from lensfit.fitting.wavefront.start_values import IN_FOCUS_MM, stated_defocus_mm
from lensfit.fitting.wavefront.stated import statements_without_distances

DECISIVE = 1.1
"""Ratio of costs above which the candidate of lower cost is preferred."""
_AGREEING, _SAME_COST = 3, 1.005
"""How many starts have to end in one minimum, and their cost over the lowest."""
_SAME = 0.2
"""Candidates closer than this share of the largest defocus are the same."""
_FAR_APART = 0.4
"""Share of the distance of the farthest two takes, above which pairs count: most shoots
lie in focus, nearer and farther by about half of it, and neighbours must count."""
_ACROSS = 0.5
"""Share of the stated defocus; a curved field and a barrel off scale move less."""
_COST = attrgetter("cost")


class Candidate(NamedTuple):
    """A multistart candidate: a local minimum of the misfit.

    Attributes
    ----------
    stage : The fit there.
    cost : Weighted sum of squared residuals.
    defocus_misfit_mm : Its defocus against what was stated, rms; 0 where nothing was.
    """

    stage: Stage
    cost: float
    defocus_misfit_mm: float


def candidate_at(
    stage: Stage, cost: Callable[[Stage], float] = chi_squared
) -> Candidate:
    """The candidate where a solve ended; a failed solve has infinite cost."""
    found = float(np.nan_to_num(cost(stage), nan=np.inf, posinf=np.inf))
    return Candidate(stage, found, _defocus_misfit_mm(stage))


def mirrored_candidate(one: Candidate) -> Candidate:
    """The candidate mirrored through focus, which photographs barely distinguish from
    this one (`mirror_through_focus`)."""
    stage = one.stage
    start = replace(
        stage,
        parameters=mirror_through_focus(stage.parameters, stage.layout),
        mean=mirror_through_focus(stage.mean, stage.layout),
        # Stated distances determine the side of focus: here that is in question.
        statements=statements_without_distances(stage.dot_data, stage.layout),
    )
    return candidate_at(solve_stage(start))


def best_candidate(found: list[Candidate]) -> Candidate:
    """The candidate that explains the photographs best.

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


def open_candidates(
    found: list[Candidate], hopeless: float, most: int, *, both_sides: bool = False
) -> list[Candidate]:
    """The candidates that may yet be the lens, each local minimum once.

    Parameters
    ----------
    hopeless : Cost over the best one's above which candidates are rejected.
    most : How many.
    both_sides : Whether to keep the best one on the other side of focus.

    Raises
    ------
    FitError : As `best_candidate` does.
    """
    apart = _each_once(found, hopeless)
    decisive = DECISIVE * apart[0].cost
    alike = [one for one in apart if one.cost <= decisive]
    worse = [one for one in apart if one.cost > decisive]
    kept = [*sorted(alike, key=attrgetter("defocus_misfit_mm")), *worse][:most]
    return _with_rival(kept, most, apart) if both_sides else kept


def leading_candidates(
    found: list[Candidate], ratio: float, most: int, *, both_sides: bool = False
) -> list[Candidate]:
    """The candidates of lowest cost, whatever was stated, each local minimum once.

    Parameters
    ----------
    ratio : Cost over the best one's above which candidates are rejected.
    most : How many.
    both_sides : Whether to keep the best one on the other side of focus, unless its
        cost decides against it.

    Raises
    ------
    FitError : As `best_candidate` does.
    """
    apart = _each_once(found, DECISIVE)
    kept = _each_once(apart, ratio)[:most]
    return _with_rival(kept, most, apart) if both_sides else kept


def _with_rival(
    kept: list[Candidate], most: int, apart: list[Candidate]
) -> list[Candidate]:
    """The same, the best one on the other side of focus at least in the last place."""
    rival = _rival(apart[0], apart)
    if rival is None or any(rival is one for one in kept):
        return kept
    return [*kept[: most - 1], rival]


def rejected_candidates(
    found: list[Candidate], kept: list[Candidate]
) -> list[Candidate]:
    """Candidates that were not kept, lowest cost first; none that failed."""
    rejected = [one for one in found if all(one is not other for other in kept)]
    return sorted((one for one in rejected if np.isfinite(one.cost)), key=_COST)


def have_starts_agreed(found: list[Candidate]) -> bool:
    """Whether several starts have ended at the lowest cost, too many for chance."""
    cost = np.array([one.cost for one in found])
    cost = cost[np.isfinite(cost)]
    alike = cost <= _SAME_COST * cost.min(initial=np.inf)
    return bool(alike.sum() >= _AGREEING)


def is_side_determined(found: list[Candidate]) -> bool:
    """Whether the photographs prefer one side of focus."""
    best = best_candidate(found)
    rival = _rival(best, found)
    return rival is None or rival.cost > DECISIVE * best.cost


def runs_against_statements(stage: Stage) -> bool:
    """Whether takes lie in another order along the axis than was stated, or all of them
    on the other side of focus.

    All may be shifted together, as by a curved field or the scale of a barrel; but a
    far focus cannot come before a near one. Only pairs that are far apart in this shoot
    count. What was stated plainly out of focus is not found as far on the other side.
    """
    stated_mm = stated_defocus_mm(stage.dot_data)
    defocus_mm = stage.parameters[stage.layout.blocks["defocus"]][: len(stated_mm)]
    known = np.isfinite(stated_mm)
    if not known.any():
        return False
    apart_mm = np.subtract.outer(stated_mm[known], stated_mm[known])
    found_mm = np.subtract.outer(defocus_mm[known], defocus_mm[known])
    least_mm = max(_FAR_APART * np.abs(apart_mm).max(), IN_FOCUS_MM)
    in_order = not np.any(found_mm[apart_mm > least_mm] < 0)
    plainly = known & (np.abs(stated_mm) > IN_FOCUS_MM)
    across = defocus_mm * np.sign(stated_mm) < -_ACROSS * np.abs(stated_mm)
    return not in_order or bool(plainly.any() and across[plainly].all())


def _defocus_misfit_mm(stage: Stage) -> float:
    stated_mm = stated_defocus_mm(stage.dot_data)
    defocus_mm = stage.parameters[stage.layout.blocks["defocus"]][: len(stated_mm)]
    defocus_misfit_mm = (defocus_mm - stated_mm)[np.isfinite(stated_mm)]
    return (
        float(np.sqrt(np.mean(defocus_misfit_mm**2))) if defocus_misfit_mm.size else 0.0
    )


def _each_once(found: list[Candidate], ratio: float) -> list[Candidate]:
    """The candidate of lowest cost of each local minimum, best first.

    Parameters
    ----------
    ratio : Cost over the best one's above which candidates are left out.

    Raises
    ------
    FitError : As `best_candidate` does.
    """
    most = ratio * best_candidate(found).cost
    apart: list[Candidate] = []
    for one in sorted(found, key=_COST):
        if one.cost <= most and not any(_is_same(one, other) for other in apart):
            apart.append(one)
    return apart


def _rival(best: Candidate, found: list[Candidate]) -> Candidate | None:
    """The candidate of lowest cost on the other side of focus."""
    across = [one for one in found if _is_across(one, best)]
    return min(across, key=_COST, default=None)


def _is_same(one: Candidate, other: Candidate) -> bool:
    mine, theirs, least = _comparable_defocus(one, other)
    return bool(np.abs(mine - theirs).max() <= least)


def _is_across(one: Candidate, other: Candidate) -> bool:
    """Whether some take lies on the other side of focus."""
    mine, theirs, least = _comparable_defocus(one, other)
    opposite = np.sign(mine) != np.sign(theirs)
    return bool(np.any(opposite & (np.minimum(abs(mine), abs(theirs)) > least)))


def _comparable_defocus(
    one: Candidate, other: Candidate
) -> tuple[Float[np.ndarray, " groups"], Float[np.ndarray, " groups"], float]:
    """Defocus of both, and the difference that does not count."""
    where = one.stage.layout.blocks["defocus"]
    mine, theirs = one.stage.parameters[where], other.stage.parameters[where]
    size = max(np.abs(mine).max(), np.abs(theirs).max())
    return mine, theirs, float(_SAME * size)
