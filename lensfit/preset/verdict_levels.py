"""The use that a lens is good enough for, as judged by its calibration.

Levels are ordered; each includes those before it: "unusable" for nothing, "look" for
soft or moving CG, "undistortion" where the stated focal length will do,
"match-moving" for CG in a tracked shot, "measurement" for surveying a set.
"""

from typing import Literal, get_args

from msgspec import Struct

Level = Literal["unusable", "look", "undistortion", "match-moving", "measurement"]
LEVELS: tuple[Level, ...] = get_args(Level)


class Reason(Struct, frozen=True, forbid_unknown_fields=True):
    """One thing that the verdict rests on.

    Attributes
    ----------
    kind : One word for programs.
    tone : "bad", "caution", "note" or "good".
    text : In words.
    remedy : The one thing to do; empty where there is none.
    """

    kind: str
    tone: str
    text: str
    remedy: str = ""


class Verdict(Struct, frozen=True, forbid_unknown_fields=True):
    """What for, to what accuracy, where in the frame, and why.

    Attributes
    ----------
    headline : What to read if nothing else is read.
    used_for : What the level means, in words.
    accuracy_px : Rms on points that the fit never saw, or the standard deviation of the
        map in the worst corner that was photographed or of objects in the corners,
        whichever is largest.
    covered : Part of the frame that points reach; elsewhere the map is extrapolated.
    extrapolated : Parts of the frame without points.
    reasons : Contradictions first, then from the worst to the good.
    """

    level: Level
    headline: str
    used_for: str
    accuracy_px: float | None
    covered: float | None
    extrapolated: tuple[str, ...]
    reasons: tuple[Reason, ...]


def is_at_least(level: str, wanted: Level) -> bool:
    """Whether a level includes the wanted one; an unknown level includes none."""
    return level in LEVELS and LEVELS.index(level) >= LEVELS.index(wanted)
