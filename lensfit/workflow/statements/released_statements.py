"""Find the wrong statement: each is released in turn, and the misfit compared.

If statements, targets and views agree, every residual of a statement is about its own
width. If they do not, the misfit of the joint model is large, and releasing the one
wrong statement removes it, while releasing a right one does not. The statement whose
release explains most is named, with the value that it would have.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import final

import numpy as np

from lensfit.fitting.chart_view import View
from lensfit.workflow.statements.contradiction import Contradiction
from lensfit.workflow.statements.joint_model import (
    RELEASED_SD,
    JointModel,
    Solution,
    joint_model,
    noise_of_model_px,
)
from lensfit.workflow.statements.lens_identity import lenses_contradiction

_MOST_MISFIT_PX = 1.5
"""Free of statements, beyond which the model is no judge of them."""
_CONTRADICTED = 30.0
"""Chi-squared that statements add: five standard deviations of one of them."""
_SUSPICIOUS = 10.0
"""Up to which nothing is looked for; right shoots add a few."""
_EXPLAINS = 0.6
_AS_WELL = 0.9
"""Of the best explanation: what explains so much is as probable."""
_PER_NUMBER = 10.0
"""Chi-squared that a further number must explain."""
_RELEASED_TAPE_SDS = 1e4
"""Of a tape's own standard deviation: another unit is within them."""
_MOST_ROUNDS = 2
_BY_ITSELF = 1 + 1e-9
"""Times the focal length of views that share their parameters with no other."""
_LEAST_CHANGE = 0.03
"""Of focal length, below which no view is of another lens."""
_FORGIVEN = {"pitch": 0.01, "focal_length": 0.06, "target_distance": 0.03}
"""Relative change below which no release is worth naming."""


@final
@dataclass(frozen=True)
class _Release:
    """A statement let go of, and what remains."""

    kind: str
    key: tuple | int | None
    shared: dict[tuple, float]
    distances: frozenset[int]
    solution: Solution


def contradicted_statements(takes: Sequence[View]) -> Iterator[Contradiction]:
    """Statements of pitch, focal length and distance that the views contradict.

    Parameters
    ----------
    takes : With detected points; views of one lens.
    """
    model = joint_model(takes)
    if model is None or len(model.views) < 1:
        return
    noise_px, _ = noise_of_model_px(model)
    if noise_px > _MOST_MISFIT_PX:
        return
    shared: dict[tuple, float] = {}
    distances: frozenset[int] = frozenset()
    solution = model.solve(noise_px)
    least = _all_released(model, noise_px, solution)
    for _ in range(_MOST_ROUNDS):
        misfit = solution.chi_squared - least.chi_squared
        if misfit < _SUSPICIOUS:
            return
        releases: list[_Release] = []
        if misfit > _CONTRADICTED:
            releases = _releases(model, noise_px, solution, shared, distances)
        explained = [solution.chi_squared - r.solution.chi_squared for r in releases]
        most = max(explained[:1], default=0.0)
        if not shared and not distances:
            best_of = releases[0] if releases else None
            restated = _restatement(model, best_of, noise_px, solution, misfit, most)
            if restated is not None:
                gained = solution.chi_squared - restated.chi_squared
                yield restated.named(min(gained / misfit, 1.0))
                return
        if not releases:
            return
        if most < _EXPLAINS * misfit:
            yield _unexplained_contradiction(misfit)
            return
        as_well = [
            one
            for one, much in zip(releases[1:], explained[1:], strict=True)
            if much > _AS_WELL * most
        ]
        best = releases[0]
        yield _named_contradiction(model, best, as_well, most / misfit)
        shared, distances = best.shared, best.distances
        solution = best.solution


def _restatement(
    model: JointModel,
    best: _Release | None,
    noise_px: float,
    stated: Solution,
    misfit: float,
    released: float,
) -> "_Exchange | _OtherLens | None":
    """Other statements that explain the misfit better than the best release does.

    Pitches exchanged free nothing, and need to explain as much; views of another lens
    free several numbers, and must explain more, unless no release explains enough.

    Parameters
    ----------
    misfit, released : Chi-squared to explain, and what the best release explains.
    """
    takes = [view.take for view in model.views]
    least = max(_CONTRADICTED, _EXPLAINS * misfit)
    exchange = _best_exchange(takes, noise_px)
    if exchange is not None:
        gained = stated.chi_squared - exchange.chi_squared
        if gained > max(least, _AS_WELL * released):
            return exchange
    more = released + _PER_NUMBER if released > _EXPLAINS * misfit else 0.0
    other = _best_other_lens(model, noise_px)
    moved = best is not None and isinstance(best.key, int) and takes[best.key]
    if other is None or (more and list(other.takes) == [moved]):
        return None
    if stated.chi_squared - other.chi_squared > max(least, more):
        return other
    return None


