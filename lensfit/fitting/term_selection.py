"""Stages 2 and 3 of the geometric fit: which terms the photographs ask for.

The named terms are chosen first, twice, then what bends boards, then the free field, on
top of named terms that are held where they are, since it spans them. A few damped
steps with everything free follow, along the curved valley that this leaves. Terms
of elements out of centre enter together where the lens' axis is free
(`decentring`).
"""

from dataclasses import replace

import numpy as np

from lensfit.fitting.adjust import VALLEY_DAMPING, Adjustment, adjust
from lensfit.fitting.decentring import (
    WHY,
    WORKSHOP,
    OutOfCentre,
    asks_for_all,
    with_elements_out_of_centre,
)
from lensfit.fitting.half_equations import halves_of, least_fall, stated_statistics
from lensfit.fitting.parameters import PINHOLE, Layout, Prior, stated_blocks
from lensfit.fitting.priors import loose_prior
from lensfit.fitting.select import (
    Step,
    Verdict,
    bend_steps,
    choose,
    drift_steps,
    families,
)
from lensfit.fitting.stage import Start
from lensfit.progress import Progress


def with_evidence(
    start: Start,
    compact: Adjustment,
    progress: Progress,
    told: OutOfCentre | None = None,
) -> tuple[Adjustment, tuple[str, ...], list[Verdict]]:
    """Stages 2 and 3.

    Parameters
    ----------
    told : What tilted views at another focus say of elements out of centre.
    """
    views, layout = len(start.takes), compact.layout
    always = _always(layout, start)
    terms = families(layout, start.largest)
    if start.focal_length_free:
        del terms["principal_point"]  # it is in every model then
    free_field = {n: terms.pop(n) for n in ("free_field",) if n in terms}
    adjustment, kept, verdicts = compact, {}, []
    for turn in range(2):
        adjustment, kept, verdicts = _chosen(adjustment, always, terms)
        progress("fit", 2 + turn, 5)
    names = [terms[f][n - 1].name for f, n in kept.items()]
    if layout.bend_degree:
        lens = _indices(always, kept, terms)
        adjustment, more, others = _with_bends(adjustment, lens, views)
        verdicts, names = verdicts + others, names + more
    if free_field:
        adjustment, more, others = _with_free_field(adjustment, always, free_field)
        verdicts, names = verdicts + others, names + more
    told = None if start.focal_length_free else told
    asked = start.focal_length_free and asks_for_all(adjustment, verdicts)
    if asked or told is not None:
        adjustment = with_elements_out_of_centre(adjustment, told)
        verdicts = [
            v.kept_all_the_same(WHY) if v.family in WORKSHOP else v for v in verdicts
        ]
        names = list(dict.fromkeys([*names, *WORKSHOP]))
    progress("fit", 4, 5)
    return adjustment, tuple(names), verdicts


def _with_bends(
    adjustment: Adjustment, lens: np.ndarray, views: int
) -> tuple[Adjustment, list[str], list[Verdict]]:
    """What bends boards, on top of the lens, never instead of it: seen frontally, a
    bent board and a distorting lens are one and the same."""
    layout = adjustment.layout
    held = np.setdiff1d(lens, _spanned(layout))
    bends = {
        "board_bend": bend_steps(layout, views),
        "row_drift": drift_steps(layout, views),
    }
    adjustment, kept, verdicts = _chosen(adjustment, held, bends)
    everything = np.union1d(lens, _indices(held, kept, bends))
    names = [bends[f][n - 1].name for f, n in kept.items()]
    return _all_free(adjustment, everything), names, verdicts


def _with_free_field(
    named: Adjustment, always: np.ndarray, steps: dict[str, list[Step]]
) -> tuple[Adjustment, list[str], list[Verdict]]:
    """Stage 3; afterwards everything that was kept is free again."""
    fitted, kept, verdicts = _chosen(named, always, steps)
    if not kept:
        return named, [], verdicts
    step = steps["free_field"][kept["free_field"] - 1]
    everything = np.union1d(np.flatnonzero(named.prior.free), step.indices)
    return _all_free(fitted, everything), [step.name], verdicts


def _all_free(adjustment: Adjustment, everything: np.ndarray) -> Adjustment:
    """One more round with all these free, each with a loose prior around zero."""
    nothing = np.zeros(0, int)
    prior = loose_prior(adjustment.parameters, adjustment.layout, nothing, everything)
    prior = Prior(np.where(prior.free, 0.0, prior.mean), prior.standard_deviation)
    released = replace(adjustment, prior=prior)
    return adjust(released, rounds=1, damping=VALLEY_DAMPING)


def _spanned(layout: Layout) -> np.ndarray:
    """Lens terms of degree three and more, held while bends are tried."""
    blocks = [layout.blocks[name] for name in ("radial", "anamorphic")]
    return np.concatenate([np.arange(b.start, b.stop) for b in blocks])


def _chosen(
    adjustment: Adjustment,
    always: np.ndarray,
    terms: dict[str, list[Step]],
) -> tuple[Adjustment, dict[str, int], list[Verdict]]:
    """Linearise, choose among `terms`, and fit what was chosen.

    Parameters that are neither in `always` nor in `terms` stay where they are.
    """
    tried = np.unique(
        np.concatenate([always, *(s[-1].indices for s in terms.values())])
    )
    here, layout = adjustment.parameters, adjustment.layout
    everything = loose_prior(here, layout, tried, tried)
    precision = np.where(everything.free, 1.0, 0.0)
    precision = precision / np.maximum(everything.standard_deviation, 1e-30) ** 2
    offset = here - everything.mean
    found = choose(
        *halves_of(replace(adjustment, prior=everything)),
        precision,
        offset,
        always,
        terms,
        least_fall(adjustment),
        stated_statistics(adjustment),
    )
    chosen = _indices(always, found.kept, terms)
    started = replace(
        adjustment,
        parameters=here + found.step,
        prior=loose_prior(here, layout, tried, chosen),
    )
    return adjust(started), found.kept, found.verdicts


def _always(layout: Layout, start: Start) -> np.ndarray:
    """Parameters in every model: poses, what statements hold, and the rest of the
    pinhole where views tilt enough to determine it."""
    poses = layout.local_indices("pose", len(start.takes)).ravel()
    rest = PINHOLE if start.focal_length_free else ()
    names = (*stated_blocks(start.walk_free), *rest)
    pinhole = [layout.blocks[name] for name in names]
    known = [np.arange(w.start, w.stop) for w in pinhole]
    return np.concatenate([*known, poses]).astype(int)


def _indices(
    always: np.ndarray, kept: dict[str, int], terms: dict[str, list[Step]]
) -> np.ndarray:
    chosen = [terms[family][level - 1].indices for family, level in kept.items()]
    return np.unique(np.concatenate([always, *chosen]))
