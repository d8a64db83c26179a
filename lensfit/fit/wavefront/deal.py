"""How dots are dealt among the cores: each takes every so many-th."""

from functools import cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Int


class Deal(NamedTuple):
    """Which dot lies where in the arrays of a pass.

    Attributes
    ----------
    rows : Of every place the dot; places that are left over repeat a dot.
    counts : Places in use of each core's share; they come first in it.
    """

    rows: Int[np.ndarray, " room"]
    counts: Int[np.ndarray, " cores"]

    def places(self) -> Int[np.ndarray, " dots"]:
        """Of every dot the place where it is in use."""
        share = len(self.rows) // len(self.counts)
        used = np.arange(len(self.rows)) % share < np.repeat(self.counts, share)
        places = np.empty(int(self.counts.sum()), int)
        places[self.rows[used]] = np.flatnonzero(used)
        return places


@cache
def dealt(dots: int, room: int, hands: int) -> Deal:
    """Every dot to one of so many hands, as evenly as can be."""
    shares = [np.arange(hand, dots, hands) for hand in range(hands)]
    space = room // hands
    rows = [np.resize(share if len(share) else [0], space) for share in shares]
    return Deal(np.concatenate(rows), np.array([len(share) for share in shares]))
