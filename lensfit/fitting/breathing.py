"""Breathing: the change of image scale with focus distance.

A lens that moves as a whole moves away from the sensor for near focus, and its image
becomes larger. With internal focusing the image may become smaller. Where the blur is
slight, breathing is the only sign of a shoot whose near and far focus distances were
swapped, because a mirrored lens explains the blur of both about as well
(`wavefront.descent`).
"""

from collections.abc import Iterable, Iterator

from lensfit.fitting.lens_state import LensState, by_focal_length

_REVERSED = 0.003
"""Of the principal distance: well above what distances are measured to."""


def breathing_notes(states: Iterable[LensState]) -> Iterator[str]:
    """One sentence for each focal length that draws larger focused far than near.

    Only where the chart's distance was measured: the principal distance is taken from
    the stated focus otherwise.
    """
    for focal_mm, mine in by_focal_length(states).items():
        known = [
            (state.focus_distance_mm, float(state.distortion.principal_distance_mm))
            for state in mine
            if state.focus_distance_mm is not None and _measured(state)
        ]
        if len(known) < 2:
            continue
        (near_mm, near), (far_mm, far) = min(known), max(known)
        if far > (1 + _REVERSED) * near:
            yield (
                f"at {focal_mm:g} mm the picture is {100 * (far / near - 1):.1f} % "
                f"larger focused at {far_mm:g} mm than at {near_mm:g} mm, as only of "
                "lenses that focus inside: check that focus_distance_mm of near and "
                "far takes were not swapped"
            )


def _measured(state: LensState) -> bool:
    return any(view.target_distance_mm is not None for view in state.geometry.takes)
