"""A check in words, a line for each figure."""

from collections.abc import Iterator, Sequence

from lensfit.report.evidence import joined
from lensfit.workflow.check.check_records import (
    Check,
    Coverage,
    Exposure,
    FocusSide,
    Sharpness,
)
from lensfit.workflow.check.figures import CORNERS
from lensfit.workflow.check.planned_views import PlannedView

_MOST_NAMES = 6


def sentences(judged: Check) -> Iterator[tuple[str, str]]:
    """Name and text of each line."""
    if judged.take is not None:
        yield "view", judged.take
    if judged.columns is not None and judged.rows is not None:
        across, down = judged.columns, judged.rows
        yield (
            "target",
            f"{judged.target}: {judged.points} points, numbered {across[0]} to "
            f"{across[1]} across and {down[0]} to {down[1]} down",
        )
    if judged.coverage is not None:
        yield "frame", coverage_text(judged.coverage)
    if judged.exposure is not None:
        yield "light", exposure_text(judged.exposure)
    if judged.sharpness is not None:
        yield "blur", sharpness_text(judged.sharpness)
    if judged.motion is not None:
        motion = judged.motion
        yield (
            "motion",
            f"{motion.length_px:.1f} px {motion.way}"
            if motion.moved
            else f"none above {motion.length_px:.1f} px",
        )
    if judged.focus is not None:
        text = focus_text(judged.focus)
        if text:
            yield "focus", text
    yield "time", f"{judged.seconds:.1f} s"


def coverage_text(coverage: Coverage) -> str:
    """Part of the frame, gaps and corners."""
    absent = [corner for corner in CORNERS if corner not in coverage.corners_reached]
    corners = "all corners reached"
    if absent:
        corners = f"not reached: {joined(absent)} corner" + "s" * (len(absent) > 1)
    gaps = f", gaps {joined(list(coverage.gaps))}" if coverage.gaps else ""
    return f"{coverage.share:.0%} covered{gaps}; {corners}"


def exposure_text(exposure: Exposure) -> str:
    """Stops below clipping and above the noise."""
    below, above = exposure.below_clipping_stops, exposure.above_noise_stops
    parts = ["where the file clips is not known"]
    if below is not None:
        parts = [f"brightest points {max(below, 0.0):.1f} stops below clipping"]
    if above is not None:
        parts.append(f"{above:.1f} stops above the noise")
    parts.append(f"{exposure.clipped_points} of {exposure.points} points clipped")
    return ", ".join(parts)


def sharpness_text(sharpness: Sharpness) -> str:
    """Blur at centre, middle and edge."""
    zones = (
        ("centre", sharpness.centre_px),
        ("middle", sharpness.middle_px),
        ("edge", sharpness.edge_px),
    )
    known = [f"{name} {value:.1f} px" for name, value in zones if value is not None]
    text = ", ".join(known) or "too few points"
    return text + (" (with the dots' own size)" if sharpness.holds_feature else "")


def focus_text(side: FocusSide) -> str:
    """Stated side, and what image size says of it."""
    parts = [] if side.stated is None else [f"stated {side.stated}"]
    if side.breathing_percent:
        parts.append(f"imaged {side.breathing_percent:+.2f} % against {side.reference}")
    if side.agrees is not None:
        parts.append(
            "as on earlier views" if side.agrees else f"but as {side.same_side_as}"
        )
    return ", ".join(parts)


def plan_sentence(views: Sequence[PlannedView]) -> str:
    """How many views are done, and which are missing or to be shot again."""
    done = sum(view.state == "done" for view in views)
    text = f"{done} of {len(views)} views done"
    for state, words in (("again", "shoot again"), ("missing", "missing")):
        names = [view.image for view in views if view.state == state]
        if names:
            more = len(names) - _MOST_NAMES
            listed = ", ".join(names[:_MOST_NAMES]) + (f" and {more} more" * (more > 0))
            text += f"; {words}: {listed}"
    return text
