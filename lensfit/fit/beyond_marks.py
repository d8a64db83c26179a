"""How light falls off between the outermost mark and the corner of the frame.

Marks end up to a pitch before the corner. A polynomial goes anywhere there, and its
slope at the last mark is its worst known number. Over its last quarter, in the squared
radius, a straight line through it is known ten times as well, and light of lenses falls
off about as fast from there on: so places beyond the marks are taken to lie on that
line, within a share of what it falls. They stand beside the marks as observations, so
that the deviation that is stated for a corner nobody photographed says so.
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
"""Of what falls off beyond the marks (a rim that begins to clip, or is through with it)
and at the least."""
_SAMPLES = 32


class Beyond(NamedTuple):
    """Places beyond the marks, and the loss expected there.

    Attributes
    ----------
    squared : Radius, in squares of that of the outermost mark.
    loss : Minus the logarithm of the illumination.
    deviation : Of the loss.
    """

    squared: Float[np.ndarray, " places"]
    loss: Float[np.ndarray, " places"]
    deviation: Float[np.ndarray, " places"]


def reach(marks: float, frame: float) -> float:
    """Squared radius up to which fall-off is stated.

    Parameters
    ----------
    marks, frame : Squared radius of the outermost mark and of the farthest corner.
    """
    return max(marks, min(frame, _FARTHEST * marks))


def beyond_marks(control: Float[np.ndarray, " terms"], end: float) -> Beyond:
    """What is expected up to `end`, in squares of the radius of the outermost mark.

    Parameters
    ----------
    control : Of the fall-off of the marks alone.
    """
    squared = np.linspace(1.0, end, _PLACES + 1)[1:]
    seen = np.linspace(1.0 - _TOLD_BY, 1.0, _SAMPLES)
    slope = float(
        np.polyfit(seen, continued_bernstein(seen, len(control)) @ control, 1)[0]
    )
    falls = max(slope, 0.0) * (squared - 1.0)
    return Beyond(squared, control[-1] + falls, _UNSURE * falls + _LEAST_UNSURE)
