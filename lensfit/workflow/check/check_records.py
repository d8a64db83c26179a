"""Records of a check of one photograph: figures, and problems with what to do.

Every record is plain numbers and words, so that a terminal, JSON and the picture show
the same.
"""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal, final

from lensfit.workflow.check.motion import Motion

Level = Literal["good", "caution", "bad"]


@final
@dataclass(frozen=True)
class Problem:
    """What is wrong with a photograph.

    Attributes
    ----------
    kind : One word for programs.
    level : "bad" where it should be shot again, "caution" where it may be used.
    text : What, with figures.
    remedy : What to do now.
    """

    kind: str
    level: Level
    text: str
    remedy: str


@final
@dataclass(frozen=True)
class Coverage:
    """Where on the frame the target is.

    Attributes
    ----------
    share : Of 8 x 6 cells that hold a detected point.
    gaps : Ninths of the frame with empty cells.
    corners_reached : Corners whose cell holds a detected point.
    """

    share: float
    gaps: tuple[str, ...]
    corners_reached: tuple[str, ...]


@final
@dataclass(frozen=True)
class Exposure:
    """How bright the target is.

    Attributes
    ----------
    below_clipping_stops : From the brightest of its points to where samples clip; None
        where the file's ceiling is not known.
    above_noise_stops : From the usual one down to the noise of the dark.
    clipped_points, points : Detected points that touch clipped samples, of how many.
    clipped_share : Part of the frame's samples that are clipped.
    """

    below_clipping_stops: float | None
    above_noise_stops: float | None
    clipped_points: int
    points: int
    clipped_share: float


@final
@dataclass(frozen=True)
class Sharpness:
    """Width of the blur: the diameter of the disc of the same second moments.

    Attributes
    ----------
    centre_px, middle_px, edge_px : Medians within 0.4, 0.4 to 0.75 and beyond 0.75 of
        the half diagonal; None where nothing is measured. A pixel alone is 1.2.
    zones_px : Medians in ninths of the frame, row 0 on top.
    holds_feature : The size of dots is not stated, and is in the figures.
    """

    centre_px: float | None
    middle_px: float | None
    edge_px: float | None
    zones_px: tuple[tuple[float | None, ...], ...]
    holds_feature: bool


@final
@dataclass(frozen=True)
class FocusSide:
    """On which side of focus the target is.

    Attributes
    ----------
    stated : "on the target", "nearer than the target", "beyond the target"; None where
        the distances are not stated.
    breathing_percent : How much larger the target is imaged than on `reference`, the
        sharpest view of the same standing target.
    reference : Its name.
    agrees : Whether image size changes as on the views before; None where they cannot
        tell.
    same_side_as : The view that contradicts, if any.
    """

    stated: str | None
    breathing_percent: float | None = None
    reference: str | None = None
    agrees: bool | None = None
    same_side_as: str | None = None


@final
@dataclass(frozen=True)
class Check:
    """One photograph, judged.

    Attributes
    ----------
    image : Path of the photograph.
    take : The view of the shoot file that it is, as the file names it.
    target, kind : What was found.
    columns, rows : Smallest and largest lattice index each way.
    numbered_by_chart : Indices are the chart's own.
    seconds : From file to figures.
    """

    image: Path
    take: str | None
    level: Level
    problems: tuple[Problem, ...]
    seconds: float
    target: str | None = None
    kind: str | None = None
    points: int = 0
    columns: tuple[int, int] | None = None
    rows: tuple[int, int] | None = None
    coverage: Coverage | None = None
    exposure: Exposure | None = None
    sharpness: Sharpness | None = None
    motion: Motion | None = None
    motion_measured: bool = False
    focus: FocusSide | None = None
    notes: tuple[str, ...] = ()
    picture: Path | None = None

    def as_json(self) -> dict[str, Any]:
        """In types that JSON knows."""
        record = asdict(self)
        for key in ("image", "picture"):
            record[key] = None if record[key] is None else str(record[key])
        return record


def worst_level(problems: tuple[Problem, ...]) -> Level:
    """Of all problems; "good" where there are none."""
    levels = {problem.level for problem in problems}
    return "bad" if "bad" in levels else "caution" if levels else "good"
