"""Detect photographs in which crossings of overlapping blur were taken for dots.

Where discs of blur overlap, the bright lenses between them lie on a lattice of their
own: half way between neighbours, so finer by the square root of two than that of the
dots, and turned by 45 degrees. That photograph alone does not show the error, but a
comparison with the others of the same chart and with the stated distances does.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lensfit.detect.observations import POINT
from lensfit.fitting.chart_view import View

_FINER = 0.6, 0.82
"""Spacing against the others'. Stated distances count from the sensor and not from the
pupil, and lenses breathe, so it is only roughly sqrt(1/2)."""
_TURNED_DEG = 30.0
"""Least turn against the others, of 45 at most; perspective turns by a few."""
_FEWEST = 2
"""Other photographs to compare with."""
_REASON = (
    "blur overlaps, and its bright crossings were taken for dots: they lie closer than "
    "those of the other photographs, and turned by 45 degrees; photograph it less out "
    "of focus or stopped down further"
)


class _Grid(NamedTuple):
    """Spacing over that of a thin lens' image at the stated distance, and the turn."""

    spacing: float
    turn_rad: float


def overlapping_blur_reasons(takes: Sequence[View | None]) -> list[str | None]:
    """For each photograph why its points are crossings; None where they are not.

    Only dots at a stated distance are compared, separately for each target and focal
    length.
    """
    grids = [_grid(take) for take in takes]
    kinds = [take and (take.target, take.focal_length_mm) for take in takes]

    def others(k: int) -> list[_Grid]:
        """Grids of the other photographs of the same chart through the same lens."""
        like = [j for j, kind in enumerate(kinds) if kind == kinds[k] and j != k]
        return [grid for grid in (grids[j] for j in like) if grid is not None]

    crossed = [_is_crossed(grid, others(k)) for k, grid in enumerate(grids)]
    return [_REASON if one else None for one in crossed]


def _is_crossed(grid: _Grid | None, others: list[_Grid]) -> bool:
    if grid is None or len(others) < _FEWEST:
        return False
    finer = grid.spacing / float(np.median([other.spacing for other in others]))
    # A square lattice is the same after a quarter of a turn.
    usual = np.angle(np.mean([np.exp(4j * other.turn_rad) for other in others])) / 4
    turned = abs(np.angle(np.exp(4j * (grid.turn_rad - usual)))) / 4
    low, high = _FINER
    return bool(low < finer < high and turned > np.deg2rad(_TURNED_DEG))


def _grid(take: View | None) -> _Grid | None:
    if take is None or not take.mark_diameter_mm or not take.target_distance_mm:
        return None
    seen = take.observations
    points = seen.family == POINT
    if points.sum() < 4 or not np.isfinite(take.target_distance_mm):
        return None
    lattice = seen.lattice[points] - seen.lattice[points].mean(0)
    seen_mm = seen.points_px[points] * take.pixel_mm * (take.squeeze, 1.0)
    slope = np.linalg.lstsq(lattice, seen_mm - seen_mm.mean(0), rcond=None)[0]
    slope = slope / np.asarray(take.pitch_mm)[:, None]
    size = float(np.sqrt(abs(np.linalg.det(slope))))
    turns = np.exp(4j * np.arctan2(slope[:, 1], slope[:, 0]))
    turn_rad = float(np.angle(turns.sum())) / 4
    magnification = _principal_distance_mm(take) / take.target_distance_mm
    return _Grid(size / magnification, turn_rad)


def _principal_distance_mm(take: View) -> float:
    """Of a thin lens focused as stated; none can be nearer than twice its focal length
    from the sensor and sharp but in macro."""
    focal_mm, focus_mm = take.focal_length_mm, take.focus_distance_mm
    if focus_mm is None or focus_mm <= 2 * focal_mm:
        return focal_mm
    return focal_mm / (1 - focal_mm / focus_mm)
