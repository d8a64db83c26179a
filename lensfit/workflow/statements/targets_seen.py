"""Photographs that do not show the target that is stated of them.

Where such a photograph shows another target of the shoot, and photographs and takes
come out even, files and takes were exchanged: names were counted from another one, or
sorted otherwise. Then nothing that is stated of any take need hold for its photograph,
and whatever else contradicts is a consequence.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import final

from lensfit.errors import LensfitError
from lensfit.report.evidence import joined
from lensfit.workflow.calibration.observe import (
    Observed,
    detections_of,
    photograph_of,
)
from lensfit.workflow.shoot.shoot_records import Shoot
from lensfit.workflow.statements.contradiction import Contradiction

_FEWEST_POINTS = 40
_MOST_NAMES = 3


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
    return [_exchanged(missed) if exchanged else _not_there(missed, len(observed))]


def _exchanged(missed: Sequence[MissedTarget]) -> Contradiction:
    listed = [f"{Path(m.image).stem} shows “{m.shown}”" for m in missed[:_MOST_NAMES]]
    return Contradiction(
        kind="exchanged",
        limit="look",
        text=f"photographs are exchanged: {joined(listed)}, where the takes state "
        f"{joined(list(dict.fromkeys(f'“{m.target}”' for m in missed)))}; all files "
        "may be off by one",
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
