"""Focus distances against the width of dots: where they are sharpest, how they widen.

A target at z from the entrance pupil, seen by a lens focused at s from it, is blurred
to a disc of diameter

    d = f c / N |1/z - 1/s|,

c the principal distance, whatever the lens. Second moments add, so with W the width in
focus a chart that stands still is seen through focus as

    D^2 = W^2 + (k f c / N)^2 (1/s - v)^2,

a parabola in 1/s whose vertex v is to be 1/z and whose k is to be 1. Aberration moves
the vertex by a part of W. Of the two numbers ln(v z) and ln(k)

    a factor of all focus distances, as of another unit, changes both, oppositely,
    a factor of the target's distance changes the first,
    f-numbers, focal length and the sensor's size change the second.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from lensfit.fitting.chart_view import View
from lensfit.workflow.statements.blur_statements import central_diameter_px
from lensfit.workflow.statements.contradiction import Contradiction
from lensfit.workflow.statements.joint_model import (
    PUPIL_DIAGONALS,
    joint_model,
    noise_of_model_px,
)

_FEWEST_STATES = 3
_ENGRAVED = 0.05
"""Relative deviation of engraved focus distances."""
_WIDENING = 0.2
"""Of ln(k): f-numbers, focal length and pupils are good to so much together."""
_VERTEX_MM = 0.08
"""Behind the lens: by so much aberration, curvature of field and pupils that are not
where they usually are put the sharpest image beside the stated plane; rms of twenty
traced lenses of 14 to 135 mm."""
_LEAST_RATIO = 1.2
"""Of the widest view over the sharpest, for the curve to be one."""
_CONTRADICTED, _EXPLAINS, _CLEARLY = 30.0, 0.6, 10.0
"""Chi-squared that is a contradiction; what an explanation removes of it; and by how
much it is to be better than another."""
_UNITS = (
    (1 / 3.2808, "as if feet were taken for metres"),
    (3.2808, "as if metres were taken for feet"),
    (25.4, "as if inches were taken for millimetres"),
    (10.0, "as if centimetres were taken for millimetres"),
    (1000.0, "as if metres were taken for millimetres"),
)
_UNIT_LOG = 0.1


@final
@dataclass(frozen=True)
class FocusCurve:
    """Widths of one target through focus, at one place and f-number.

    Attributes
    ----------
    takes : Its views.
    vertex_log : ln(v z): of the stated distance over that of the sharpest image.
    widening_log : ln(k): of measured over stated widening.
    vertex_sd : Standard deviation of `vertex_log` that aberration leaves.
    """

    takes: tuple[View, ...]
    vertex_log: float
    widening_log: float
    vertex_sd: float


def focus_curves(takes: Sequence[View]) -> list[FocusCurve]:
    """Of every target that stood still before three states of focus at one f-number."""
    groups: dict[tuple, list[View]] = {}
    for take in takes:
        known = take.focus_distance_mm, take.target_distance_mm, take.f_number
        if None not in known and central_diameter_px(take) is not None:
            key = take.target, take.focal_length_mm, *known[1:]
            groups.setdefault(key, []).append(take)
    return [curve for mine in groups.values() if (curve := _curve(mine)) is not None]


def focus_units(takes: Sequence[View]) -> Iterator[Contradiction]:
    """Focus distances that are all wrong by one factor, if that explains the widths.

    Parameters
    ----------
    takes : With detected points; views of one lens.
    """
    curves = focus_curves(takes)
    if not curves:
        return
    vertex, widening, sd = _means(curves)
    engraved = float(np.hypot(_ENGRAVED, sd))
    unsure = float(np.hypot(_WIDENING, max(abs(np.log(t.squeeze)) for t in takes)))
    stated = (vertex / engraved) ** 2 + (widening / unsure) ** 2
    by_focus = (vertex + widening) ** 2 / (engraved**2 + unsure**2)
    if stated < _CONTRADICTED or by_focus > (1 - _EXPLAINS) * stated:
        return
    by_target = (widening / unsure) ** 2
    if by_target < by_focus + _CLEARLY:
        by_target += _misfit_of_distances(takes, -vertex)
    by_width = (vertex / engraved) ** 2
    if by_focus + _CLEARLY < min(by_target, by_width):
        yield _other_unit(curves, vertex, 1 - by_focus / stated)


def _curve(takes: list[View]) -> FocusCurve | None:
    if len({take.focus_distance_mm for take in takes}) < _FEWEST_STATES:
        return None
    first = takes[0]
    stop = first.f_number or np.nan
    away_mm = float(first.target_distance_mm or np.nan) - _pupil_mm(first)
    if away_mm <= first.focal_length_mm:
        return None
    # As parts of the target's vergence, so that the numbers are about one.
    at = np.array([away_mm * _vergence_per_mm(take) for take in takes])
    width = np.array([central_diameter_px(take) or np.nan for take in takes])
    disc = float(np.mean([_disc_px_mm(take) for take in takes])) / away_mm
    if width.max() < _LEAST_RATIO * width.min():
        return None
    terms = np.stack([at**2, at, np.ones(len(at))], 1)
    bend, slope, rest = np.linalg.lstsq(terms, width**2, rcond=None)[0].tolist()
    if bend <= 0 or slope >= 0 or rest <= slope**2 / (4 * bend):
        return None
    vertex = -slope / (2 * bend)
    moved_px = _VERTEX_MM / float(stop * first.pixel_mm[0])
    return FocusCurve(
        takes=tuple(takes),
        vertex_log=float(np.log(vertex)),
        widening_log=float(np.log(np.sqrt(bend) / disc)),
        vertex_sd=moved_px / float(np.sqrt(bend)) / vertex,
    )


def _means(curves: Sequence[FocusCurve]) -> tuple[float, float, float]:
    """Of both logarithms, and the deviation of the first. Aberration is of the lens: no
    number of views makes it less."""
    parts = np.array([curve.vertex_sd**-2 for curve in curves])
    parts = parts / parts.sum()
    vertex = float(parts @ [curve.vertex_log for curve in curves])
    widening = float(np.mean([curve.widening_log for curve in curves]))
    return vertex, widening, float(parts @ [curve.vertex_sd for curve in curves])


def _misfit_of_distances(takes: Sequence[View], factor_log: float) -> float:
    """Chi-squared that other distances of all targets add to that of the statements."""
    restated = [
        take
        if take.target_distance_mm is None
        else replace(
            take,
            target_distance_mm=_times_from_pupil(
                take, take.target_distance_mm, factor_log
            ),
        )
        for take in takes
    ]
    model = joint_model(takes)
    if model is None:
        return 0.0
    noise_px, _ = noise_of_model_px(model)
    kept = [view.take.name for view in model.views]
    other = model.of_takes([take for take in restated if take.name in kept])
    return other.solve(noise_px).chi_squared - model.solve(noise_px).chi_squared


def _other_unit(
    curves: Sequence[FocusCurve], vertex_log: float, share: float
) -> Contradiction:
    take = max((one for c in curves for one in c.takes), key=_focus_mm)
    focus_mm = _focus_mm(take)
    target_mm = float(take.target_distance_mm or np.nan)
    factor = target_mm / _times_from_pupil(take, target_mm, -vertex_log)
    known = [words for one, words in _UNITS if abs(np.log(factor / one)) < _UNIT_LOG]
    hint = f", {known[0]}" if known else ""
    return Contradiction(
        kind="side_of_focus",
        limit="undistortion",
        text=f"focus_distance_mm is wrong in all views: the width of dots agrees with "
        f"{factor:.2g} times what is stated, {focus_mm * factor:.3g} mm instead of "
        f"{focus_mm:.4g} mm{hint}",
        remedy="check focus_distance_mm of all views, and its unit",
        statement="focus_distance_mm",
        stated=focus_mm,
        agrees_with=focus_mm * factor,
        explained=share,
        images=tuple(one.name for curve in curves for one in curve.takes),
    )


def _focus_mm(take: View) -> float:
    return float(take.focus_distance_mm or np.nan)


def _pupil_mm(take: View) -> float:
    """From the sensor to where the entrance pupil usually lies."""
    diagonals, _ = PUPIL_DIAGONALS
    return diagonals * float(np.hypot(*take.sensor_size_mm))


def _times_from_pupil(take: View, distance_mm: float, factor_log: float) -> float:
    """A distance from the sensor whose part before the entrance pupil is scaled."""
    ahead_mm = _pupil_mm(take)
    return ahead_mm + (distance_mm - ahead_mm) * float(np.exp(factor_log))


def _vergence_per_mm(take: View) -> float:
    """Of the plane in focus at the entrance pupil; of one nearer than lenses focus, at
    the sensor, so that it stays positive."""
    focus_mm, ahead_mm = _focus_mm(take), _pupil_mm(take)
    return 1 / (focus_mm - ahead_mm if focus_mm > 2 * ahead_mm else focus_mm)


def _disc_px_mm(take: View) -> float:
    """Diameter of the disc for a vergence of one: of an anamorphic lens, whose focal
    length is f, and f over the squeeze along it, the rms of both axes."""
    f, focus_mm = take.focal_length_mm, _focus_mm(take)
    c_mm = f * (1 + f / max(focus_mm - f, f))
    both = np.sqrt((1 + take.squeeze**-4) / 2)
    return float(f * c_mm / (take.f_number or np.nan) / take.pixel_mm[0] * both)
