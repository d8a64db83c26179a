"""Statements of the shoot file for the report: value, width, fitted value.

Everything is plain numbers, ready for JSON. Residuals are in widths; beyond three of
them a statement contradicts the photographs and the other statements.
"""

from collections.abc import Iterable
from typing import Any

from lensfit.fitting.lens_state import LensState
from lensfit.report.plain_numbers import plain_distance


def statement_facts(states: Iterable[LensState]) -> list[dict[str, Any]]:
    """One row for each statement of each lens state.

    The place of the entrance pupil is none of the user's: it is listed, as
    "usual_entrance_pupil", because what contradicts it contradicts what was stated.
    """
    return [
        {
            "quantity": one.quantity,
            "where": one.where,
            "focal_length_mm": state.focal_length_mm,
            "focus_distance_mm": plain_distance(state.focus_distance_mm),
            "stated": round(one.stated, 4),
            "width": round(one.width, 4),
            "fitted": round(one.fitted, 4),
            "unit": one.unit,
            "residual_widths": round(one.residual_widths, 3),
            "contradicts": one.contradicts,
        }
        for state in states
        for one in state.geometry.statements
    ]
