"""Effort of the wavefront fit: speed against error."""

import math
from enum import Enum

_USUAL_TAKES = 7
"""Of a lens. One with fewer is fitted to as many dots."""


class Effort(Enum):
    """Speed against error: dots of each of seven takes in the coarse and in the fine
    stages, and rounds of the fine one with robust weights updated between them. NONE
    leaves the wavefront out."""

    NONE = (0, 0, 0)
    FASTEST = (6, 6, 1)
    FAST = (6, 12, 2)
    NORMAL = (8, 20, 3)
    BEST = (8, 48, 4)

    def __init__(self, coarse_dots: int, fine_dots: int, rounds: int):
        self._coarse_dots = coarse_dots
        self._fine_dots = fine_dots
        self.rounds = rounds

    def coarse_dots(self, takes: int) -> int:
        """Of each of so many takes, in the coarse stages."""
        return _dots_per_take(self._coarse_dots, takes)

    def fine_dots(self, takes: int) -> int:
        """Of each of so many takes, in the fine stages."""
        return _dots_per_take(self._fine_dots, takes)

    @classmethod
    def from_name(cls, name: str) -> "Effort":
        """The effort called "none", "fastest", "fast", "normal" or "best".

        Raises
        ------
        KeyError : There is none of that name.
        """
        return cls[name.upper()]


def _dots_per_take(dots: int, takes: int) -> int:
    """More where there are few takes."""
    return max(dots, math.ceil(dots * _USUAL_TAKES / takes))
