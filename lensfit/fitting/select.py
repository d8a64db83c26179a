"""Which terms the photographs ask for: evidence instead of taste.

At a fitted lens the residuals are nearly linear in every parameter, so the normal
equations of the full model hold, as sub-blocks, those of every smaller one. A term is
tried by solving such a block: no new fit is needed, and the error on the half of the
marks that a solve has not seen follows from the same matrices. A term enters when

- the Bayesian information criterion improves, and
- the held-out error improves (two halves, each predicting the other), and
- the improvement is an effect of `LEAST_EFFECT_PX` on the marks at least: smaller ones
  are within the systematic errors of any detector, and a term that fits those trades
  against pose and principal point.

Families of rising degree are nested: each step contains the steps before it. The
search looks past a step that does not help by itself, and takes a longer step than it
must only on the same evidence.

Reference: G. Schwarz, Annals of Statistics 6 (1978) 461-464.
"""

import math
from collections.abc import Iterable
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
"""Strong evidence on the usual scale."""
LEAST_HELD_OUT_GAIN = 1e-4
"""Of the sum of squares; below it a term cannot be seen in any picture."""
LEAST_EFFECT_PX = 0.008
"""Root mean square over the marks of what a term explains."""


class Step(NamedTuple):
    """One step of a family of terms, containing the steps before it."""

    name: str
    indices: Int[np.ndarray, " parameters"]


@dataclass(frozen=True)
class Verdict:
    """What came of one term.

    Attributes
    ----------
    name : Of the term.
    kept : Whether it is in the model.
    bic_gain : Gain in BIC when it was tried last.
    held_out_gain : Share of the held-out sum of squares that the term takes away, at
        most 1; below 0 where it adds to it.
    visible : Whether the effect reaches `LEAST_EFFECT_PX`.
    despite : Why it was kept against the evidence; empty where it was not.
    """

    name: str
    kept: bool
    bic_gain: float
    held_out_gain: float
    visible: bool = True
    despite: str = ""

    @property
    def family(self) -> str:
        """The block of parameters that the term belongs to."""
        return self.name.rstrip("0123456789").rstrip("_")

    @property
    def held_out_change_percent(self) -> float:
        """What the term does to the root mean square of the held-out error."""
        return 100 * (math.sqrt(max(1 - self.held_out_gain, 0.0)) - 1)

    def kept_all_the_same(self, why: str) -> "Verdict":
        """The verdict where something else than evidence decides."""
        return replace(
            self, kept=True, despite=self.despite or ("" if self.kept else why)
        )

    @property
    def reason(self) -> str:
        """One sentence for the report."""
        change = _signed(self.held_out_change_percent)
        evidence = f"evidence {self.bic_gain:+.3g} (BIC), held-out error {change} %"
        if self.despite:
            return f"kept: {self.despite}; {evidence}"
        if self.kept:
            return f"kept: {evidence}"
        if self.bic_gain < LEAST_BIC_GAIN:
            return f"left out: the photographs do not ask for it; {evidence}"
        if self.held_out_gain > LEAST_HELD_OUT_GAIN and not self.visible:
            return f"left out: its effect is below {LEAST_EFFECT_PX:g} px; {evidence}"
        return f"left out: it does not predict unseen marks better; {evidence}"


def _signed(percent: float) -> str:
    """Two digits, to a thousandth at most; 0 what is less."""
    whole = 10 <= abs(percent) < 1000
    return f"{percent:+.0f}" if whole else f"{round(percent, 3) + 0.0:+.2g}"


