"""Lateral colour from the same marks measured in every channel.

The chart cancels: red minus green of one dot does not depend on where the dot was
printed. What remains is linear in the coefficients of `lensfit.optics.lateral`, so it
is solved in closed form with robust weights.

Colour need not be centred on the principal point: tilted elements move the one without
the other. Where the evidence asks for it the terms of such a lens are fitted too, since
a radial formula about the wrong point misses most where it matters, at the edge.
"""

import numpy as np
from jaxtyping import Float

from lensfit.fit.colour.channel_colour import (
    CENTRED,
    LOPSIDED,
    SHIFTED,
    ChannelColour,
)
from lensfit.fit.colour.coloured_marks import (
    FEWEST_MARKS,
    ColouredMarks,
    LeftOut,
    chosen,
    joined,
    marks_of,
    touched,
    touched_or_clipped,
)
from lensfit.fit.colour.equations import (
    MOST_RADIAL_TERMS,
    equations_of,
    rows_in,
    solve,
    systematic_of,
)
from lensfit.fit.take import Take

_LEAST_BIC_GAIN = 6.0


def fit_colour(
    takes: tuple[Take, ...],
    principal_point_mm: Float[np.ndarray, "2"],
    reference_radius_mm: float,
) -> dict[str, ChannelColour]:
    """Red and blue against green; empty when the photographs have no colour.

    Clipped marks are used where there are too few others. What is cut off a lopsided
    spot moves its centroid by tenths of a pixel, but much alike in all channels.
    """
    for left_out in (touched_or_clipped, touched):
        found = _of_marks(takes, left_out, principal_point_mm, reference_radius_mm)
        if found:
            return found
    return {}


def _of_marks(
    takes: tuple[Take, ...],
    left_out: LeftOut,
    principal_point_mm: Float[np.ndarray, "2"],
    reference_radius_mm: float,
) -> dict[str, ChannelColour]:
    """Of all marks but some; empty when there are too few."""
    found = {}
    coloured = chosen(takes, left_out)
    for channel, index in (("r", 0), ("b", 2)):
        every = [marks_of(t, index, left_out, principal_point_mm) for t in coloured]
        seen = [marks for marks in every if len(marks.place_mm)]
        if not seen or sum(len(marks.place_mm) for marks in seen) < FEWEST_MARKS:
            return {}
        found[channel] = _fit(joined(seen), reference_radius_mm)
    return found


def _fit(marks: ColouredMarks, reference_radius_mm: float) -> ChannelColour:
    """Smallest model that BIC prefers.

    Squared residuals are cut at four times the spread of the largest model, so that
    a few bad marks decide nothing.
    """
    models = [
        (besides, terms)
        for besides in (CENTRED, SHIFTED, LOPSIDED)
        for terms in range(MOST_RADIAL_TERMS + 1)
    ]
    equations = equations_of(marks, reference_radius_mm)
    solved = [solve(equations, *model) for model in models]
    limit = 16 * np.median(solved[-1].squared) / np.log(4)
    count = rows_in(marks.normal)
    best = None
    for (besides, terms), solution in zip(models, solved, strict=True):
        squared = np.minimum(solution.squared, limit)
        level = np.mean(squared) + (1e-3 * equations.px) ** 2
        bic = count * np.log(level) + (besides + terms) * np.log(count)
        if best is None or bic < best[0] - _LEAST_BIC_GAIN:
            best = (bic, solution, besides)
    assert best is not None
    _, (beta, covariance, *_), besides = best
    covariance = covariance + systematic_of(equations, solved[-1].weight)
    lopsided = tuple(beta[SHIFTED:LOPSIDED].tolist()) if besides == LOPSIDED else ()
    radius = np.hypot(*(marks.place_mm / reference_radius_mm).T)
    return ChannelColour(
        radial=tuple(beta[LOPSIDED:].tolist()),
        shift_mm=tuple((beta[:SHIFTED] * reference_radius_mm).tolist()),
        strain=lopsided[:2],
        decentering=lopsided[2:],
        covariance=covariance,
        valid_radius=float(radius.max()),
    )
