"""Problems of a photograph, from its figures: text and the one thing to do."""

from collections.abc import Iterator

from lensfit.detect.sharpening import edge_profile, sharpening_of
from lensfit.photograph import Photograph
from lensfit.workflow.check.check_records import (
    Coverage,
    Exposure,
    FocusSide,
    Problem,
    Sharpness,
)
from lensfit.workflow.check.motion import Motion

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