def families(layout: Layout, largest: Layout | None = None) -> dict[str, list[Step]]:
    """Every family of shared terms that may enter, as nested steps.

    `largest` is the model to stop at, where the layout has room for more.
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
    """What the search found.

    Attributes
    ----------
    kept : Steps kept of each family.
    verdicts : Of every term that was tried.
    step : Change of the parameters to the linearised solution of the chosen model.
    """

    kept: dict[str, int]
    verdicts: list[Verdict]
    step: Float[np.ndarray, " parameters"]


def choose(
    first_half: Statistics,
    second_half: Statistics,
    precision: Float[np.ndarray, " parameters"],
    offset: Float[np.ndarray, " parameters"],
    always: Int[np.ndarray, " always"],
    terms: dict[str, list[Step]],
    least_fall: float = 0.0,
    stated: Statistics | None = None,
) -> Choice:
    """Greedy search among models of rising size.

    Parameters
    ----------
    first_half, second_half : Normal equations at the current solution.
    precision : Prior precision of every parameter.
    offset : Current parameters minus their prior mean.
    always : Parameters that are in every model; none of them in `terms`.
    least_fall : Of the held-out sum of squares by what an effect of `LEAST_EFFECT_PX`
        explains; the default lets effects of any size pass.
    stated : Equations of what is stated (`Trial`).
    """
    tried = np.concatenate([steps[-1].indices for steps in terms.values()])
    trial = Trial(first_half, second_half, precision, offset, always, tried, stated)
    kept: dict[str, int] = {}
    verdicts: dict[str, Verdict] = {}
    indices = np.zeros(0, int)
    now = trial.scores(indices)
    while True:
        best = None
        for family, steps in terms.items():
            growths = _growths(
                trial, indices, now, steps, kept.get(family, 0), least_fall
            )
            verdicts |= {growth.verdict.name: growth.verdict for growth in growths}
            own = _best_of(growths)
            if own and (best is None or own.evidence > best[1].evidence):
                best = family, own
        if best is None:
            break
        family, growth = best
        indices, now = growth.indices, growth.scores
        for step in terms[family][kept.get(family, 0) : growth.level + 1]:
            verdicts[step.name] = replace(growth.verdict, name=step.name, kept=True)
        kept[family] = growth.level + 1
    return Choice(kept, list(verdicts.values()), trial.step(indices))


class _Growth(NamedTuple):
    """A step of a family on top of a model, and the model that makes."""

    level: int
    indices: Int[np.ndarray, " tried"]
    scores: Scores
    verdict: Verdict

    @property
    def evidence(self) -> float:
        return self.verdict.bic_gain

    @property
    def good(self) -> bool:
        verdict = self.verdict
        better = verdict.held_out_gain > LEAST_HELD_OUT_GAIN and verdict.visible
        return better and verdict.bic_gain > LEAST_BIC_GAIN


def _growths(
    trial: Trial,
    indices: Int[np.ndarray, " tried"],
    now: Scores,
    steps: list[Step],
    first: int,
    least_fall: float,
) -> list[_Growth]:
    """Every step from `first` on that adds something to the model of `indices`."""
    found = []
    for level, step in enumerate(steps[first:], first):
        grown = np.union1d(indices, step.indices)
        if len(grown) == len(indices):
            continue
        scores = trial.scores(grown)
        fall = now.held_out - scores.held_out
        gains = now.bic - scores.bic, 1 - scores.held_out / now.held_out
        verdict = Verdict(step.name, False, *gains, visible=fall > least_fall)
        found.append(_Growth(level, grown, scores, verdict))
    return found


def _best_of(growths: list[_Growth]) -> _Growth | None:
    """The good one with most evidence; a longer one only for a good deal more."""
    best = None
    for growth in growths:
        further = best is None or growth.evidence > best.evidence + LEAST_BIC_GAIN
        if growth.good and further:
            best = growth
    return best


def _prefixes(name: str, indices: np.ndarray, lengths: Iterable[int]) -> list[Step]:
    return [Step(f"{name}_{n}", indices[:n]) for n in lengths]


def _decentering_steps(decentering: np.ndarray, thin_prism: np.ndarray) -> list[Step]:
    """Thin prism on top of decentering, not instead of it.

    They differ by a tilt of the board, so that a frontal view suits either. Elements
    that are out of centre distort as the one does: their own distortion, shifted.
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
    """Bends of every photograph's board, of rising degree."""
    rows = layout.local_indices("board_bend", views)
    return [
        Step(f"board_bend_{d}", rows[:, : len(board_degrees(d))].ravel())
        for d in range(2, layout.bend_degree + 1)
    ]


def drift_steps(layout: Layout, views: int) -> list[Step]:
    """The row drift of every photograph."""
    return [Step("row_drift", layout.local_indices("row_drift", views).ravel())]
