"""The first solve: third order on smoothed dots, from every start still possible.

The defocus common to all takes is poorly known before the fit, since a curved field or
spherical aberration moves the best focus. Once blur is larger than a dot, the solve
cannot cross from one such local minimum to another. The same holds for a field that is
curved to the other side, and for the side of focus where nobody stated it.
All starts run on a few dots, the promising ones on more (`multistart`).
"""

import itertools
from collections.abc import Collection
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lensfit.fitting.wavefront.dot_data import (
    DotData,
    rows_spread_over_takes,
    select_dots,
)
from lensfit.fitting.wavefront.moments import (
    Focus,
    dot_widths_mm,
    likely_focus,
    set_focus,
)
from lensfit.fitting.wavefront.multistart import (
    Candidate,
    best_candidate,
    candidate_at,
    mirrored_candidate,
    open_candidates,
    rejected_candidates,
)
from lensfit.fitting.wavefront.parameters import Layout
from lensfit.fitting.wavefront.stages import (
    first_stage,
    recentre_patches,
    set_priors,
    smooth_stage,
    solve_stage,
    stage_on_dots,
)
from lensfit.fitting.wavefront.start_values import (
    IN_FOCUS_MM,
    FirstDefocus,
    first_defocus,
    first_parameters,
)
from lensfit.fitting.wavefront.term_groups import (
    COARSE,
    TermGroup,
    candidate_term_groups,
    deviation_of,
)

_SMOOTHING = 3.0
_MOST_SIGNS = 3
_HOPELESS_START, _HOPELESS = 3.0, 1.5
"""Largest cost over the best one's: after one short solve on few dots, where some
starts have not converged yet; and at the end."""
_FEW_DOTS = 4
"""Of each take, for the many starts of known sign. With unknown signs so few dots would
decide between a lens and its mirror image by their positions."""
_FINALISTS = 4
"""How many are solved with all dots; the next stage, as cheap, may use them all."""


class _StartOffsets(NamedTuple):
    """How many starts there are for each choice of signs.

    Attributes
    ----------
    offsets_from_measured, offsets_from_stated : Defocus common to all takes, in units
        of the largest measured one: added to the measured defocus of each take, and to
        the stated one.
    curved : Number of curved fields (`moments`).
    """

    offsets_from_measured: tuple[float, ...]
    offsets_from_stated: tuple[float, ...]
    curved: int


_START_OFFSETS = (
    _StartOffsets(
        (0.0, -0.5, 0.5, -1.0, 1.0), (0.0, -0.5, 0.5, -1.0, 1.0, -2.0, 2.0), 4
    ),
    _StartOffsets((0.0,), (0.0, -1.0, 1.0), 2),
    _StartOffsets((0.0,), (), 1),
)
"""By the number of unknown signs: none, one, more. Each doubles the starts."""


class CoarseFit(NamedTuple):
    """Result of the first solve.

    Attributes
    ----------
    candidates : Local minima that the photographs do not exclude, ranked by
        statements.
    rejected : The other candidates where they were rejected, lowest cost first.
    side_stated : Whether statements determine the side of focus: those of every take;
        a statement that the chart was in focus does not.
    term_groups : Term groups that are free in this stage and the next.
    """

    candidates: list[Candidate]
    rejected: list[Candidate]
    side_stated: bool
    term_groups: tuple[TermGroup, ...]


def coarse_fit(
    dot_data: DotData,
    layout: Layout,
    allowed: Collection[str] | None = None,
) -> CoarseFit:
    """Third order, from the starts that fit the photographs best."""
    first = first_defocus(dot_data)
    term_groups = candidate_term_groups(dot_data, layout, first.value_mm, allowed)
    deviation = deviation_of(term_groups, layout, COARSE)
    perfect = first_parameters(dot_data, layout, first.value_mm)
    all_stated = bool(first.side_stated.all())
    side_stated = all_stated and bool(np.any(np.abs(first.value_mm) > IN_FOCUS_MM))
    some = dot_data
    if all_stated:
        some = select_dots(dot_data, rows_spread_over_takes(dot_data, _FEW_DOTS))
    tries = []
    sine = float(dot_data.scale.reference_sine)
    for focus in _start_foci(dot_data, first, curved=not layout.anamorphic):
        lens = set_focus(perfect, layout, focus, sine)
        # Parameters that are not free here keep the values of a perfect lens.
        parameters = np.where(deviation > 0, lens, perfect)
        stage = smooth_stage(first_stage(some, layout, parameters), _SMOOTHING)
        # Most starts fail: recentring their patches once is enough.
        tries.append(
            candidate_at(solve_stage(recentre_patches(set_priors(stage, deviation), 1)))
        )
    candidates, rejected = _finalists(tries, dot_data, side_stated)
    return CoarseFit(candidates, rejected, side_stated, term_groups)


def solve_on_all_dots(one: Candidate, dot_data: DotData) -> Candidate:
    """The candidate of some dots, solved with all."""
    return candidate_at(
        solve_stage(recentre_patches(stage_on_dots(one.stage, dot_data)))
    )


def _finalists(
    tries: list[Candidate], dot_data: DotData, side_stated: bool
) -> tuple[list[Candidate], list[Candidate]]:
    """Promising candidates, on all dots; and the rejected ones."""
    both_sides = not side_stated
    begun = open_candidates(tries, _HOPELESS_START, _FINALISTS, both_sides=both_sides)
    ended = [solve_on_all_dots(one, dot_data) for one in begun]
    if both_sides:
        ended.append(mirrored_candidate(best_candidate(ended)))
    kept = open_candidates(ended, _HOPELESS, _FINALISTS, both_sides=both_sides)
    return kept, [*rejected_candidates(ended, kept), *rejected_candidates(tries, begun)]


def _start_foci(dot_data: DotData, first: FirstDefocus, *, curved: bool) -> list[Focus]:
    """Starts at the measured defocus; and at the stated one, since aberrations widen
    dots, with all takes shifted by the same amount, or with curved fields: those
    last."""
    patterns = _sign_patterns(first)
    open_signs = (len(patterns) - 1).bit_length()
    tries = _START_OFFSETS[min(open_signs, len(_START_OFFSETS) - 1)]
    unit_mm = float(np.max(first.size_mm))
    as_stated_mm = np.where(first.side_stated, first.stated_mm, first.value_mm)
    begun = (
        (first.value_mm, tries.offsets_from_measured),
        (as_stated_mm, tries.offsets_from_stated),
    )
    flat = [
        Focus(defocus_mm * signs + offset * unit_mm)
        for signs in patterns
        for defocus_mm, offsets in begun
        for offset in offsets
    ]
    if not curved:
        return flat
    widths_mm = dot_widths_mm(dot_data)
    bent = [
        focus
        for signs in patterns
        for focus in likely_focus(
            dot_data, widths_mm, as_stated_mm * signs, tries.curved
        )
    ]
    return flat + bent


def _sign_patterns(first: FirstDefocus) -> list[Float[np.ndarray, " groups"]]:
    """Signs to try: every combination for the few largest defocus values that nobody
    stated; others stay as they are."""
    unknown = np.flatnonzero(~first.side_stated)
    unknown = unknown[np.argsort(-np.abs(first.value_mm[unknown]))][:_MOST_SIGNS]
    tries = []
    for flips in itertools.product((1.0, -1.0), repeat=len(unknown)):
        signs = np.ones(len(first.value_mm))
        signs[unknown] = flips
        tries.append(signs)
    return tries