@final
@dataclass(frozen=True)
class _OtherLens:
    """Views in a row through a lens, zoom setting or sensor mode of their own."""

    takes: Sequence[View]
    factor: float
    chi_squared: float

    def named(self, share: float) -> Contradiction:
        """The record, with the part of the misfit that this explains."""
        f_mm = self.takes[0].focal_length_mm
        own_mm = f_mm * self.factor
        agree = "agree" if len(self.takes) > 1 else "agrees"
        mixed = lenses_contradiction(f_mm, self.takes, f"{agree} with {own_mm:.4g} mm")
        return replace(mixed, agrees_with=own_mm, explained=share)


def _best_other_lens(model: JointModel, noise_px: float) -> _OtherLens | None:
    """The views that leave least once they have a focal length of their own: one, or
    several that were taken one after the other, up to half of all."""
    takes, found = [view.take for view in model.views], []
    for first, count in _runs(len(takes)):
        mine = takes[first : first + count]
        if len({take.focal_length_mm for take in mine}) > 1:
            continue
        own_mm = mine[0].focal_length_mm * _BY_ITSELF
        their_own = [replace(take, focal_length_mm=own_mm) for take in mine]
        apart = model.of_takes([*takes[:first], *their_own, *takes[first + count :]])
        name = ("focal_length", own_mm)
        solution = apart.solve(noise_px, {name: RELEASED_SD})
        factor = float(np.exp(apart.value(solution, name)))
        if abs(factor - 1) > _LEAST_CHANGE:
            found.append(_OtherLens(mine, factor, solution.chi_squared))
    return min(found, key=lambda one: one.chi_squared, default=None)


