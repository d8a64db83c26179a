"""Photographs that show another target than is stated of them, or one of another size.

Where such a photograph shows another target of the shoot, and photographs and takes
come out even, files and takes were exchanged: names were counted from another one, or
sorted otherwise. Then nothing that is stated of any take need hold for its photograph,
and whatever else contradicts is a consequence.

Columns and rows are counted where the whole chart lies inside the picture, and wherever
there are more than stated. Who counted wrong has mostly divided by that count too. Of a
dim chart fewer may be seen than there are: then all photographs must agree.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import final

import numpy as np

from lensfit.detect.lattice_map import lattice_map
from lensfit.detect.observations import Observations
from lensfit.errors import LensfitError
from lensfit.report.evidence import sentence_list
from lensfit.workflow.calibration.observe import (
    Observed,
    detections_of,
    photograph_of,
)
from lensfit.workflow.shoot.shoot_records import Shoot, Target
from lensfit.workflow.statements.contradiction import Contradiction

_FEWEST_POINTS = 40
_MOST_NAMES = 3
_FEWEST_IN_COLUMN = 3
"""Points, for a column or row to be one."""
_FEWEST_COUNTED = 2
"""Photographs that show another count."""
_BEYOND = 1.5
"""Pitches beyond the last column at which a further one would be whole."""


@final
@dataclass(frozen=True)
class MissedTarget:
    """A photograph on which the stated target was not found.

    Attributes
    ----------
    kind : Of the stated target, in words.
    shown : Name of the target of the shoot that it shows instead; None for none.
    """

    image: str
    target: str
    kind: str
    shown: str | None


def missed_targets(shoot: Shoot, observed: Sequence[Observed]) -> list[MissedTarget]:
    """Every photograph without its target, searched for the other ones."""
    return [
        MissedTarget(
            one.image, one.target, one.target_not_found, _target_shown(shoot, one)
        )
        for one in observed
        if one.target_not_found
    ]


def contradicted_targets(
    missed: Sequence[MissedTarget], observed: Sequence[Observed]
) -> list[Contradiction]:
    """At most one: photographs exchanged, or targets that are not there."""
    if not missed:
        return []
    shown = {one.image: one.shown for one in missed}
    found = Counter(shown.get(one.image, one.target) for one in observed)
    exchanged = found == Counter(one.target for one in observed)
    return [
        _exchange_contradiction(missed)
        if exchanged
        else _not_there(missed, len(observed))
    ]


def _exchange_contradiction(missed: Sequence[MissedTarget]) -> Contradiction:
    listed = [f"{Path(m.image).stem} shows “{m.shown}”" for m in missed[:_MOST_NAMES]]
    shown = sentence_list(listed)
    stated = sentence_list(list(dict.fromkeys(f"“{m.target}”" for m in missed)))
    return Contradiction(
        kind="exchanged",
        limit="look",
        text=f"photographs are exchanged: {shown}, where the takes state {stated}; all "
        "files may be off by one",
        remedy="check image of every take against the slates",
        statement="image",
        images=tuple(one.image for one in missed),
    )


def _not_there(missed: Sequence[MissedTarget], count: int) -> Contradiction:
    first, others = missed[0], len(missed) - 1
    more = f", nor on {others} more" if others else ""
    instead = f" and “{first.shown}” is seen there" if first.shown else ""
    return Contradiction(
        kind="target",
        limit="undistortion" if 2 * len(missed) < count else "look",
        text=f"no {first.kind} is found on {first.image}{more}, though target "
        f"“{first.target}” is stated{instead}",
        remedy="check target and image of these takes, else shoot them again",
        statement="target",
        images=tuple(one.image for one in missed),
    )


def _target_shown(shoot: Shoot, missed: Observed) -> str | None:
    """The first target of another kind that is found on a photograph."""
    stated = shoot.targets[missed.target]
    others = [one for one in shoot.targets.values() if one.kind != stated.kind]
    take = next(one for one in shoot.takes if one.image == missed.image)
    for target in others:
        try:
            photograph = photograph_of(shoot, take)
            if len(detections_of(photograph, target, take.roi)) >= _FEWEST_POINTS:
                return target.name
        except (LensfitError, ValueError):
            continue
    return None


def contradicted_counts(
    shoot: Shoot, observed: Sequence[Observed]
) -> Iterator[Contradiction]:
    """Targets with another number of columns or rows than is stated."""
    for target in shoot.targets.values():
        stated = _stated_count(target)
        views = _views_to_count(shoot, observed, target)
        if stated is None or not views:
            continue
        counts = Counter(count for one in views if (count := _count(one, stated)))
        if not counts:
            continue
        (usual, number), judged = counts.most_common(1)[0], counts.total()
        is_more = any(a > b for a, b in zip(sorted(usual), sorted(stated), strict=True))
        enough = judged // 2 + 1 if is_more else judged
        if sorted(usual) == sorted(stated) or number < max(enough, _FEWEST_COUNTED):
            continue
        yield _other_count(target, stated, usual, number)


def _stated_count(target: Target) -> tuple[int, int] | None:
    """Columns and rows of dots, or of corners between squares."""
    if target.kind == "dot-grid":
        return target.marks
    if target.kind == "checkerboard" and target.squares is not None:
        return target.squares[0] - 1, target.squares[1] - 1
    return None


def _views_to_count(
    shoot: Shoot, observed: Sequence[Observed], target: Target
) -> list[Observations]:
    """What is found on photographs of a target that were searched as a whole."""
    in_part = {take.image for take in shoot.takes if take.roi is not None}
    return [
        one.take.observations
        for one in observed
        if one.take is not None
        and one.target == target.name
        and one.image not in in_part
    ]


def _count(found: Observations, stated: tuple[int, int]) -> tuple[int, int] | None:
    """Columns and rows that are seen; None where there may be more, up to as many as
    stated, outside the picture."""
    mapped, cells = lattice_map(found), np.rint(found.lattice).astype(int)
    if mapped is None:
        return None
    ends = []
    for axis in (0, 1):
        values, numbers = np.unique(cells[:, axis], return_counts=True)
        values = values[numbers >= _FEWEST_IN_COLUMN]
        if not values.size:
            return None
        ends.append((int(values[0]), int(values[-1])))
    columns, rows = (high - low + 1 for low, high in ends)
    seen, most = sorted((columns, rows)), sorted(stated)
    if seen[0] > most[0] or seen[1] > most[1]:
        return columns, rows
    around = [np.linspace(low - _BEYOND, high + _BEYOND, 9) for low, high in ends]
    i, j = (one.ravel() for one in np.meshgrid(*around))
    border = np.isin(i, around[0][[0, -1]]) | np.isin(j, around[1][[0, -1]])
    at = mapped.points_px(np.stack([i, j], 1)[border])
    is_whole = ((at > 0) & (at < found.image_size_px)).all()
    return (columns, rows) if is_whole else None


def _other_count(
    target: Target, stated: tuple[int, int], seen: tuple[int, int], views: int
) -> Contradiction:
    key, more = ("marks", 0) if target.kind == "dot-grid" else ("squares", 1)
    own, its = ([n + more for n in size] for size in (stated, seen))
    if (own[0] > own[1]) != (its[0] > its[1]):
        its.reverse()
    pitch_mm = target.pitch_xy_mm[0]
    return Contradiction(
        kind="target",
        limit="match-moving",
        text=f"{key} = {own} is stated of target “{target.name}”, but {views} "
        f"photographs show {its[0]} columns and {its[1]} rows",
        remedy=f"count again, and check pitch_mm = {pitch_mm:g}, which may come from "
        "the wrong count",
        statement=f'{key} of target "{target.name}"',
    )
