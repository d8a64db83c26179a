"""Decentring: distortion of elements out of centre, separated from the optical axis.

Tilted and displaced elements cause asymmetric distortion. A wrong principal point,
together with a chart that is not square to the axis, causes nearly the same. Model
selection prefers the fewest terms and can confuse the two: for a random 22 mm lens it
moved the axis by .24 mm, and chief rays by .2 px.

A manufacturing-tolerance prior separates them: decentring terms are small, and so is
the offset of the principal point from the sensor's centre. Where the views tilt enough
to determine the axis, all these terms therefore enter together, each with the tolerance
as its prior width. If the fit gives a larger value for a term, as for a webcam, that
value becomes the width. The terms stay out only if the marginal likelihood is
decisively against all of them, or if their joint effect is too small to be detected.

Elements keep their decentring at every focus distance. Frontal views distinguish
asymmetric distortion from a tilt even less, so a state with frontal views alone takes
over, as a narrow prior, the terms that tilted views at another focus distance
determined, or that they found none.

Anamorphic lenses are out of centre by the same tolerances. Their squeeze and the terms
with two planes of symmetry are theirs by design and stay with model selection.

Reference: on marginal likelihoods, D. J. C. MacKay, Neural Computation 4 (1992) 415.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from lensfit.fitting.adjust import COLLINEAR_DAMPING, Adjustment, adjust
from lensfit.fitting.held_out import explained_by, halves_of, stated_statistics
from lensfit.fitting.parameters import Layout, loose_prior, release
from lensfit.fitting.select import TermDecision

MANUFACTURING_TOLERANCE = {
    "principal_point": 0.01,
    "decentering": 3e-4,
    "thin_prism": 1e-4,
    "anamorphic": 1e-4,
    "squeeze": 1e-4,
}
"""Standard deviations in reference radii. Of five candidate sets this one gave chief
rays nearest to the trace for nine random lenses with manufacturing errors: within .018
px in the median and .078 at most, against .017 and .199 by model selection alone."""
_BY_DESIGN = ("anamorphic", "squeeze")
"""Blocks that no tolerance limits behind cylinders."""
_AT_OTHER_FOCUS = 0.2
"""Share of a term by which it may change with focus distance."""
_DECISIVE = -20.0
"""Twice the logarithm of the Bayes factor; the odds are then e^10 against the terms."""
LEAST_SEEN_PX = 0.004
"""Least joint effect, rms over the detections. For centred lenses noise and detection
errors make .001 to .007, with a Bayes factor decisively against the largest. Free
terms increase the standard deviations of principal distance and entrance pupil."""
TOLERANCE_REASON = "a manufacturing-tolerance prior separates it from the lens' axis"
TAKEN_OVER_REASON = "taken over from tilted views at another focus distance"

DecentringTerms = Mapping[str, Float[np.ndarray, " terms"]]
"""Values of the decentring terms, by block of `tolerances_of`."""


def tolerances_of(layout: Layout) -> Mapping[str, float]:
    """`MANUFACTURING_TOLERANCE` of the blocks that are decentring in this lens."""
    return {
        name: width
        for name, width in MANUFACTURING_TOLERANCE.items()
        if not (layout.anamorphic and name in _BY_DESIGN)
    }


def decentring_of(adjustment: Adjustment) -> DecentringTerms:
    """The decentring terms of a fit."""
    layout = adjustment.layout
    return {
        name: adjustment.parameters[layout.blocks[name]].copy()
        for name in tolerances_of(layout)
    }


def decentring_is_supported(
    adjustment: Adjustment, decisions: list[TermDecision]
) -> bool:
    """Whether model selection kept a decentring term, or all together are plausible."""
    tolerances = tolerances_of(adjustment.layout)
    if any(v.kept for v in decisions if v.term_group in tolerances):
        return True
    free = np.flatnonzero(adjustment.prior.free)
    rows = [np.arange(w.start, w.stop) for w in adjustment.layout.blocks.values()]
    every = np.union1d(free, np.concatenate(rows))
    nothing = np.zeros(0, int)
    loose = loose_prior(adjustment.parameters, adjustment.layout, nothing, every)
    one, other = halves_of(replace(adjustment, prior=loose))
    stated = stated_statistics(adjustment)
    return decentring_is_plausible(
        adjustment,
        one.matrix + other.matrix + stated.matrix,
        one.gradient + other.gradient + stated.gradient,
        explained_by(LEAST_SEEN_PX, adjustment),
    )


def decentring_is_plausible(
    adjustment: Adjustment,
    matrix: Float[np.ndarray, "parameters parameters"],
    gradient: Float[np.ndarray, " parameters"],
    least_fall: float,
) -> bool:
    """Whether all decentring terms together have a detectable effect, and the marginal
    likelihood is not decisively against them.

    Parameters
    ----------
    matrix, gradient : Derivatives of half of chi-squared at the present parameters,
        with all decentring terms free.
    least_fall : Decrease of chi-squared by an effect of `LEAST_SEEN_PX`.
    """
    prior, blocks = adjustment.prior, adjustment.layout.blocks
    tolerances = tolerances_of(adjustment.layout)
    deviation = np.where(prior.free, prior.standard_deviation, 1.0)
    for name, width in tolerances.items():
        deviation[blocks[name]] = width
    # In units of the prior widths, so that the determinant of the priors is 1.
    inside = matrix * np.outer(deviation, deviation)
    pull = gradient * deviation + (adjustment.parameters - prior.mean) / deviation

    def explained(model: Int[np.ndarray, " some"]) -> tuple[float, float]:
        """Decrease of chi-squared, and the Occam factor (log determinant)."""
        block = inside[np.ix_(model, model)] + np.eye(len(model))
        fall = pull[model] @ np.linalg.solve(block, pull[model])
        return float(fall), float(np.linalg.slogdet(block)[1])

    free = np.flatnonzero(prior.free)
    terms = [np.arange(blocks[name].start, blocks[name].stop) for name in tolerances]
    fall, occam = np.subtract(
        explained(np.union1d(free, np.concatenate(terms))), explained(free)
    )
    return bool(fall - occam > _DECISIVE and fall > least_fall)


def adjust_with_decentring(
    adjustment: Adjustment, known: DecentringTerms | None
) -> Adjustment:
    """The fit with all decentring terms free, with priors about zero or known values.

    Without known values the fit is made twice: where the first one exceeds a tolerance,
    the second one has a prior of that width.

    Parameters
    ----------
    known : Terms from tilted views at another focus distance; None if these views tilt.
    """
    if known is not None:
        return _adjusted_about(adjustment, known, _widths(known, _AT_OTHER_FOCUS))
    nothing = {name: np.zeros_like(v) for name, v in decentring_of(adjustment).items()}
    first = _adjusted_about(adjustment, nothing, tolerances_of(adjustment.layout))
    return _adjusted_about(first, nothing, _widths(decentring_of(first)))


def _widths(terms: DecentringTerms, share: float = 1.0) -> Mapping[str, float]:
    """Prior widths: the tolerance, or the rms of the terms if that is larger."""
    return {
        name: share
        * max(MANUFACTURING_TOLERANCE[name], float(np.sqrt(np.mean(values**2))))
        for name, values in terms.items()
    }


def _adjusted_about(
    adjustment: Adjustment, mean: DecentringTerms, widths: Mapping[str, float]
) -> Adjustment:
    """The fit with priors of these means and widths."""
    blocks, prior = adjustment.layout.blocks, adjustment.prior
    parameters, means = adjustment.parameters.copy(), prior.mean.copy()
    for name, width in widths.items():
        prior = release(prior, blocks[name], width)
        means[blocks[name]] = parameters[blocks[name]] = mean[name]
    prior = replace(prior, mean=means)
    started = replace(adjustment, prior=prior, parameters=parameters)
    return adjust(started, rounds=1, damping=COLLINEAR_DAMPING)
