"""What was stated, as the report has it: value, width, what was fitted.

Everything is plain numbers, ready for JSON. Residuals count in widths; a statement
beyond three of them contradicts the photographs and what else was stated.
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
