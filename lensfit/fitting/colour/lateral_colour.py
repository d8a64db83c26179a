"""Lateral colour from detections measured in every channel.

Errors of the chart cancel: the displacement of red from green does not depend on where
a dot was printed. It is linear in the coefficients of `lensfit.optics.lateral`, and is
solved in closed form with robust weights, for all states of a focal length jointly
(`equations`).

Lateral colour need not be centred on the principal point, because tilted elements shift
one against the other. Asymmetric terms are therefore candidates of the model selection
by BIC; a radial formula about the wrong centre has its largest errors at the edge.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lensfit.fitting.chart_view import View
from lensfit.fitting.colour.channel_colour import (
    CENTRED,
    LOPSIDED,
    SHIFTED,
    ChannelColour,
)
from lensfit.fitting.colour.coloured_detections import (
    FEWEST_DETECTIONS,
    ColouredDetections,
    colour_takes,
    detections_of,
    joined_detections,
    overlapping,
    overlapping_or_saturated,
)
from lensfit.fitting.colour.equations import (
    MOST_RADIAL_TERMS,
    TERMS,
    equations_of,
    normal_equations,
    systematic_of,
)

_CHANNELS = {"r": 0, "b": 2}
_LEAST_BIC_GAIN = 6.0


class Views(NamedTuple):
    """The photographs of one state.

    Attributes
    ----------
    takes : All of them.
    principal_point_mm, reference_radius_mm : About which colour is expanded, and in
        which unit.
    """

    takes: tuple[View, ...]
    principal_point_mm: Float[np.ndarray, "2"]
    reference_radius_mm: float


def fit_colours(states: Sequence[Views]) -> list[dict[str, ChannelColour]]:
    """Red and blue against green, for states of one focal length; empty for those whose
    photographs have no colour."""
    detections = [_detections_of(state) for state in states]
    found: list[dict[str, ChannelColour]] = [{} for _ in states]
    seen = [k for k, of_state in enumerate(detections) if of_state]
    for channel in _CHANNELS if seen else ():
        of_states = _fit(
            [detections[k][channel] for k in seen],
            [states[k].reference_radius_mm for k in seen],
        )
        for k, colour in zip(seen, of_states, strict=True):
            found[k][channel] = colour
    return found


def _detections_of(state: Views) -> dict[str, ColouredDetections]:
    """Of red and of blue; empty where there are too few of either.

    Clipped detections are used where there are too few others. What is cut off a
    lopsided spot moves its centroid by tenths of a pixel, but much alike in all
    channels.
    """
    for left_out in (overlapping_or_saturated, overlapping):
        coloured = colour_takes(state.takes, left_out)
        every = {
            channel: [
                detections_of(take, index, left_out, state.principal_point_mm)
                for take in coloured
            ]
            for channel, index in _CHANNELS.items()
        }
        counts = [sum(len(m.place_mm) for m in mine) for mine in every.values()]
        if min(counts) >= FEWEST_DETECTIONS:
            return {channel: joined_detections(mine) for channel, mine in every.items()}
    return {}


def _fit(
    detections: Sequence[ColouredDetections], reference_radius_mm: Sequence[float]
) -> list[ChannelColour]:
    """Smallest model that BIC prefers, the same for all states.

    Robust weights are those of the largest model, so that a few bad detections decide
    nothing.
    """
    pairs = list(zip(detections, reference_radius_mm, strict=True))
    states = [equations_of(one, radius_mm) for one, radius_mm in pairs]
    together = normal_equations(states)
    moves = together.solution(LOPSIDED, MOST_RADIAL_TERMS).beta[len(states) * TERMS :]
    chi2 = together.chi2(LOPSIDED, MOST_RADIAL_TERMS, moves)
    level = max(chi2 / together.rows, 1.0)
    best = None
    for besides in (CENTRED, SHIFTED, LOPSIDED):
        for terms in range(MOST_RADIAL_TERMS + 1):
            # Held, lest moves stand for a term that is left out.
            chi2 = together.chi2(besides, terms, moves)
            coefficients = len(states) * (besides + terms)
            bic = chi2 / level + coefficients * np.log(together.rows)
            if best is None or bic < best[0] - _LEAST_BIC_GAIN:
                best = (bic, besides, terms)
    assert best is not None
    _, besides, terms = best
    solution = together.solution(besides, terms)
    found = []
    for k, (one, radius_mm) in enumerate(pairs):
        mine = slice(k * TERMS, (k + 1) * TERMS)
        covariance = solution.covariance[mine, mine] * level
        covariance = covariance + systematic_of(states[k], together.weight[k])
        found.append(_channel(solution.beta[mine], covariance, besides, one, radius_mm))
    return found


def _channel(
    beta: Float[np.ndarray, " terms"],
    covariance: Float[np.ndarray, "terms terms"],
    besides: int,
    detections: ColouredDetections,
    reference_radius_mm: float,
) -> ChannelColour:
    lopsided = tuple(beta[SHIFTED:LOPSIDED].tolist()) if besides == LOPSIDED else ()
    radius = np.hypot(*(detections.place_mm / reference_radius_mm).T)
    return ChannelColour(
        radial=tuple(beta[LOPSIDED:].tolist()),
        shift_mm=tuple((beta[:SHIFTED] * reference_radius_mm).tolist()),
        strain=lopsided[:2],
        decentering=lopsided[2:],
        covariance=covariance,
        valid_radius=float(radius.max()),
    )
