"""How much work the wavefront fit may be: speed against error."""

import math
from enum import Enum

_USUAL_TAKES = 7
"""Whose dots together are fitted of a lens with fewer takes too."""


class Effort(Enum):
    """Speed against error: dots of each take in the coarse and in the fine stages,
    where there are as many takes as usual, and rounds of the fine one with weights
    found anew between them."""

    FASTEST = (6, 6, 1)
    FAST = (6, 12, 2)
    NORMAL = (8, 20, 3)
    BEST = (8, 48, 4)

    def __init__(self, coarse_dots: int, fine_dots: int, rounds: int):
        self.coarse_dots = coarse_dots
        self.fine_dots = fine_dots
        self.rounds = rounds

    def of_each(self, dots: int, takes: int) -> int:
        """Dots of each of so many takes: more where there are few takes.

        Parameters
        ----------
        dots : `coarse_dots` or `fine_dots`.
        """
        return max(dots, math.ceil(dots * _USUAL_TAKES / takes))

    @classmethod
    def named(cls, name: str) -> "Effort":
        """That of a setting: "fastest", "fast", "normal" or "best".

        Raises
        ------
        KeyError : There is none of that name.
        """
        return cls[name.upper()]
