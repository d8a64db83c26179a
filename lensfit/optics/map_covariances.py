"""Covariances of the parameters of the maps of a lens."""

import equinox as eqx
import numpy as np
from jaxtyping import Float


class MapCovariances(eqx.Module):
    """How well the numbers of a lens' maps are known; None where nobody knows.

    Attributes
    ----------
    distortion : Of the numbers of `position_deviation.changed_distortion`.
    perspective : Of those numbers, and of entrance-pupil offset and shift in mm.
    red, blue : Of the terms of `lensfit.optics.lateral.displacement_basis`.
    fall_off : Of the control values of each channel.
    """

    distortion: Float[np.ndarray, "numbers numbers"] | None = None
    perspective: Float[np.ndarray, "numbers numbers"] | None = None
    red: Float[np.ndarray, "terms terms"] | None = None
    blue: Float[np.ndarray, "terms terms"] | None = None
    fall_off: Float[np.ndarray, "3 terms terms"] | None = None
