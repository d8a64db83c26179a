"""How well the maps of a turned lens are known.

A gain multiplies the numbers that were measured, and so their deviations. An amount
that somebody stated was not measured, and fall-off is turned by its parts, which no
photograph shows by themselves: how well these are known nobody can say.
"""

import numpy as np
from jaxtyping import Float

from lensfit.lens import Lens
from lensfit.optics.map_covariances import MapCovariances
from lensfit.optics.object_deviation import PERSPECTIVE_NUMBERS
from lensfit.optics.position_deviation import gain_of_numbers
from lensfit.preset.aberration_knobs import AberrationKnobs
from lensfit.preset.adjusted_chief_rays import lateral_gains

Matrix = Float[np.ndarray, "numbers numbers"]


def turned_covariances(
    lens: Lens, turned: Lens, knobs: AberrationKnobs
) -> MapCovariances:
    """Of the maps of a lens as it was turned.

    Parameters
    ----------
    lens : As it was measured.
    turned : The same with its maps turned.
    """
    known = lens.covariances
    of_numbers = gain_of_numbers(lens.distortion, knobs.distortion_gain)
    with_pupil = np.append(of_numbers, np.ones(PERSPECTIVE_NUMBERS))
    is_stated = knobs.distortion_percent is not None
    red_gain, blue_gain = lateral_gains(knobs)
    light_stays = turned.illumination is lens.illumination
    return MapCovariances(
        distortion=None if is_stated else _grown(known.distortion, of_numbers),
        perspective=None if is_stated else _grown(known.perspective, with_pupil),
        red=None if knobs.lateral_red_um is not None else _grown(known.red, red_gain),
        blue=None
        if knobs.lateral_blue_um is not None
        else _grown(known.blue, blue_gain),
        fall_off=known.fall_off if light_stays else None,
    )


def _grown(covariance: Matrix | None, gain: np.ndarray | float) -> Matrix | None:
    """Of numbers that are multiplied: all of them by one gain, or each by its own."""
    if covariance is None:
        return None
    each = np.broadcast_to(gain, len(covariance))
    return covariance * np.outer(each, each)
