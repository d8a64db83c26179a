"""The focus coordinate: focus distances as vergence, in which aberrations change.

Where elements move against each other as the lens is focused, aberrations change with
the focus distance d, to first order in proportion to its vergence 1/d. The coordinate
is 0 at the reference state, positive nearer, and at most 1 away from it at the
photographed distances; distances are millimetres from the sensor, as on the barrel.
"""

from collections.abc import Iterable
from typing import NamedTuple


class FocusRange(NamedTuple):
    """The photographed focus distances.

    Attributes
    ----------
    reference_per_mm : Vergence of the reference.
    span_per_mm : Largest difference from it; 0 where one distance is all there is, or
        none is stated.
    """

    reference_per_mm: float
    span_per_mm: float

    @classmethod
    def of(
        cls, reference_mm: float | None, distances_mm: Iterable[float | None]
    ) -> "FocusRange":
        """The range of stated distances about one of them."""
        if not reference_mm:
            return cls(0.0, 0.0)
        away = [abs(1 / d - 1 / reference_mm) for d in distances_mm if d]
        return cls(1 / reference_mm, max(away, default=0.0))

    def coordinate(self, distance_mm: float | None) -> float:
        """Of a focus distance, of one beyond the photographed ones theirs; 0 of one
        that nobody stated."""
        if not distance_mm or not self.span_per_mm:
            return 0.0
        away_per_mm = 1 / distance_mm - self.reference_per_mm
        return min(max(away_per_mm / self.span_per_mm, -1.0), 1.0)