def _runs(views: int) -> Iterator[tuple[int, int]]:
    """First and count of the views in every row of them, the shortest rows first."""
    for count in range(1, views // 2 + 1):
        yield from ((first, count) for first in range(views - count + 1))


@final
@dataclass(frozen=True)
class _Exchange:
    """Two targets, each with the pitch that is stated of the other."""

    targets: tuple[str, str]
    pitches_mm: tuple[float, float]
    chi_squared: float

    def named(self, share: float) -> Contradiction:
        """The record, with the part of the misfit that this explains."""
        (one, other), (its_mm, others_mm) = self.targets, self.pitches_mm
        return Contradiction(
            kind="pitch",
            limit="undistortion",
            text=f"pitch_mm of targets “{one}” and “{other}” are exchanged: the "
            f"photographs agree with {others_mm:.4g} mm and {its_mm:.4g} mm, not with "
            f"{its_mm:.4g} mm and {others_mm:.4g} mm",
            remedy="exchange both pitch_mm in the shoot file, and calibrate again",
            statement=f'pitch_mm of target "{one}"',
            stated=its_mm,
            agrees_with=others_mm,
            explained=share,
        )


def _best_exchange(takes: Sequence[View], noise_px: float) -> _Exchange | None:
    """The two pitches whose exchange leaves least; None where no two differ.

    It frees nothing, so what it explains as well as a release does is the cause.
    """
    pitches = {take.target: take.pitch_mm for take in takes}
    found = []
    for one, other in combinations(pitches, 2):
        swapped = {one: pitches[other], other: pitches[one]}
        if abs(np.log(pitches[one][0] / pitches[other][0])) < _FORGIVEN["pitch"]:
            continue
        restated = [
            replace(take, pitch_mm=swapped.get(take.target, take.pitch_mm))
            for take in takes
        ]
        model = joint_model(restated)
        if model is not None:
            chi_squared = model.solve(noise_px).chi_squared
            mm = pitches[one][0], pitches[other][0]
            found.append(_Exchange((one, other), mm, chi_squared))
    return min(found, key=lambda exchange: exchange.chi_squared, default=None)


def _all_released(model: JointModel, noise_px: float, begin: Solution) -> Solution:
    wide = {n: RELEASED_SD for n in model.names if n[0] in ("focal_length", "pitch")}
    every = frozenset(range(len(model.views)))
    return model.solve(noise_px, wide, every, begin.parameters)


def _releases(
    model: JointModel,
    noise_px: float,
    solution: Solution,
    shared: dict[tuple, float],
    distances: frozenset[int],
) -> list[_Release]:
    """Every statement released besides those that are, the best first."""
    tried: list[tuple[str, tuple | int | None, dict[tuple, float], frozenset[int]]] = []
    for name in model.names:
        if name[0] in ("pitch", "focal_length") and name not in shared:
            tried.append((name[0], name, shared | {name: RELEASED_SD}, distances))
    stated = [k for k in model.stated if k not in distances]
    for k in stated:
        tried.append(("target_distance", k, shared, distances | {k}))
    tapes = {("tape", model.views[k].take.target_distance_mm) for k in stated}
    if len(stated) > 1 and not tapes & set(shared):
        # A tape is wrong alike wherever it was read: a number for each distance, while
        # views that differ by more than a target put up again still contradict it.
        wide = shared | dict.fromkeys(tapes, _RELEASED_TAPE_SDS)
        tried.append(("target_distance", None, wide, distances))
    found = [
        _Release(
            kind,
            key,
            wide,
            free,
            # Poses as they were found lie at the distance that the images have by the
            # focal length: near the end where a tape was in another unit.
            model.solve(
                noise_px, wide, free, None if key is None else solution.parameters
            ),
        )
        for kind, key, wide, free in tried
    ]
    worth = [one for one in found if _change(model, one) > _FORGIVEN[one.kind]]
    # All distances at once explain what one pitch does with more numbers.
    return sorted(
        worth,
        key=lambda one: (
            one.solution.chi_squared + _PER_NUMBER * (one.key is None) * len(tapes)
        ),
    )


def _change(model: JointModel, release: _Release) -> float:
    """Relative change of the statement by its release."""
    if release.kind != "target_distance":
        assert isinstance(release.key, tuple)
        return abs(float(np.expm1(model.value(release.solution, release.key))))
    keys = [release.key] if release.key is not None else model.stated
    changes = []
    for k in keys:
        assert isinstance(k, int)
        stated = model.views[k].take.target_distance_mm or np.inf
        changes.append(abs(model.distance_mm(release.solution, k) / stated - 1))
    return float(np.median(changes))


def _named_contradiction(
    model: JointModel, best: _Release, as_well: list[_Release], share: float
) -> Contradiction:
    statement, stated, value, unit, images = _value(model, best)
    others = [_value(model, one)[:4] for one in as_well if one.key is not None]
    others += _other_sensor(model, best)
    text = (
        f"{statement} is stated as {stated:.4g} {unit}, but the photographs agree "
        f"with {value:.4g} {unit}"
    )
    remedy = f"check {statement}"
    if others:
        listed = [f"{name} = {other:.4g} {its}" for name, _, other, its in others]
        text += f" (or with {' or '.join(listed[:2])})"
        remedy += f" and {others[0][0]}"
    if best.key is None:
        text += (
            f" (or with pitch_mm of every target {stated / value:.3g} times as large)"
        )
        remedy += " and pitch_mm of every target"
    kind = best.kind
    assert kind in ("pitch", "focal_length", "target_distance")
    return Contradiction(
        kind=kind,
        limit="undistortion",
        text=text,
        remedy=remedy + " in the shoot file, and calibrate again",
        statement=statement,
        stated=stated,
        agrees_with=value,
        explained=min(share, 1.0),
        images=images,
    )


def _other_sensor(
    model: JointModel, best: _Release
) -> list[tuple[str, float, float, str]]:
    """The width of the sensor in place of the focal length, which it is as good as."""
    if (
        best.kind != "focal_length"
        or len({v.take.focal_length_mm for v in model.views}) > 1
    ):
        return []
    width_mm = model.views[0].take.sensor_size_mm[0]
    _, stated, value, _, _ = _value(model, best)
    return [("sensor_width_mm", width_mm, width_mm * stated / value, "mm")]


def _value(
    model: JointModel, release: _Release
) -> tuple[str, float, float, str, tuple[str, ...]]:
    """Name, stated value, value once released, unit and photographs."""
    solution = release.solution
    if release.kind == "target_distance":
        k = release.key if isinstance(release.key, int) else min(model.stated)
        take = model.views[k].take
        stated = float(take.target_distance_mm or np.nan)
        place = f"target_distance_mm of {Path(take.name).stem}"
        images = (take.name,)
        if release.key is None:
            place, images = "target_distance_mm of all views", ()
        return place, stated, model.distance_mm(solution, k), "mm", images
    assert isinstance(release.key, tuple)
    factor = float(np.exp(model.value(solution, release.key)))
    if release.kind == "pitch":
        name = release.key[1]
        mine = [v.take for v in model.views if v.take.target == name]
        stated = float(mine[0].pitch_mm[0])
        images = tuple(take.name for take in mine)
        return f'pitch_mm of target "{name}"', stated, stated * factor, "mm", images
    focal = float(release.key[1])
    mine = [v.take.name for v in model.views if v.take.focal_length_mm == focal]
    return "focal_length_mm", focal, focal * factor, "mm", tuple(mine)


def _unexplained_contradiction(misfit: float) -> Contradiction:
    return Contradiction(
        kind="statements",
        limit="look",
        text="pitches, distances and focal lengths as stated contradict each other by "
        f"{np.sqrt(misfit):.0f} standard deviations, and no single one explains it",
        remedy="measure the targets' pitch and distances again",
    )
