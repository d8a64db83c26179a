"""Model selection: which terms of the lens model enter a fit.

Near the solution the residuals are almost linear in every parameter, so the normal
equations of the full model contain those of every smaller model as sub-blocks. A
candidate term is tested by solving such a block. No new fit is needed, and the error on
the half of the detections that a solve has not used follows from the same matrices. A
term enters if

- the Bayesian information criterion (BIC) improves by `LEAST_BIC_GAIN`,
- the held-out error improves (two halves, each predicting the other), and
- its effect on the detections is at least `LEAST_EFFECT_PX` rms. Smaller effects are
  within the systematic errors of any detector, and a term that fits these correlates
  with pose and principal point.

A term group is a nested sequence of steps: each step contains the steps before it. The
search also tests steps beyond one that does not help by itself. It takes a longer step
instead of a shorter one only if the BIC gain is larger by `LEAST_BIC_GAIN`.

Reference: G. Schwarz, Annals of Statistics 6 (1978) 461-464.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from lensfit.fitting.parameters import (
    APERTURE_SHIFT_TERMS,
    Layout,
    board_degrees,
)
from lensfit.fitting.trial import Scores, Statistics, Trial
from lensfit.optics import field

LEAST_BIC_GAIN = 6.0
"""Strong support for the larger model on the usual scale of BIC differences."""
LEAST_HELD_OUT_GAIN = 1e-4
"""Share of the held-out sum of squares; a smaller gain is invisible in pictures."""
LEAST_EFFECT_PX = 0.008
"""Root mean square, over the detections, of the residual that a term explains."""


class Step(NamedTuple):
    """One step of a term group; it contains the steps before it."""

    name: str
    indices: Int[np.ndarray, " parameters"]


@dataclass(frozen=True)
class TermDecision:
    """The decision on one candidate term.

    Attributes
    ----------
    name : Of the term.
    kept : Whether it is in the model.
    bic_gain : Gain in BIC when it was last tested.
    held_out_gain : Share of the held-out sum of squares that the term removes, at most
        1; negative if the term increases it.
    visible : Whether the effect reaches `LEAST_EFFECT_PX`.
    override_reason : Why the term is kept although the criteria are not met; empty if
        they decided.
    """

    name: str
    kept: bool
    bic_gain: float
    held_out_gain: float
    visible: bool = True
    override_reason: str = ""

    @property
    def term_group(self) -> str:
        """Name of the block of parameters that the term belongs to."""
        return self.name.rstrip("0123456789").rstrip("_")

    @property
    def held_out_change_percent(self) -> float:
        """Change of the root mean square of the held-out error by the term."""
        return 100 * (math.sqrt(max(1 - self.held_out_gain, 0.0)) - 1)

    def with_override(self, why: str) -> "TermDecision":
        """The decision to keep the term for another reason than the criteria."""
        return replace(
            self,
            kept=True,
            override_reason=self.override_reason or ("" if self.kept else why),
        )

    @property
    def reason(self) -> str:
        """One sentence for the report."""
        change = _signed_percent(self.held_out_change_percent)
        scores = f"BIC gain {self.bic_gain:+.3g}, held-out error {change} %"
        if self.override_reason:
            return f"kept: {self.override_reason}; {scores}"
        if self.kept:
            return f"kept: {scores}"
        if self.bic_gain < LEAST_BIC_GAIN:
            return f"left out: the BIC gain is too small; {scores}"
        if self.held_out_gain > LEAST_HELD_OUT_GAIN and not self.visible:
            return f"left out: its effect is below {LEAST_EFFECT_PX:g} px; {scores}"
        return f"left out: it does not reduce the held-out error enough; {scores}"


def _signed_percent(percent: float) -> str:
    """Two significant digits, at most three decimals; 0 for smaller values."""
    whole = 10 <= abs(percent) < 1000
    return f"{percent:+.0f}" if whole else f"{round(percent, 3) + 0.0:+.2g}"


def shared_term_groups(
    layout: Layout, largest: Layout | None = None
) -> dict[str, list[Step]]:
    """Every candidate term group of the shared parameters, as nested steps.

    `largest` is the largest model to test, if the layout has room for a larger one.
    """
    blocks, largest = layout.blocks, largest or layout
    apertures = slice(0, APERTURE_SHIFT_TERMS * largest.apertures)
    of = {name: np.arange(where.start, where.stop) for name, where in blocks.items()}
    found = {
        "principal_point": [Step("principal_point", of["principal_point"])],
        "radial": _prefixes("radial", of["radial"], range(1, largest.radial + 1)),
        "squeeze": [Step("squeeze", of["squeeze"])],
        "decentering": _decentering_steps(of["decentering"], of["thin_prism"]),
        "anamorphic": _prefixes("anamorphic", of["anamorphic"], (3, 8)),
        "free_field": _field_steps(of["free_field"], largest.free_degree),
        "board_stretch": _stretch_steps(of["board_stretch"], largest.stretch_degree),
        "aperture_shift": [Step("aperture_shift", of["aperture_shift"][apertures])],
    }
    return {name: steps for name, steps in found.items() if steps and len(steps[0][1])}


class Choice(NamedTuple):
    """The result of the search.

    Attributes
    ----------
    kept : Number of steps kept, by term group.
    decisions : One for every term that was tested.
    step : Change of the parameters to the linearised solution of the chosen model.
    """

    kept: dict[str, int]
    decisions: list[TermDecision]
    step: Float[np.ndarray, " parameters"]


def choose(
    halves: Sequence[Statistics],
    precision: Float[np.ndarray, " parameters"],
    offset: Float[np.ndarray, " parameters"],
    always: Int[np.ndarray, " always"],
    terms: dict[str, list[Step]],
    least_fall: float = 0.0,
    stated: Statistics | None = None,
) -> Choice:
    """Select terms by a greedy search among models of increasing size.

    Parameters
    ----------
    halves : Normal equations of each half of the detections, at the current solution.
    precision : Prior precision of every parameter.
    offset : Current parameters minus their prior mean.
    always : Parameters that are in every model; none of them in `terms`.
    terms : Candidate term groups.
    least_fall : Decrease of the held-out sum of squares by an effect of
        `LEAST_EFFECT_PX`; with the default, effects of any size count as visible.
    stated : Normal equations of stated values (`Trial`).
    """
    tried = np.concatenate([steps[-1].indices for steps in terms.values()])
    trial = Trial(halves, precision, offset, always, tried, stated)
    kept: dict[str, int] = {}
    decisions: dict[str, TermDecision] = {}
    indices = np.zeros(0, int)
    now = trial.scores(indices)
    while True:
        best = None
        for group, steps in terms.items():
            growths = _growths(
                trial, indices, now, steps, kept.get(group, 0), least_fall
            )
            decisions |= {growth.decision.name: growth.decision for growth in growths}
            own = _best_of(growths)
            if own and (best is None or own.bic_gain > best[1].bic_gain):
                best = group, own
        if best is None:
            break
        group, growth = best
        indices, now = growth.indices, growth.scores
        for step in terms[group][kept.get(group, 0) : growth.level + 1]:
            decisions[step.name] = replace(growth.decision, name=step.name, kept=True)
        kept[group] = growth.level + 1
    return Choice(kept, list(decisions.values()), trial.step(indices))


class _Growth(NamedTuple):
    """A model enlarged by one step of a term group."""

    level: int
    indices: Int[np.ndarray, " tried"]
    scores: Scores
    decision: TermDecision

    @property
    def bic_gain(self) -> float:
        return self.decision.bic_gain

    @property
    def meets_criteria(self) -> bool:
        decision = self.decision
        better = decision.held_out_gain > LEAST_HELD_OUT_GAIN and decision.visible
        return better and decision.bic_gain > LEAST_BIC_GAIN


def _growths(
    trial: Trial,
    indices: Int[np.ndarray, " tried"],
    now: Scores,
    steps: list[Step],
    first: int,
    least_fall: float,
) -> list[_Growth]:
    """Every step from `first` on that adds parameters to the model of `indices`."""
    found = []
    for level, step in enumerate(steps[first:], first):
        grown = np.union1d(indices, step.indices)
        if len(grown) == len(indices):
            continue
        scores = trial.scores(grown)
        fall = now.held_out - scores.held_out
        gains = now.bic - scores.bic, 1 - scores.held_out / now.held_out
        decision = TermDecision(step.name, False, *gains, visible=fall > least_fall)
        found.append(_Growth(level, grown, scores, decision))
    return found


def _best_of(growths: list[_Growth]) -> _Growth | None:
    """The step with the largest BIC gain of those that meet the criteria; a longer one
    only if it gains `LEAST_BIC_GAIN` more."""
    best = None
    for growth in growths:
        further = best is None or growth.bic_gain > best.bic_gain + LEAST_BIC_GAIN
        if growth.meets_criteria and further:
            best = growth
    return best


def _prefixes(name: str, indices: np.ndarray, lengths: Iterable[int]) -> list[Step]:
    return [Step(f"{name}_{n}", indices[:n]) for n in lengths]


def _decentering_steps(decentering: np.ndarray, thin_prism: np.ndarray) -> list[Step]:
    """Steps with decentering first, and thin prism only in addition to it.

    The two differ by a tilt of the board, so that a frontal view does not distinguish
    them. A displaced element shifts its own distortion, which is a decentering term.
    """
    return [
        Step("decentering_2", decentering[:2]),
        Step("thin_prism_2", np.concatenate([decentering[:2], thin_prism[:2]])),
        Step("decentering_4", np.concatenate([decentering, thin_prism[:2]])),
        Step("thin_prism_4", np.concatenate([decentering, thin_prism])),
    ]


def _field_steps(indices: np.ndarray, degree: int) -> list[Step]:
    both = indices.reshape(2, -1)
    return [
        Step(f"free_field_{d}", both[:, : len(field.free_degrees(d))].ravel())
        for d in range(field.LOWEST_FREE_DEGREE, degree + 1)
    ]


def _stretch_steps(indices: np.ndarray, degree: int) -> list[Step]:
    both = indices.reshape(2, -1)
    return [
        Step(f"board_stretch_{d}", both[:, : len(board_degrees(d))].ravel())
        for d in range(2, degree + 1)
    ]


def bend_steps(layout: Layout, views: int) -> list[Step]:
    """Bends of the board in every photograph, by increasing degree."""
    rows = layout.local_indices("board_bend", views)
    return [
        Step(f"board_bend_{d}", rows[:, : len(board_degrees(d))].ravel())
        for d in range(2, layout.bend_degree + 1)
    ]


def drift_steps(layout: Layout, views: int) -> list[Step]:
    """The row drift of every photograph."""
    return [Step("row_drift", layout.local_indices("row_drift", views).ravel())]
