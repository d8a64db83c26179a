"""How dots are dealt among the cores: each takes every so many-th."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Int


class Deal(NamedTuple):
    """Which dot lies where in the arrays of a pass.

    Attributes
    ----------
    rows : Of every place the dot; places that are left over repeat a dot.
    places : Of every dot the place where it is in use.
    counts : Places in use of each core's share; they come first in it.
    """

    rows: Int[np.ndarray, " room"]
    places: Int[np.ndarray, " dots"]
    counts: Int[np.ndarray, " cores"]


def dealt(dots: int, room: int, hands: int) -> Deal:
    """Every dot to one of so many hands, as evenly as can be.

    Parameters
    ----------
    room : Places of all hands together, a multiple of `hands`.
    """
    space = room // hands
    dot = np.arange(dots)
    places = dot % hands * space + dot // hands
    rows = np.zeros(room, int)
    rows[places] = dot
    return Deal(rows, places, np.bincount(dot % hands, minlength=hands))
