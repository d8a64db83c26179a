"""How well the lenses of a set match: each figure against the median of the set.

Lenses of several focal lengths differ by design, so only differences that are visible
in a cut or a composite are compared, and the lens farthest from the median is named.
"""

from collections.abc import Callable
from dataclasses import dataclass
from statistics import median
from typing import Any, final

Row = dict[str, Any]


@final
@dataclass(frozen=True)
class Quantity:
    """A figure that lenses are compared in.

    Attributes
    ----------
    visible : Difference from which it shows between two shots.
    value : Of one focal length of a lens; None if not measured.
    """

    key: str
    name: str
    unit: str
    visible: float
    value: Callable[[Row, Row], float | None]


def _fall_off_at_widest(lens: Row, focal: Row) -> float | None:
    found = focal.get("fall_off") or []
    return found[0]["corner_stops"] if found else None


def _fall_off_stopped_down(lens: Row, focal: Row) -> float | None:
    found = focal.get("fall_off") or []
    return found[-1]["corner_stops"] if len(found) > 1 else None


def _engraving_percent(lens: Row, focal: Row) -> float | None:
    fitted = focal.get("fitted_focal_length_mm")
    return None if fitted is None else 100 * (fitted / focal["focal_length_mm"] - 1)


def _edge_width(lens: Row, focal: Row) -> float | None:
    for one in lens.get("blur_widths") or []:
        if one["focal_length_mm"] == focal["focal_length_mm"]:
            return one["edge_px"]
    return None


QUANTITIES = (
    Quantity("distortion", "distortion in the corner", "%", 0.5,
             lambda _, focal: focal.get("distortion_percent")),
    Quantity("breathing", "breathing over the marks", "%", 1.0,
             lambda _, focal: focal.get("breathing_percent")),
    Quantity("fall_off_wide", "fall-off wide open", "stops", 0.33,
             _fall_off_at_widest),
    Quantity("fall_off_closed", "fall-off stopped down", "stops", 0.2,
             _fall_off_stopped_down),
    Quantity("blur", "blur at the edge wide open", "px", 2.0, _edge_width),
    Quantity("engraving", "focal length against engraving", "%", 3.0,
             _engraving_percent),
)  # fmt: skip


def matches(lenses: list[Row]) -> list[Row]:
    """For each set of two lenses or more, a row for each figure that two have.

    Returns
    -------
    Each "lens_set" and "figures": "quantity", "unit", "visible", "median", "spread"
    (largest less smallest), "values" by folder and focal length, and "odd": those
    farther from the median than what is visible.
    """
    sets: dict[str, list[Row]] = {}
    for lens in lenses:
        if lens.get("lens_set") and lens["state"] == "done":
            sets.setdefault(lens["lens_set"], []).append(lens)
    return [
        {"lens_set": name, "figures": _figures(mine)}
        for name, mine in sets.items()
        if len(mine) > 1
    ]


def _figures(lenses: list[Row]) -> list[Row]:
    rows = []
    for quantity in QUANTITIES:
        values = [
            {
                "folder": lens["folder"],
                "focal_length_mm": focal["focal_length_mm"],
                "value": value,
            }
            for lens in lenses
            for focal in lens.get("focal_lengths") or []
            if (value := quantity.value(lens, focal)) is not None
        ]
        if len({one["folder"] for one in values}) < 2:
            continue
        found = [one["value"] for one in values]
        middle = median(found)
        far = [v for v in values if abs(v["value"] - middle) > quantity.visible]
        rows.append(
            {
                "quantity": quantity.key,
                "name": quantity.name,
                "unit": quantity.unit,
                "visible": quantity.visible,
                "median": middle,
                "spread": max(found) - min(found),
                "values": values,
                "odd": sorted(far, key=lambda v: -abs(v["value"] - middle)),
            }
        )
    return rows
