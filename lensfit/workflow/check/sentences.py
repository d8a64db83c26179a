"""A check in words: a line for each figure, and problems with the one thing to do."""

from collections.abc import Iterator, Sequence

from lensfit.detect.sharpening import edge_profile, sharpening_of
from lensfit.photograph import Photograph
from lensfit.report.evidence import sentence_list
from lensfit.workflow.check.check_records import (
    Check,
    Coverage,
    Exposure,
    FocusSide,
    Problem,
    Sharpness,
)
from lensfit.workflow.check.figures import CORNERS
from lensfit.workflow.check.motion import Motion
from lensfit.workflow.check.photographs import PlannedView

_LITTLE_COVERED = 0.5
_DIM_STOPS = 4.0
_FAINT_STOPS = 5.0
_CLIPPED_PART = 0.1
_UNSHARP_PX = 6.0


def coverage_problems(coverage: Coverage) -> Iterator[Problem]:
    """Too little of the frame is covered."""
    if coverage.share < _LITTLE_COVERED:
        yield Problem(
            "coverage",
            "caution",
            f"the target covers {coverage.share:.0%} of the frame",
            "move it closer, or shoot further views with it in the other parts",
        )


def exposure_problems(exposure: Exposure) -> Iterator[Problem]:
    """Clipped, or too dim."""
    clipped = exposure.clipped_points
    if clipped > _CLIPPED_PART * exposure.points:
        yield Problem(
            "clipping",
            "bad",
            f"{clipped} of {exposure.points} detected points touch clipped samples",
            "expose a stop less",
        )
    elif clipped:
        yield Problem(
            "clipping",
            "caution",
            f"{clipped} of {exposure.points} detected points touch clipped samples",
            "expose half a stop less",
        )
    below, above = exposure.below_clipping_stops, exposure.above_noise_stops
    if below is not None and below > _DIM_STOPS:
        yield Problem(
            "exposure",
            "caution",
            f"the target is {below:.1f} stops below clipping",
            f"expose {below - 1:.0f} stops more by time or light, not by f-number",
        )
    elif above is not None and above < _FAINT_STOPS:
        yield Problem(
            "exposure",
            "caution",
            f"the target is {above:.1f} stops above the noise",
            "expose longer, or average several exposures",
        )


def sharpening_problems(photograph: Photograph) -> Iterator[Problem]:
    """The camera sharpened it."""
    sharpening = sharpening_of([edge_profile(photograph)])
    if sharpening is not None:
        yield Problem(
            "sharpening",
            "caution",
            sharpening.sentence,
            "switch sharpening off in the camera, or photograph raw",
        )


def motion_problems(motion: Motion | None) -> Iterator[Problem]:
    """The camera or the target moved."""
    if motion is not None and motion.moved:
        yield Problem(
            "motion",
            "bad",
            f"camera or target moved by some {motion.length_px:.1f} px {motion.way}",
            "lock both off, use a remote release and shoot it again",
        )


def focus_problems(
    side: FocusSide, sharpness: Sharpness | None, sharper: str | None
) -> Iterator[Problem]:
    """The side of focus, or its place, is not the stated one.

    Parameters
    ----------
    sharper : A view stated out of focus that is sharper than this one, stated in focus.
    """
    if side.same_side_as is not None:
        yield Problem(
            "focus_side",
            "bad",
            f"is stated as focused {side.stated}, but its image size changed by "
            f"{side.breathing_percent:+.2f} % as if on the side opposite to "
            f"{side.same_side_as}",
            "check focus_distance_mm of both views: near and far may be swapped",
        )
    if sharper is not None:
        yield Problem(
            "focus",
            "bad",
            f"is stated in focus, but {sharper}, stated out of focus, is sharper",
            "focus on the target again, or check focus_distance_mm of both views",
        )
    if side.stated == "on the target" and sharpness is not None:
        centre, edge = sharpness.centre_px, sharpness.edge_px
        sharp_outside = edge is not None and centre is not None and centre > 3 * edge
        if centre is not None and centre > _UNSHARP_PX and not sharp_outside:
            yield Problem(
                "focus",
                "caution",
                f"is stated in focus, but its blur is {centre:.1f} px wide at the "
                "centre",
                "focus on the target again",
            )


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
        corners = f"not reached: {sentence_list(absent)} corner" + "s" * (
            len(absent) > 1
        )
    gaps = f", gaps {sentence_list(list(coverage.gaps))}" if coverage.gaps else ""
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
