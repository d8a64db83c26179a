"""The first solve: third order on smoothed dots, from every start that is left open.

How far all takes lie from focus together is badly known before the fit: a curved field
or spherical aberration moves the best focus, and their valleys are walled off from each
other once blur is larger than a dot. So are those of a field that is curved to the
other side, and the side of focus where nobody stated it.
All starts run on a few dots, the promising ones on more (`multistart`).
"""

import itertools
from collections.abc import Collection
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lensfit.fitting.fall_off.fall_off_fit import FallOffFit
from lensfit.fitting.wavefront.gather import Gathered, chosen, spread_over_takes
from lensfit.fitting.wavefront.moments import (
    Focus,
    dot_widths_mm,
    likely_focus,
    set_focus,
)
from lensfit.fitting.wavefront.multistart import (
    Valley,
    deepest,
    left_of,
    other_side,
    still_open,
    valley_at,
)
from lensfit.fitting.wavefront.parameters import Layout
from lensfit.fitting.wavefront.stages import (
    first_stage,
    freed,
    on_dots,
    settled,
    smoothed_by,
    solved,
)
from lensfit.fitting.wavefront.start import (
    IN_FOCUS_MM,
    FirstDefocus,
    first_defocus,
    first_parameters,
)
from lensfit.fitting.wavefront.term_groups import (
    COARSE,
    Family,
    deviation_of,
    families_of,
)

_SMOOTHING = 3.0
_MOST_SIGNS = 3
_HOPELESS_START, _HOPELESS = 3.0, 1.5
"""How much worse than the best a start may be after one short solve on few dots, where
some are still on their way; and at the end."""
_FEW_DOTS = 4
"""Of each take, while there are many starts of known sign; a few would tell a lens from
its mirror image by where they happen to be."""
_FINALISTS = 4
"""How many are solved with all dots; the next stage, as cheap, may have them all."""


class _Tries(NamedTuple):
    """How many starts there are for each choice of signs.

    Attributes
    ----------
    from_seen, from_stated : Defocus common to all takes, in the largest that is seen,
        beyond what is seen of each take and beyond what was stated of it.
    curved : Number of curved fields (`moments`).
    """

    from_seen: tuple[float, ...]
    from_stated: tuple[float, ...]
    curved: int


_TRIES = (
    _Tries((0.0, -0.5, 0.5, -1.0, 1.0), (0.0, -0.5, 0.5, -1.0, 1.0, -2.0, 2.0), 4),
    _Tries((0.0,), (0.0, -1.0, 1.0), 2),
    _Tries((0.0,), (), 1),
)
"""By the number of signs that are open: none, one, more. Each doubles the starts."""


class Coarse(NamedTuple):
    """What the first solve found.

    Attributes
    ----------
    valleys : Where starts led that the photographs leave open, as statements rank them.
    others : Where the other starts had led when they were left, the deepest first.
    side_stated : Whether statements settle the side of focus: those of every take; that
        the chart was in focus does not.
    families : What is free in this stage and the next.
    """

    valleys: list[Valley]
    others: list[Valley]
    side_stated: bool
    families: tuple[Family, ...]


def coarse_fit(
    gathered: Gathered,
    layout: Layout,
    fall_off: FallOffFit | None,
    allowed: Collection[str] | None = None,
) -> Coarse:
    """Third order, from the starts that suit the photographs best."""
    first = first_defocus(gathered)
    families = families_of(gathered, layout, first.value_mm, allowed)
    deviation = deviation_of(families, layout, COARSE)
    perfect = first_parameters(gathered, layout, fall_off, first.value_mm)
    all_stated = bool(first.side_stated.all())
    side_stated = all_stated and bool(np.any(np.abs(first.value_mm) > IN_FOCUS_MM))
    some = gathered
    if all_stated:
        some = chosen(gathered, spread_over_takes(gathered, _FEW_DOTS))
    tries = []
    sine = float(gathered.scale.reference_sine)
    for focus in _focus_to_try(gathered, first, curved=not layout.anamorphic):
        lens = set_focus(perfect, layout, focus, sine)
        # What is not free here stays as a perfect lens has it.
        parameters = np.where(deviation > 0, lens, perfect)
        stage = smoothed_by(first_stage(some, layout, parameters), _SMOOTHING)
        # Most starts lead nowhere: one look where the dots lie is enough for them.
        tries.append(valley_at(solved(settled(freed(stage, deviation), 1))))
    valleys, others = _finalists(tries, gathered, side_stated)
    return Coarse(valleys, others, side_stated, families)


def with_all_dots(one: Valley, gathered: Gathered) -> Valley:
    """The valley of some dots, solved with all."""
    return valley_at(solved(settled(on_dots(one.stage, gathered))))


def _finalists(
    tries: list[Valley], gathered: Gathered, side_stated: bool
) -> tuple[list[Valley], list[Valley]]:
    """The promising ones, on all dots; and the rest."""
    both_sides = not side_stated
    begun = still_open(tries, _HOPELESS_START, _FINALISTS, both_sides=both_sides)
    ended = [with_all_dots(one, gathered) for one in begun]
    if both_sides:
        ended.append(other_side(deepest(ended)))
    kept = still_open(ended, _HOPELESS, _FINALISTS, both_sides=both_sides)
    return kept, [*left_of(ended, kept), *left_of(tries, begun)]


def _focus_to_try(
    gathered: Gathered, first: FirstDefocus, *, curved: bool
) -> list[Focus]:
    """As defocus is seen; and as it was stated, since aberrations widen what is seen,
    with all takes moved by the same, or with curved fields: those at the end."""
    patterns = _signs(first)
    open_signs = (len(patterns) - 1).bit_length()
    tries = _TRIES[min(open_signs, len(_TRIES) - 1)]
    unit_mm = float(np.max(first.seen_mm))
    as_stated_mm = np.where(first.side_stated, first.stated_mm, first.value_mm)
    begun = (first.value_mm, tries.from_seen), (as_stated_mm, tries.from_stated)
    flat = [
        Focus(defocus_mm * signs + offset * unit_mm)
        for signs in patterns
        for defocus_mm, offsets in begun
        for offset in offsets
    ]
    if not curved:
        return flat
    widths_mm = dot_widths_mm(gathered)
    bent = [
        focus
        for signs in patterns
        for focus in likely_focus(
            gathered, widths_mm, as_stated_mm * signs, tries.curved
        )
    ]
    return flat + bent


def _signs(first: FirstDefocus) -> list[Float[np.ndarray, " groups"]]:
    """Signs to try: every combination for the largest few defocus values that nobody
    stated; others stay as they are."""
    unknown = np.flatnonzero(~first.side_stated)
    unknown = unknown[np.argsort(-np.abs(first.value_mm[unknown]))][:_MOST_SIGNS]
    tries = []
    for flips in itertools.product((1.0, -1.0), repeat=len(unknown)):
        signs = np.ones(len(first.value_mm))
        signs[unknown] = flips
        tries.append(signs)
    return tries
