"""What elements out of centre do to a map, kept apart from the lens' axis.

Tilted and displaced elements distort lopsidedly. So does a principal point that is
wrong, with a chart that is not square to the axis; evidence, which looks for the fewest
terms, takes the one for the other: the axis of a random 22 mm lens went .24 mm astray,
for which chief rays were .2 px from where they land. What tells them apart is what a
workshop leaves: terms of elements out of centre are small, and so is a principal point
off the sensor's centre. So where views tilt enough to tell the axis, all these terms
enter together, each with that for a prior, or with what the lens has more of one, as a
webcam's has. No lens is quite without: they stay out only where evidence is decisive
against all of them, or where all they do could not be seen. The glass is the same at
every focus: states that saw frontal views alone, which tell lopsided distortion from a
tilt even less, take over what tilted views of another state told, but for little.

Reference: on evidence with priors, D. J. C. MacKay, Neural Computation 4 (1992) 415.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from lensfit.fitting.adjust import VALLEY_DAMPING, Adjustment, adjust
from lensfit.fitting.half_equations import explained_by, halves_of, stated_statistics
from lensfit.fitting.priors import loose_prior, release
from lensfit.fitting.select import Verdict

WORKSHOP = {
    "principal_point": 0.01,
    "decentering": 3e-4,
    "thin_prism": 1e-4,
    "anamorphic": 1e-4,
    "squeeze": 1e-4,
}
"""Standard deviations in reference radii. Of five such sets the one whose chief rays
were nearest to the trace, of nine random lenses with a workshop's errors: within .018
px in the median and .078 at most, where evidence alone left .017 and .199."""
_AT_OTHER_FOCUS = 0.2
"""How much of that changes with focus."""
_DECISIVE = -20.0
"""Evidence, on the scale of chi-squared, at which odds are e^10 against."""
LEAST_SEEN_PX = 0.004
"""Root mean square over the marks. Of centred lenses noise and detection made .001 to
.007, with evidence decisive against the largest; and what is free leaves the principal
distance, and with it the entrance pupil, unsure."""
WHY = "small as a workshop leaves it, lest it be taken for the lens' axis"

OutOfCentre = Mapping[str, Float[np.ndarray, " terms"]]
"""Values of the blocks of `WORKSHOP`."""


def told_by(adjustment: Adjustment) -> OutOfCentre:
    """What a fit of tilted views says."""
    blocks = adjustment.layout.blocks
    return {name: adjustment.parameters[blocks[name]].copy() for name in WORKSHOP}


def asks_for_all(adjustment: Adjustment, verdicts: list[Verdict]) -> bool:
    """Whether evidence asks for one of these terms, or bears out all together.

    Not of a lens with cylinders, which is so made.
    """
    if adjustment.layout.anamorphic:
        return False
    if any(v.kept for v in verdicts if v.family in WORKSHOP):
        return True
    free = np.flatnonzero(adjustment.prior.free)
    rows = [np.arange(w.start, w.stop) for w in adjustment.layout.blocks.values()]
    every = np.union1d(free, np.concatenate(rows))
    nothing = np.zeros(0, int)
    loose = loose_prior(adjustment.parameters, adjustment.layout, nothing, every)
    one, other = halves_of(replace(adjustment, prior=loose))
    stated = stated_statistics(adjustment)
    return borne_out(
        adjustment,
        one.matrix + other.matrix + stated.matrix,
        one.gradient + other.gradient + stated.gradient,
        explained_by(LEAST_SEEN_PX, adjustment),
    )


def borne_out(
    adjustment: Adjustment,
    matrix: Float[np.ndarray, "parameters parameters"],
    gradient: Float[np.ndarray, " parameters"],
    least_fall: float,
) -> bool:
    """Whether all of these terms together have an effect that can be seen, and the
    marks are not decisive against them.

    Parameters
    ----------
    matrix, gradient : Of chi-squared, halved, at the present parameters and with all
        of these terms free.
    least_fall : Of chi-squared by an effect of `LEAST_SEEN_PX`.
    """
    prior, blocks = adjustment.prior, adjustment.layout.blocks
    deviation = np.where(prior.free, prior.standard_deviation, 1.0)
    for name, width in WORKSHOP.items():
        deviation[blocks[name]] = width
    # In units of the priors, whose determinant is 1 then.
    inside = matrix * np.outer(deviation, deviation)
    pull = gradient * deviation + (adjustment.parameters - prior.mean) / deviation

    def explained(model: Int[np.ndarray, " some"]) -> tuple[float, float]:
        """Fall of chi-squared, and the price of freedom."""
        block = inside[np.ix_(model, model)] + np.eye(len(model))
        fall = pull[model] @ np.linalg.solve(block, pull[model])
        return float(fall), float(np.linalg.slogdet(block)[1])

    free = np.flatnonzero(prior.free)
    terms = [np.arange(blocks[name].start, blocks[name].stop) for name in WORKSHOP]
    fall, price = np.subtract(
        explained(np.union1d(free, np.concatenate(terms))), explained(free)
    )
    return bool(fall - price > _DECISIVE and fall > least_fall)


def with_elements_out_of_centre(
    adjustment: Adjustment, told: OutOfCentre | None
) -> Adjustment:
    """The fit with all these terms free, about zero or about what was told.

    A lens that has more of one of them than a workshop leaves says so itself: once
    more, with priors as wide as that.

    Parameters
    ----------
    told : By tilted views of another focus; None where these views tilt themselves.
    """
    if told is not None:
        return _about(adjustment, told, _widths(told, _AT_OTHER_FOCUS))
    nothing = {name: np.zeros_like(v) for name, v in told_by(adjustment).items()}
    first = _about(adjustment, nothing, WORKSHOP)
    return _about(first, nothing, _widths(told_by(first)))


def _widths(told: OutOfCentre, share: float = 1.0) -> Mapping[str, float]:
    """Of the priors: a workshop's, or what a lens has more than that."""
    return {
        name: share * max(deviation, float(np.sqrt(np.mean(told[name] ** 2))))
        for name, deviation in WORKSHOP.items()
    }


def _about(
    adjustment: Adjustment, mean: OutOfCentre, widths: Mapping[str, float]
) -> Adjustment:
    """The fit with these priors."""
    blocks, prior = adjustment.layout.blocks, adjustment.prior
    parameters, means = adjustment.parameters.copy(), prior.mean.copy()
    for name, width in widths.items():
        prior = release(prior, blocks[name], width)
        means[blocks[name]] = parameters[blocks[name]] = mean[name]
    prior = replace(prior, mean=means)
    started = replace(adjustment, prior=prior, parameters=parameters)
    return adjust(started, rounds=1, damping=VALLEY_DAMPING)
