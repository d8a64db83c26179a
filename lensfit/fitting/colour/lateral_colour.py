"""Lateral colour from detections measured in every channel.

Errors of the chart cancel: the displacement of red from green does not depend on where
a dot was printed. It is linear in the coefficients of `lensfit.optics.lateral` (in this
order: a shift, two of strain, two of decentering, radial ones), and is solved in closed
form with robust weights, for all states of a focal length jointly (`equations`).

Lateral colour need not be centred on the principal point, because tilted elements shift
one against the other. Asymmetric terms are therefore candidates of the model selection
by BIC; a radial formula about the wrong centre has its largest errors at the edge.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from lensfit.fitting.chart_view import View
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
    CENTRED,
    LOPSIDED,
    MOST_RADIAL_TERMS,
    SHIFTED,
    TERMS,
    equations_of,
    normal_equations,
    systematic_of,
    systematic_px,
)
from lensfit.optics.lateral import ChannelShift
from lensfit.optics.many_points import lateral_deviations

_CHANNELS = {"r": 0, "b": 2}
_LEAST_BIC_GAIN = 6.0
_LEAST_SCATTER = 0.01
"""Of the stated variance: channels that are copies of one another differ nowhere."""


@dataclass(frozen=True, eq=False)
class ChannelColour:
    """Lateral displacement of one channel against green.

    Attributes
    ----------
    radial : c0, c1, ..., zero where they were left.
    shift_mm : Constant displacement.
    strain, decentering : As in `lensfit.optics.lateral`; empty when left.
    covariance : Of (shift x, shift y, strain, decentering, c0, c1, ...), in reference
        radii, also of what was left.
    valid_radius : Largest radius measured, in reference radii.
    """

    radial: tuple[float, ...]
    shift_mm: tuple[float, float]
    strain: tuple[float, ...]
    decentering: tuple[float, ...]
    covariance: Float[np.ndarray, "parameters parameters"]
    valid_radius: float

    @property
    def has_terms(self) -> bool:
        """Whether model selection kept any."""
        return any((*self.radial, *self.shift_mm, *self.strain, *self.decentering))

    def radial_px(
        self, radius: Float[np.ndarray, " radii"], px_per_radius: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Outward displacement at radii (in reference radii), and its sigma; px.

        The mean over azimuths, over which shift, strain and decentering cancel.
        """
        powers = radius[:, None] ** (2 * np.arange(len(self.radial)) + 1)
        value = powers @ np.asarray(self.radial) if self.radial else 0 * radius
        part = self.covariance[LOPSIDED:, LOPSIDED:]
        variance = np.einsum("ri,ij,rj->r", powers, part, powers)
        return value * px_per_radius, np.sqrt(np.maximum(variance, 0)) * px_per_radius

    def deviations(
        self, q: Float[np.ndarray, "points 2"]
    ) -> Float[np.ndarray, "points 2"]:
        """Standard deviation along x and y at radius vectors, in reference radii."""
        known = lateral_deviations(
            jnp.asarray(q), self.optics(), jnp.asarray(self.covariance)
        )
        return np.asarray(known)

    def optics(self) -> ChannelShift:
        """The same for computing."""
        strain, decentering = (
            np.array([*part, 0.0, 0.0][:2]) for part in (self.strain, self.decentering)
        )
        return ChannelShift(
            jnp.asarray(np.array(self.radial, float)),
            jnp.asarray(np.array(self.shift_mm)),
            jnp.asarray(self.valid_radius),
            jnp.asarray(strain),
            jnp.asarray(decentering),
        )


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
    whole = together.solution(LOPSIDED, MOST_RADIAL_TERMS, 1.0)
    moves = whole.beta[len(states) * TERMS :]
    chi2 = together.chi2(LOPSIDED, MOST_RADIAL_TERMS, moves)
    scatter = max(chi2 / together.rows, _LEAST_SCATTER)
    level = max(scatter, 1.0)
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
    solution = together.solution(besides, terms, scatter)
    effect_px = systematic_px(states, together)
    found = []
    for k, (one, radius_mm) in enumerate(pairs):
        mine = slice(k * TERMS, (k + 1) * TERMS)
        systematic = systematic_of(states[k], together.weight[k], effect_px)
        covariance = solution.covariance[mine, mine] + systematic
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
