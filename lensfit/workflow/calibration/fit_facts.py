"""What the fit decided of a state and used of each photograph, for the report.

A term is kept or left, with value, deviation and reason; a statement of the shoot file
has its value, width and fitted value. Residuals are in widths; beyond three of them a
statement contradicts the photographs and the other statements.

The wavefront's defocus of all takes may be moved by the same amount: curvature and
spherical aberration compensate it, and no focus scale is exact. So the reported defocus
is relative: less what all takes have in common against the distances that were stated.
Positive is on the side of a lens that is focused nearer than the chart.

Everything is plain numbers, ready for JSON.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from lensfit.detect.observations import Observations
from lensfit.fitting.chief_ray import ChiefRayFit
from lensfit.fitting.held_out import rms, squared_px
from lensfit.fitting.lens_state import LensState
from lensfit.fitting.lens_states import FittedLens
from lensfit.fitting.select import TermDecision
from lensfit.fitting.wavefront.fit import WavefrontFit
from lensfit.fitting.wavefront.start_values import stated_defocus_mm
from lensfit.fitting.wavefront.term_groups import TermGroup
from lensfit.report.plain_numbers import plain, plain_distance, rounded_numbers
from lensfit.workflow.calibration.observe import Observed


def defocus_facts(wavefront: WavefrontFit) -> list[dict[str, Any]]:
    """Of every group of photographs, as it was fitted (`defocus_mm`) and besides what
    all have in common (`from_stated`; None where no distance was stated)."""
    dot_data, stage = wavefront.dot_data, wavefront.stage
    where = stage.layout.blocks["defocus"]
    count = len(dot_data.groups)
    found = stage.parameters[where][:count]
    covariance = wavefront.total_covariance[where, where][:count, :count]
    besides = _besides_common(found, covariance, stated_defocus_mm(dot_data))
    return [
        {
            "focus_distance_mm": plain_distance(group.focus_distance_mm),
            "target_distance_mm": group.target_distance_mm,
            "image": group.take or None,
            "defocus_mm": float(found[k]),
            "standard_deviation_mm": float(np.sqrt(covariance[k, k])),
            "from_stated": besides and {key: plain(v[k]) for key, v in besides.items()},
        }
        for k, group in enumerate(dot_data.groups)
    ]


def _besides_common(
    found: Float[np.ndarray, " groups"],
    covariance: Float[np.ndarray, "groups groups"],
    stated: Float[np.ndarray, " groups"],
) -> Mapping[str, Float[np.ndarray, " groups"]] | None:
    is_stated = np.isfinite(stated)
    if not is_stated.any():
        return None
    without = np.eye(len(found)) - is_stated / is_stated.sum()
    value = without @ found + np.mean(stated[is_stated])
    variance = np.einsum("ij,jk,ik->i", without, covariance, without)
    return {
        "defocus_mm": value,
        "standard_deviation_mm": np.sqrt(np.maximum(variance, 0.0)),
    }


_UNITS = {
    "defocus": "mm",
    "astigmatic_offset": "mm",
    "third_order": "um",
    "cylinders_third_order": "um",
    "cylinders_fifth_astigmatism": "um",
    "cylinders_fifth_coma": "um",
    "cylinders_fifth_spherical": "um",
    "fifth_order": "um",
    "seventh_order": "um",
    "ninth_order": "um",
    "axial_colour": "um",
    "axial_colour_curved": "um",
    "colour_of_third_order": "um",
    "colour_of_fifth_order": "um",
    "colour_of_third_order_curved": "um",
    "decentred_elements": "um",
    "change_with_focus": "um",
    "cylinders_change_with_focus": "um",
}


def blur_terms(wavefront: WavefrontFit) -> list[dict[str, Any]]:
    """Every family of parameters: kept or left, value, deviation, reason."""
    kept = {term_group.name: term_group for term_group in wavefront.term_groups}
    tried = {
        term_decision.name: term_decision for term_decision in wavefront.term_decisions
    }
    terms = []
    for name in dict.fromkeys((*kept, *tried)):
        value, deviation = None, None
        if name in kept:
            value, deviation = _numbers(kept[name], wavefront)
        reason = tried[name].reason if name in tried else "part of every lens"
        if name in wavefront.undetermined_term_groups:
            reason += "; the photographs determine it weakly"
        terms.append(
            {
                "name": f"blur_{name}",
                "kept": name in kept,
                "value": value,
                "standard_deviation": deviation,
                "unit": _UNITS.get(name, ""),
                "reason": reason,
            }
        )
    return terms


def _targets_of(observations: Observations) -> str:
    if observations.are_lines:
        return "pieces of lines"
    return "corners" if observations.are_corners else "dots"


def blur_facts(wavefront: WavefrontFit, pictures: Mapping[str, str]) -> dict[str, Any]:
    """How well the shape of the dots is explained, per take and held out.

    Parameters
    ----------
    wavefront : The fit.
    pictures : Of the dots, by the take's name; see `report.pictures`.
    """
    dot_data, stage = wavefront.dot_data, wavefront.stage
    misfit = wavefront.misfit
    takes = []
    for k, photograph in enumerate(dot_data.photographs):
        takes.append(
            {
                "image": photograph.take.name,
                "dots": int(np.sum(stage.dot_data.take == k)),
                "targets": _targets_of(photograph.take.observations),
                "misfit": plain(misfit.take_misfits[k]),
                "held_out_misfit": plain(misfit.held_out_take[k]),
                "picture": pictures.get(photograph.take.name),
            }
        )
    return {
        "takes": takes,
        "held_out_misfit": plain(misfit.held_out_dots),
        "defocus": defocus_facts(wavefront),
        "blades": stage.blades,
        "sign_known": wavefront.sign_known,
        "mirrored": wavefront.mirrored,
        "extrapolated": list(wavefront.extrapolation_notes),
        "converged": wavefront.converged,
        "not_seen": list(wavefront.undetermined_term_groups),
    }


def _numbers(term_group: TermGroup, wavefront: WavefrontFit) -> tuple[list, list]:
    rows = list(term_group.indices)
    deviation = np.sqrt(np.diag(wavefront.total_covariance))[rows]
    return wavefront.stage.parameters[rows].tolist(), deviation.tolist()


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


_MOST_RESIDUALS = 3000


def errors_of(geometry: ChiefRayFit) -> tuple[float, float, int, int]:
    """rms px, held-out rms px, points used, points detected."""
    adjustment = geometry.adjustment
    used = adjustment.used
    detected = sum(len(t.observations) for t in geometry.takes)
    return (
        rms(squared_px(adjustment), used),
        float(geometry.held_out_rms_px),
        int(used.sum()),
        detected,
    )


def take_facts(observed: Observed, fitted: FittedLens, folder: Path) -> dict[str, Any]:
    """One photograph in the report."""
    facts: dict[str, Any] = {
        "name": Path(observed.image).stem,
        "image": observed.image,
        "target": observed.target,
        "points_detected": 0,
        "points_used": 0,
        "rms_px": None,
        "held_out_rms_px": None,
        "overlay": str(observed.overlay.relative_to(folder))
        if observed.overlay
        else None,
        "notes": list(observed.notes),
        "failed": observed.failed,
    }
    if observed.resolved is not None:
        facts |= {
            "focal_length_mm": observed.resolved.focal_length_mm,
            "f_number": observed.resolved.f_number,
            "focus_distance_mm": plain_distance(observed.resolved.focus_distance_mm),
            "target_distance_mm": observed.resolved.take.target_distance_mm,
        }
    if observed.take is None:
        return facts
    facts["points_detected"] = len(observed.take.observations)
    for state in fitted.states:
        # By name: the fit may have moved a take's marks to its chief rays.
        names = [take.name for take in state.geometry.takes]
        if observed.take.name in names:
            k = names.index(observed.take.name)
            return facts | _fitted_take(state.geometry, k)
    facts["failed"] = str(fitted.failed[observed.take.name])
    return facts


def _fitted_take(geometry: ChiefRayFit, k: int) -> dict[str, Any]:
    adjustment, take = geometry.adjustment, geometry.takes[k]
    used = adjustment.used[k]
    squared = squared_px(adjustment)[k]
    count = len(take.observations)
    residual = -adjustment.residual_mm()[k] / adjustment.stack.mm_per_px[k]
    chosen = np.flatnonzero(used[:count])
    if len(chosen) > _MOST_RESIDUALS:
        chosen = np.random.default_rng(0).choice(chosen, _MOST_RESIDUALS, False)
    points = take.observations.points_px[chosen]
    return {
        "points_used": int(used.sum()),
        "rms_px": rms(squared, used),
        "held_out_rms_px": geometry.held_out_rms_px_of_take[k],
        "residuals": {
            "x_px": rounded_numbers(points[:, 0], 2),
            "y_px": rounded_numbers(points[:, 1], 2),
            "dx_px": rounded_numbers(residual[chosen, 0], 4),
            "dy_px": rounded_numbers(residual[chosen, 1], 4),
        },
    }
