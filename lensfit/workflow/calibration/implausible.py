"""Photographs in which something else than the target was taken for its marks.

Where discs of blur overlap, the lenses between them are brighter than the discs and lie
on a lattice of their own, finer and turned. Nothing on that photograph gives it away;
but a chart at a stated distance has marks at a known spacing, and so have the other
photographs.
"""

from collections.abc import Sequence

import numpy as np

from lensfit.detect.observations import POINT
from lensfit.fit.take import Take

_MOST_APART = 0.2
"""Share by which spacing may differ from what the others say. A tilted chart, the far
ends of a fisheye and breathing stay below it; a wrong lattice is off by 1/sqrt(2)."""
_FEWEST = 3
"""Photographs that can outvote one."""


def why_implausible(takes: Sequence[Take | None]) -> list[str | None]:
    """For each photograph why it contradicts the others; None where it does not.

    Only photographs with a stated target distance have a say, those of each target and
    focal length by themselves.
    """
    spacing = [_spacing_as_stated(take) for take in takes]
    kinds = [take and (take.target, take.focal_length_mm) for take in takes]
    found: list[str | None] = []
    for own, kind in zip(spacing, kinds, strict=True):
        alike = [s for s, k in zip(spacing, kinds, strict=True) if k == kind and s]
        enough = own is not None and len(alike) >= _FEWEST
        apart = own / float(np.median(alike)) - 1 if own and enough else 0.0
        found.append(_reason(apart) if abs(apart) > _MOST_APART else None)
    return found


def _spacing_as_stated(take: Take | None) -> float | None:
    """Spacing of the marks over that of a thin lens' image at the stated distance."""
    if take is None or take.target_distance_mm is None:
        return None
    marks = take.observations
    points = marks.family == POINT
    if points.sum() < 4:
        return None
    lattice = marks.lattice[points] - marks.lattice[points].mean(0)
    seen_mm = marks.points_px[points] * take.pixel_mm
    slope_mm = np.linalg.lstsq(lattice, seen_mm - seen_mm.mean(0), rcond=None)[0]
    stated = _principal_distance_mm(take) / take.target_distance_mm
    area = abs(np.linalg.det(slope_mm)) * take.squeeze
    return float(np.sqrt(area / np.prod(take.pitch_mm))) / stated


def _principal_distance_mm(take: Take) -> float:
    """Of a thin lens focused as stated."""
    focal_mm, focus_mm = take.focal_length_mm, take.focus_distance_mm
    if focus_mm is None or focus_mm <= 2 * focal_mm:
        return focal_mm
    return focal_mm / (1 - focal_mm / focus_mm)


def _reason(apart: float) -> str:
    where = "closer" if apart < 0 else "farther apart"
    return (
        f"the marks found lie {abs(apart):.0%} {where} than the other photographs and "
        "the stated distances say, so they are not the target's (does blur overlap?); "
        "photograph it less out of focus, or correct target_distance_mm"
    )
