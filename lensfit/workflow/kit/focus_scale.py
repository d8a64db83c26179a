"""The focus scale, engraved against measured.

The fit of the blur measures how far behind its sharp image the sensor lay in each
photograph, besides what all photographs have in common. With v the distance of the
sharp image from the lens, a mark that is engraved D but focuses at D' shows the
difference ``v(D') - v(D)``, and of a thin lens ``1/f = 1/(D - v) + 1/v``.
"""

import math
from typing import Any

from lensfit.chart.camera import object_distance_mm
from lensfit.report.plain_numbers import distance_of, plain_distance
from lensfit.workflow.kit.records import FocusMark, KitLens

_SAME_MM = 0.5


def focus_scale(lens: KitLens, report: dict[str, Any]) -> list[dict[str, Any]]:
    """A row for each focal length and mark that the blur was measured at.

    Returns
    -------
    Each "engraved", "engraved_mm", "measured_mm" and "standard_deviation_mm" ("inf"
    where infinite), and "off_mm" of the image behind the lens, in which marks compare.
    Anamorphic lenses focus twice, and have none.
    """
    if (lens.anamorphic_squeeze or 1.0) != 1.0:
        return []
    rows = []
    for blur in report.get("blur") or []:
        for mark in lens.focus_marks:
            row = _row(float(blur["focal_length_mm"]), mark, blur)
            if row is not None:
                rows.append(row)
    return rows


def measured_distance_mm(
    focal_length_mm: float, engraved_mm: float, off_mm: float
) -> float:
    """Where a mark focuses whose sharp image lies `off_mm` farther from the lens.

    Raises
    ------
    ChartError : The mark is nearer than four focal lengths.
    """
    image_mm = _image_distance_mm(focal_length_mm, engraved_mm) + off_mm
    if image_mm <= focal_length_mm:
        return math.inf
    return image_mm + 1 / (1 / focal_length_mm - 1 / image_mm)


def _image_distance_mm(focal_length_mm: float, distance_mm: float) -> float:
    if math.isinf(distance_mm):
        return focal_length_mm
    return distance_mm - object_distance_mm(focal_length_mm, distance_mm)


def _row(focal_mm: float, mark: FocusMark, blur: dict) -> dict[str, Any] | None:
    """Weighted over the photographs at the mark; None where none tells."""
    weights, sums = 0.0, 0.0
    for group in blur.get("defocus") or []:
        told = group.get("from_stated") or {}
        focus, target = (
            distance_of(group.get(key))
            for key in ("focus_distance_mm", "target_distance_mm")
        )
        value, deviation = told.get("defocus_mm"), told.get("standard_deviation_mm")
        if focus is None or target is None or value is None or not deviation:
            continue
        same = focus == mark.distance_mm or abs(focus - mark.distance_mm) < _SAME_MM
        if not same:
            continue
        stated = _image_distance_mm(focal_mm, focus)
        stated -= _image_distance_mm(focal_mm, target)
        weights += 1 / deviation**2
        sums += (value - stated) / deviation**2
    if not weights:
        return None
    off_mm, deviation_mm = sums / weights, weights**-0.5
    measured = measured_distance_mm(focal_mm, mark.distance_mm, off_mm)
    beside = measured_distance_mm(focal_mm, mark.distance_mm, off_mm + deviation_mm)
    spread = abs(measured - beside) if math.isfinite(measured + beside) else math.inf
    return {
        "focal_length_mm": focal_mm,
        "engraved": mark.engraved,
        "engraved_mm": plain_distance(mark.distance_mm),
        "measured_mm": plain_distance(measured),
        "standard_deviation_mm": plain_distance(spread),
        "off_mm": off_mm,
        "off_deviation_mm": deviation_mm,
    }
