"""How light falls off between the outermost mark and the corner of the frame.

Marks end up to a pitch before the corner. A polynomial goes anywhere there, and its
slope at the last mark is its worst known number. Over its last quarter, in the squared
radius, a straight line through it is known ten times as well, and light of lenses falls
off about as fast from there on: so what falls beyond the marks is taken to fall with
the slope of that line, within a share of it. How much light is left at the outermost
mark is the marks' to say. Places beyond it stand beside the marks as observations. Each
counts by itself, lest a polynomial that cannot follow the marks bend there at the price
of one; but their errors are one error of the slope, and the deviation that is stated
for a corner nobody photographed says so.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lensfit.optics.bernstein import continued_bernstein

_FARTHEST = 1.7
"""Of the squared radius of the outermost mark; farther out the polynomial's own last
slope goes on."""
_PLACES = 6
_TOLD_BY = 0.25
"""Share of the squared radius, at its end, that tells the slope."""
_UNSURE, _LEAST_UNSURE = 0.2, 1e-3
"""Of the slope (a rim that begins to clip beyond the marks, or is through with it), and
of each place by itself."""
_SAMPLES = 32


class Beyond(NamedTuple):
    """Places beyond the marks, and how much more is expected to be lost there.

    Attributes
    ----------
    squared : Radius, in squares of that of the outermost mark.
    falls : Minus the logarithm of the illumination, less that at the outermost mark.
    deviation : Of that, by which each place counts.
    covariance : Of its errors.
    """

    squared: Float[np.ndarray, " places"]
    falls: Float[np.ndarray, " places"]
    deviation: Float[np.ndarray, " places"]
    covariance: Float[np.ndarray, "places places"]


NOTHING_BEYOND = Beyond(np.zeros(0), np.zeros(0), np.zeros(0), np.zeros((0, 0)))


def reach(marks: float, frame: float) -> float:
    """Squared radius up to which fall-off is stated.

    Parameters
    ----------
    marks, frame : Squared radius of the outermost mark and of the farthest corner.
    """
    return max(marks, min(frame, _FARTHEST * marks))


def beyond_marks(
    control: Float[np.ndarray, " terms"],
    covariance: Float[np.ndarray, "terms terms"],
    end: float,
) -> Beyond:
    """What is expected up to `end`, in squares of the radius of the outermost mark.

    Parameters
    ----------
    control, covariance : Of the fall-off of the marks alone.
    """
    squared = np.linspace(1.0, end, _PLACES + 1)[1:]
    seen = np.linspace(1.0 - _TOLD_BY, 1.0, _SAMPLES)
    slope_of = np.polyfit(seen, continued_bernstein(seen, len(control)), 1)[0]
    slope = max(float(slope_of @ control), 0.0)
    unsure = (_UNSURE * slope) ** 2 + float(slope_of @ covariance @ slope_of)
    out = squared - 1.0
    own = _LEAST_UNSURE**2 * np.eye(_PLACES)
    return Beyond(
        squared,
        slope * out,
        _UNSURE * slope * out + _LEAST_UNSURE,
        unsure * np.outer(out, out) + own,
    )
