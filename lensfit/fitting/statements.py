"""Stated values of a shoot as residuals of the fit, each with a standard deviation.

An engraved focal length is good to a few percent, a tape measure to some millimetres
and a few tenths of a percent, a chart's pitch to a tenth of a percent. Each enters the
fit as one residual, (fitted - stated) / width, beside those of the detections. A
quantity that the photographs do not determine keeps its stated value, and a
contradiction appears as a residual of the statement.

In this module's residuals
    target_distance   pupil offset + depth of the board along the axis = tape measure
    focal_length      ln(principal distance) = ln(f (1 + m)), m the magnification at the
                      focus distance of a thin lens of that focal length
    usual_entrance_pupil, usual_pupil_shift
                      pupil offset and shift = those of usual lenses
                      (`lensfit.fitting.usual_lens`), or of another focus distance
all are linear in the parameters of the fit (`lensfit.fitting.parameters`). An error of
the pitch scales a chart's distance, so that its width is part of the distance's. A
distance that several views of one target state was measured once: they share its width.

A statement that is wrong, not merely inaccurate, must not distort the lens model:
residuals are down-weighted by 1 / (1 + (r / 3)^2), the Cauchy loss of the detections.

Reference: B. Triggs et al., Bundle adjustment: a modern synthesis (2000), on priors as
observations.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from lensfit.fitting.chart_view import Widths
from lensfit.fitting.parameters import Layout
from lensfit.fitting.usual_lens import KnownPerspective, KnownPupil, KnownPupilShift

PUPIL_MAGNIFICATION_WIDTH = 0.5
"""Standard deviation of 1 / (pupil magnification) from 1 in usual lenses."""
CAUCHY_SCALE = 3.0
CONTRADICTION = 3.0
"""Widths beyond which a statement contradicts the photographs."""


@dataclass(frozen=True, eq=False)
class Facts:
    """Stated values of the views of one lens state, in the order of its arrays.

    Attributes
    ----------
    names : Of the photographs.
    focal_length_mm : Of anamorphic lenses the geometric mean of both axes.
    engraving : Stated focal length over `focal_length_mm`.
    magnification : At the focus distance.
    target_distance_mm : From the sensor; NaN if not measured.
    shared : Number of views that share each distance.
    perspective : Prior of the entrance pupil and its shift with field angle.
    widths : Standard deviations of the stated values.
    """

    names: tuple[str, ...]
    focal_length_mm: float
    engraving: float
    magnification: float
    target_distance_mm: Float[np.ndarray, " views"]
    shared: Float[np.ndarray, " views"]
    perspective: KnownPerspective
    widths: Widths

    @property
    def principal_distance_mm(self) -> float:
        """Principal distance of the stated focal length at the focus distance."""
        return self.focal_length_mm * (1 + self.magnification)

    @property
    def focal_length_width(self) -> float:
        """Standard deviation of ln(principal distance): pupil magnification and moving
        groups change how it increases towards near focus."""
        return math.hypot(
            self.widths.focal_length, PUPIL_MAGNIFICATION_WIDTH * self.magnification
        )


def views_sharing(keys: Sequence[tuple]) -> Float[np.ndarray, " views"]:
    """For each view, how many views have the same key."""
    return np.array([float(sum(other == key for other in keys)) for key in keys])


Quantity = Literal[
    "focal_length",
    "target_distance",
    "usual_entrance_pupil",
    "usual_pupil_shift",
    "entrance_pupil_at_other_focus",
    "pupil_shift_at_other_focus",
]
_SUBJECTS: dict[Quantity, str] = {
    "focal_length": "focal_length_mm is stated as",
    "target_distance": "target_distance_mm is stated as",
    "usual_entrance_pupil": "the entrance pupil of such lenses is usually before the "
    "sensor by",
}
"""Quantities that may contradict the photographs; the pupil at another focus distance
cannot, since moving groups can place it anywhere."""


class Statement(NamedTuple):
    """One number of the table of statements.

    Attributes
    ----------
    quantity : What is stated.
    where : Name of the photograph; empty for the lens itself.
    stated, width, fitted : In `unit`.
    """

    quantity: Quantity
    where: str
    stated: float
    width: float
    fitted: float
    unit: str = "mm"

    @property
    def residual_widths(self) -> float:
        """(fitted - stated) / width."""
        return (self.fitted - self.stated) / self.width

    @property
    def contradicts(self) -> bool:
        """Whether the photographs and the other stated values contradict it."""
        stated = self.quantity in _SUBJECTS
        return stated and abs(self.residual_widths) > CONTRADICTION

    @property
    def sentence(self) -> str:
        """The sentence for a contradiction in the report."""
        subject = _SUBJECTS[self.quantity]
        where = f"{self.where}: " if self.where else ""
        return (
            f"{where}{subject} {self.stated:.5g} {self.unit}, but the photographs "
            f"and what else is stated make it {self.fitted:.5g} {self.unit}, "
            f"{abs(self.residual_widths):.1f} standard deviations away: check "
            "focal_length_mm, target_distance_mm, pitch_mm and sensor_width_mm"
        )


@dataclass(frozen=True, eq=False)
class Statements:
    """All statements of one lens state as linear residuals of its parameters.

    Attributes
    ----------
    facts : The stated values.
    quantities, where : Quantity and photograph of each statement.
    rows, wanted : residual = rows @ parameters - wanted, in widths.
    common : Standard deviation of `wanted` that all states of the lens share.
    weight : Robust; 1 for those that agree.
    """

    facts: Facts
    quantities: tuple[Quantity, ...]
    where: tuple[str, ...]
    rows: Float[np.ndarray, "statements parameters"]
    wanted: Float[np.ndarray, " statements"]
    common: Float[np.ndarray, " statements"]
    weight: Float[np.ndarray, " statements"]

    def residuals(
        self, parameters: Float[np.ndarray, " parameters"]
    ) -> Float[np.ndarray, " statements"]:
        """Residuals in widths, without weights."""
        return self.rows @ parameters - self.wanted

    def with_robust_weights(
        self, parameters: Float[np.ndarray, " parameters"]
    ) -> "Statements":
        """With the robust weights of these parameters."""
        scaled = self.residuals(parameters) / CAUCHY_SCALE
        return replace(self, weight=1 / (1 + scaled**2))

    @property
    def matrix(self) -> Float[np.ndarray, "parameters parameters"]:
        """Half the Hessian of the sum of squares."""
        return self.rows.T @ (self.weight[:, None] * self.rows)

    @property
    def vector(self) -> Float[np.ndarray, " parameters"]:
        """Minus half the gradient of the sum of squares at parameters of zero."""
        return self.rows.T @ (self.weight * self.wanted)

    @property
    def common_pulls(self) -> Float[np.ndarray, "statements parameters"]:
        """Change of half the gradient by a standard deviation of each common error."""
        return (self.weight * self.common)[:, None] * self.rows

    @property
    def constant(self) -> float:
        """The sum of squares at parameters of zero."""
        return float(np.sum(self.weight * self.wanted**2))

    def gradient(
        self, parameters: Float[np.ndarray, " parameters"]
    ) -> Float[np.ndarray, " parameters"]:
        """Half the gradient of the sum of squares."""
        return self.matrix @ parameters - self.vector

    def table(
        self, parameters: Float[np.ndarray, " parameters"]
    ) -> tuple[Statement, ...]:
        """Every statement with what was fitted.

        The focal length is reported, although the residual is that of the principal
        distance.
        """
        off = self.residuals(parameters)
        return tuple(self._statement(k, float(off[k])) for k in range(len(off)))

    def _statement(self, k: int, off: float) -> Statement:
        facts, quantity, where = self.facts, self.quantities[k], self.where[k]
        if quantity == "focal_length":
            stated_mm = facts.focal_length_mm * facts.engraving
            width = facts.focal_length_width
            fitted_mm = stated_mm * math.exp(off * width)
            # So that the residual is that of the logarithm, which was minimised.
            width_mm = abs(fitted_mm - stated_mm) / abs(off) if off else None
            width_mm = width_mm or stated_mm * width
            return Statement(quantity, where, stated_mm, width_mm, fitted_mm)
        if quantity in ("usual_entrance_pupil", "entrance_pupil_at_other_focus"):
            stated_mm, width_mm = facts.perspective.pupil[:2]
        elif quantity in ("usual_pupil_shift", "pupil_shift_at_other_focus"):
            stated_mm, width_mm = facts.perspective.pupil_shift[:2]
        else:
            view = facts.names.index(where)
            stated_mm = float(facts.target_distance_mm[view])
            width_mm = facts.widths.of_distance_mm(stated_mm)
            off = off * math.sqrt(facts.shared[view])
        fitted_mm = stated_mm + off * width_mm
        return Statement(quantity, where, stated_mm, width_mm, fitted_mm)


def statements_of(
    facts: Facts,
    layout: Layout,
    unit_mm: float,
    depth_mm: Float[np.ndarray, " views"],
) -> Statements:
    """The statements as residuals of parameters.

    Parameters
    ----------
    unit_mm : Principal distance at parameters of zero.
    depth_mm : Of the boards from the entrance pupil, at parameters of zero.
    """
    size, views = layout.size(len(depth_mm)), len(depth_mm)
    nearer = layout.local_indices("pose", views)[:, 5]
    pupil = layout.blocks["pupil_offset"].start
    focal_width, known = facts.focal_length_width, facts.perspective
    of_lens: list[_OfLens] = [
        _OfLens(
            "focal_length",
            "focal_length",
            1 / focal_width,
            math.log(facts.principal_distance_mm / unit_mm) / focal_width,
        ),
        _known_statement(_PUPIL, "pupil_offset", known.pupil, unit_mm),
    ]
    if not layout.anamorphic:
        of_lens.append(
            _known_statement(_PUPIL_SHIFT, "pupil_shift", known.pupil_shift, unit_mm)
        )
    quantities: list[Quantity] = [one.quantity for one in of_lens]
    where = [""] * len(of_lens)
    rows = [np.zeros(size) for _ in of_lens]
    for row, one in zip(rows, of_lens, strict=True):
        row[layout.blocks[one.block]] = one.slope
    wanted = [one.wanted for one in of_lens]
    for view in np.flatnonzero(np.isfinite(facts.target_distance_mm)):
        stated_mm = float(facts.target_distance_mm[view])
        width_mm = facts.widths.of_distance_mm(stated_mm)
        width_mm *= math.sqrt(facts.shared[view])
        row = np.zeros(size)
        row[pupil] = unit_mm / width_mm
        row[nearer[view]] = depth_mm[view] / width_mm
        rows.append(row)
        wanted.append((stated_mm - depth_mm[view]) / width_mm)
        quantities.append("target_distance")
        where.append(facts.names[view])
    return Statements(
        facts,
        tuple(quantities),
        tuple(where),
        np.array(rows),
        np.array(wanted),
        np.pad([one.common for one in of_lens], (0, len(rows) - len(of_lens))),
        np.ones(len(rows)),
    )


class _OfLens(NamedTuple):
    """A statement about one parameter: residual = slope parameter - wanted."""

    quantity: Quantity
    block: str
    slope: float
    wanted: float
    common: float = 0.0


_PUPIL: tuple[Quantity, Quantity] = (
    "usual_entrance_pupil",
    "entrance_pupil_at_other_focus",
)
_PUPIL_SHIFT: tuple[Quantity, Quantity] = (
    "usual_pupil_shift",
    "pupil_shift_at_other_focus",
)


def _known_statement(
    usual_or_known: tuple[Quantity, Quantity],
    block: str,
    known: KnownPupil | KnownPupilShift,
    unit_mm: float,
) -> _OfLens:
    width_mm = known.standard_deviation_mm
    return _OfLens(
        usual_or_known[known.common_deviation_mm > 0],
        block,
        unit_mm / width_mm,
        known[0] / width_mm,
        known.common_deviation_mm / width_mm,
    )
