"""What the fit decided of a state, for the report: its terms and its statements.

A term is kept or left, with value, deviation and reason; a statement of the shoot file
has its value, width and fitted value. Residuals are in widths; beyond three of them a
statement contradicts the photographs and the other statements. Everything is plain
numbers, ready for JSON.
"""

from collections.abc import Iterable
from typing import Any

from lensfit.fitting.lens_state import LensState
from lensfit.fitting.select import TermDecision
from lensfit.fitting.wavefront.fit import WavefrontFit
from lensfit.report.plain_numbers import plain_distance
from lensfit.workflow.calibration.blur_facts import blur_terms


def terms_of(
    state: LensState, wavefront: WavefrontFit | None = None
) -> list[dict[str, Any]]:
    """Every term: kept or left, value, standard deviation, reason.

    Parameters
    ----------
    wavefront : Of its focal length.
    """
    adjustment = state.geometry.adjustment
    terms = [_principal_distance(state)]
    for decision in _outermost(state.geometry.decisions):
        value, sd = None, None
        where = adjustment.layout.blocks.get(decision.term_group)
        if decision.kept and where is not None:
            value = adjustment.parameters[where].tolist()
            sd = state.uncertainty.deviation(decision.term_group).tolist()
        terms.append(
            {
                "name": decision.name,
                "kept": decision.kept,
                "value": value,
                "standard_deviation": sd,
                "unit": "",
                "reason": decision.reason,
            }
        )
    state_of = {
        "focal_length_mm": state.focal_length_mm,
        "focus_distance_mm": plain_distance(state.focus_distance_mm),
    }
    terms = [term | state_of for term in terms]
    if wavefront is not None:
        shared = {"focal_length_mm": state.focal_length_mm}
        terms += [term | shared for term in blur_terms(wavefront)]
    return terms


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


def _principal_distance(state: LensState) -> dict[str, Any]:
    """The term that only views from several sides see."""
    distance_mm = float(state.distortion.principal_distance_mm)
    deviation_mm = float(state.uncertainty.deviation("focal_length")[0]) * distance_mm
    free = state.geometry.focal_length_free
    return {
        "name": "principal_distance",
        "kept": free,
        "value": distance_mm,
        "standard_deviation": deviation_mm if free else None,
        "unit": "mm",
        "reason": "the views tilt enough to determine it"
        if free
        else "stated: frontal views of a flat target do not determine it",
    }


def _outermost(decisions: tuple[TermDecision, ...]) -> list[TermDecision]:
    """Of every family the largest step that was kept, and the first that was left."""
    groups: dict[str, list[TermDecision]] = {}
    for decision in decisions:
        groups.setdefault(decision.term_group, []).append(decision)
    chosen = []
    for steps in groups.values():
        kept = [v for v in steps if v.kept]
        chosen += kept[-1:] + [v for v in steps if not v.kept][:1]
    return chosen
