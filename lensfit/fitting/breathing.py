"""Breathing: the change of image scale with focus distance.

A lens that moves as a whole moves away from the sensor for near focus, and its image
becomes larger. With internal focusing the image may become smaller. Where the blur is
slight, breathing is the only sign of a shoot whose near and far focus distances were
swapped, because a mirrored lens explains the blur of both about as well
(`wavefront.descent`).

By first-order optics (`optics.paraxial`) the principal distance c of a lens that is
focused at a distance z from its entrance pupil is

    1 / c = 1 / f - 1 / (m_p z),

f its focal length at infinity, m_p its pupil magnification. With elements that move
against each other the line still ends in f at infinity, and its slope is what breathing
makes of m_p. The beam that an f-number stands for, f over the pupil's diameter, follows
from f: at a near focus it differs by the whole of breathing.
"""

from collections.abc import Iterable

import numpy as np
from jaxtyping import Float

from lensfit.fitting.lens_state import LensState, states_by_focal_length
from lensfit.fitting.statements import PUPIL_MAGNIFICATION_WIDTH

_REVERSED = 0.003
"""Of the principal distance: well above what distances are measured to."""
_MEASURED = 0.001
"""Standard deviation of a principal distance against those at other focus distances, as
a share: charts stay where they are, and the line is one to first order alone."""


def inverse_pupil_magnification(
    principal_distance_mm: Float[np.ndarray, " states"],
    from_pupil_per_mm: Float[np.ndarray, " states"],
    focal_length_mm: float,
    focal_length_width: float,
) -> float:
    """1 / m_p of the line through all focus distances, any sign.

    Parameters
    ----------
    from_pupil_per_mm : 1 / z of every focus distance.
    focal_length_mm, focal_length_width : As stated, and its standard deviation as a
        share: all there is beside usual lenses where one focus distance is known.
    """
    per_mm = 1 / principal_distance_mm
    design = np.stack([np.ones_like(per_mm), -from_pupil_per_mm], -1)
    weight = (principal_distance_mm / _MEASURED) ** 2
    stated = np.array([1 / focal_length_mm, 1.0])
    width = np.array([focal_length_width / focal_length_mm, PUPIL_MAGNIFICATION_WIDTH])
    matrix = design.T @ (weight[:, None] * design) + np.diag(width**-2)
    vector = design.T @ (weight * (per_mm - design @ stated))
    return float(1 + np.linalg.solve(matrix, vector)[1])


def reversed_breathing(states: Iterable[LensState]) -> dict[float, str]:
    """A sentence for each focal length that draws larger focused far than near.

    Lenses that focus inside do, and so does a shoot whose near and far focus distances
    were swapped: blur alone tells which (`wavefront.descent.other_side_cost`). Only
    where the chart's distance was measured: the principal distance is taken from the
    stated focus otherwise.
    """
    found = {}
    for focal_mm, mine in states_by_focal_length(states).items():
        known = [
            (state.focus_distance_mm, float(state.distortion.principal_distance_mm))
            for state in mine
            if state.focus_distance_mm is not None and _has_measured_distance(state)
        ]
        if len(known) < 2:
            continue
        (near_mm, near), (far_mm, far) = min(known), max(known)
        if far > (1 + _REVERSED) * near:
            found[focal_mm] = (
                f"at {focal_mm:g} mm the picture is {100 * (far / near - 1):.1f} % "
                f"larger focused at {far_mm:g} mm than at {near_mm:g} mm, as only of "
                "lenses that focus inside"
            )
    return found


def _has_measured_distance(state: LensState) -> bool:
    return any(view.target_distance_mm is not None for view in state.geometry.takes)
