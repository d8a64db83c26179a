"""The way from the first solve to the last: what is free when, and on which dots.

1. `coarse`: smoothed by three cells, a few dots: defocus, rims, third order, from many
   starts.
2. `middle_fit`: smoothed by a cell and a half: fifth order.
3. `fine_fit`: more dots, on full pixels, straight or by way of less smoothed ones:
   everything but what would go astray there (`families.LAST`): the blades of the iris
   are counted, noise and robust weights found anew in between.
4. `asked_for`: without what the photographs do not ask for.
5. `last_fit`: the rest freed; many rays.
"""

from dataclasses import replace

import numpy as np

from lensfit.fitting.select import Verdict
from lensfit.fitting.wavefront.blades import EVIDENTLY, with_blades
from lensfit.fitting.wavefront.dot_weights import MODEL_SHARE, first_weights
from lensfit.fitting.wavefront.multistart import DECISIVE, other_side, valley_at
from lensfit.fitting.wavefront.normal import Points
from lensfit.fitting.wavefront.stages import (
    Stage,
    best_of,
    chi_squared,
    freed,
    reweighed,
    settled,
    smoothed_by,
    solved,
)
from lensfit.fitting.wavefront.term_group_selection import choose
from lensfit.fitting.wavefront.term_groups import (
    FINE,
    LAST,
    MIDDLE,
    Family,
    deviation_of,
)

_BETWEEN = 5
"""Passes between two findings of weights."""
_UNFORESEEN = 1.2
"""How much worse than foreseen a fit may be without what was left out."""
_NEEDED = "the fit without all that was to go was worse than foreseen"
_MIDDLE_SMOOTHING = 1.5
"""Cells: half of the coarse solve's, for orders twice as fine."""
_FINE_SMOOTHING = 0.75
"""Half of that again. A lens photographed wide open alone was led astray straight on
full pixels, and a twentieth of the misfit was left where this came between; dots of
less than a pixel are fitted better without. So both ways are tried."""
_LAST_STEPS, _LAST_TOLERANCE = 24, 5e-4
_LAST_POINTS = Points(image=1536, design=768)
"""Shifting all rays of the pupil together, rims included, hardly changes an image. Few
rays make that valley look steep: a fit would end on its way along it, and believe that
it knows the place. As level as it is, it takes more passes and a finer tolerance: six
passes ended too early on most hard cases, twelve on the bundled shoot."""


def middle_fit(coarse: Stage, families: tuple[Family, ...]) -> Stage:
    """Fifth order on less smoothed dots."""
    stage = smoothed_by(coarse, _MIDDLE_SMOOTHING)
    stage = freed(stage, deviation_of(families, stage.layout, MIDDLE))
    return solved(solved(stage))


def fine_fit(stage: Stage, families: tuple[Family, ...], rounds: int) -> Stage:
    """Everything on full pixels; the blades as soon as the rest is nearly right.

    Parameters
    ----------
    stage : On the dots to fit.
    rounds : Of weights found anew.
    """
    stage = freed(stage, deviation_of(families, stage.layout, FINE))
    eased = solved(settled(smoothed_by(stage, _FINE_SMOOTHING)))
    on_pixels = [settled(smoothed_by(start, 0.0)) for start in (stage, eased)]
    stage = best_of([solved(start) for start in on_pixels])
    stage = solved(with_blades(stage, EVIDENTLY))
    if not stage.blades:
        stage = with_blades(stage)
    for _ in range(rounds):
        stage = reweighed(solved(stage, _BETWEEN), MODEL_SHARE)
    return solved(stage)


def fair_cost(stage: Stage) -> float:
    """What it leaves of the photographs, in weights that no fit has had a part in."""
    weight = first_weights(stage.gathered, MODEL_SHARE)
    return chi_squared(settled(replace(stage, weight=weight), 1))


def suits_other_side(fine: Stage) -> bool:
    """Whether a lens on the other side of focus explains the dots decisively better."""
    other = other_side(valley_at(fine))
    return fair_cost(other.stage) * DECISIVE < fair_cost(fine)


def asked_for(
    fine: Stage, families: tuple[Family, ...]
) -> tuple[Stage, tuple[Family, ...], tuple[Verdict, ...]]:
    """With only the families that stay, if that fit is as good as was foreseen.

    Returns
    -------
    The fit, the families that are free in it, and what came of each that was tried.
    """
    kept, verdicts, foreseen = choose(fine, families)
    deviation = deviation_of(kept, fine.layout, FINE)
    dropped = (fine.deviation > 0) & (deviation == 0)
    if not dropped.any():
        return fine, kept, verdicts
    parameters = np.where(dropped, fine.mean, fine.parameters)
    stage = freed(replace(fine, parameters=parameters), deviation)
    stage = solved(solved(stage))
    # What was foreseen comes from second derivatives, which may be wrong far off; and
    # a solve that failed is no better than its NaN.
    if not chi_squared(stage) <= _UNFORESEEN * foreseen:
        return fine, families, tuple(v.kept_all_the_same(_NEEDED) for v in verdicts)
    return stage, kept, verdicts


def last_fit(stage: Stage, families: tuple[Family, ...]) -> Stage:
    """Everything that stays, with as many rays as it takes."""
    stage = freed(stage, deviation_of(families, stage.layout, LAST))
    stage = replace(stage, points=_LAST_POINTS)
    # Seen once more from where the patches have been moved to.
    return settled(solved(stage, _LAST_STEPS, _LAST_TOLERANCE), 1)
