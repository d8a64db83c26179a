"""Statements that the fit itself contradicts: priors whose residuals are large.

Pitch, distance and focal length enter the fit as priors (`lensfit.fitting.statements`).
A residual beyond three widths contradicts the photographs and the other statements. A
distance that several views of one target state was measured once, so the mean of their
residuals is tested; the residual of a single view among them must be twice as large, as
the centroids of blurred dots scatter by more than noise.

Where views tilt enough to measure the focal length, they measure the distance from the
entrance pupil too, and a tape that is short by some length moves the pupil back by that
length. Where the pupil then lies is the one thing that tells: no published design is
beyond 1.5 widths of `lensfit.fitting.usual_lens`.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from lensfit.fitting.lens_state import LensState, engraved_focal_lengths
from lensfit.fitting.statements import CONTRADICTION, Statement
from lensfit.workflow.statements.contradiction import Contradiction

_ONE_OF_SEVERAL = 2 * CONTRADICTION
_UNUSUAL_PUPIL = 1.5
_CAUSES = (
    "lens_identity", "focal_length", "pitch", "target_distance", "statements",
    "side_of_focus", "blurred_view", "exchanged",
)  # fmt: skip


def contradicted_by_fit(
    states: Sequence[LensState], found: Sequence[Contradiction]
) -> Iterator[Contradiction]:
    """Statements more than three widths off, each with what was fitted.

    Parameters
    ----------
    found : What other models named before. Where they know a cause, residuals of the
        fit are its consequences, and nothing is added.
    """
    if any(one.kind in _CAUSES for one in found):
        return
    by_size = [*_focal_lengths(states), *_target_distances(states)]
    yield from by_size or _distances_of_pupils(states)


def _focal_lengths(states: Sequence[LensState]) -> Iterator[Contradiction]:
    """Each as engraved; what an anamorphic lens was stated to be, its notes say."""
    for focal_mm, one in engraved_focal_lengths(states).items():
        if abs(one.residual_widths) > CONTRADICTION:
            fitted_mm = focal_mm * one.fitted / one.stated
            yield _contradiction(
                "focal_length", "focal_length_mm", focal_mm, fitted_mm, one, ()
            )


def _target_distances(states: Sequence[LensState]) -> Iterator[Contradiction]:
    groups: dict[tuple[str, float], list[Statement]] = {}
    for state in states:
        targets = {take.name: take.target for take in state.geometry.takes}
        for one in state.geometry.statements:
            if one.quantity == "target_distance":
                groups.setdefault((targets[one.where], one.stated), []).append(one)
    for (target, _), mine in groups.items():
        fitted_mm = float(np.mean([one.fitted for one in mine]))
        whole = mine[0]._replace(fitted=fitted_mm)
        worst = max(mine, key=lambda one: abs(one.residual_widths))
        if abs(whole.residual_widths) > CONTRADICTION:
            names = tuple(one.where for one in mine)
            key = f'target_distance_mm of target "{target}"'
            if len(mine) == 1:
                key = f"target_distance_mm of {Path(names[0]).stem}"
            yield _contradiction(
                "target_distance", key, whole.stated, fitted_mm, whole, names
            )
        elif abs(worst.residual_widths) > _ONE_OF_SEVERAL:
            key = f"target_distance_mm of {Path(worst.where).stem}"
            yield _contradiction(
                "target_distance", key, worst.stated, worst.fitted, worst,
                (worst.where,),
            )  # fmt: skip


def _distances_of_pupils(states: Sequence[LensState]) -> Iterator[Contradiction]:
    """Distances that put the entrance pupil where no usual lens has it."""
    for state in states:
        stated = state.geometry.statements
        distances = [one for one in stated if one.quantity == "target_distance"]
        pupils = [one for one in stated if one.quantity == "usual_entrance_pupil"]
        for pupil in pupils if distances else ():
            if abs(pupil.residual_widths) > _UNUSUAL_PUPIL:
                yield _unusual_pupil(state, pupil, distances[0])
                return


def _unusual_pupil(
    state: LensState, pupil: Statement, distance: Statement
) -> Contradiction:
    where = "before" if pupil.fitted > 0 else "behind"
    agrees_mm = distance.stated + pupil.stated - pupil.fitted
    return Contradiction(
        kind="target_distance",
        limit="undistortion",
        text=f"target_distance_mm is stated as {distance.stated:.4g} mm, which puts "
        f"the entrance pupil {abs(pupil.fitted):.0f} mm {where} the sensor; in usual "
        f"lenses of {state.focal_length_mm:g} mm it is where {agrees_mm:.3g} mm would "
        f"put it, give or take {pupil.width:.0f} mm",
        remedy="measure target_distance_mm from the sensor's mark, not from the lens' "
        "front, check pitch_mm, and photograph the chart from a second distance",
        statement="target_distance_mm",
        stated=distance.stated,
        agrees_with=agrees_mm,
        images=tuple(
            one.where
            for one in state.geometry.statements
            if one.quantity == "target_distance"
        ),
    )


def _contradiction(
    kind: str,
    statement: str,
    stated_mm: float,
    fitted_mm: float,
    of: Statement,
    images: tuple[str, ...],
) -> Contradiction:
    assert kind in ("focal_length", "target_distance")
    off = abs(of.residual_widths)
    return Contradiction(
        kind=kind,
        limit="undistortion",
        text=f"{statement} is stated as {stated_mm:.4g} mm, but the photographs agree "
        f"with {fitted_mm:.4g} mm, {off:.0f} standard deviations away",
        remedy="check focal_length_mm, target_distance_mm, pitch_mm and sensor_width_mm"
        " in the shoot file, and calibrate again",
        statement=statement,
        stated=stated_mm,
        agrees_with=fitted_mm,
        images=images,
    )
