"""Detect depth in the wrong unit: nothing of the plate is in focus.

A plate that was lit and framed for a focus distance shows something near it. Where all
of its depth is far out of focus, and would not be in another unit, that unit is named.
A single element of a composite may be out of focus as a whole, so this is a note.
"""

import numpy as np
from jaxtyping import Float32

from lensfit.io.depth_channel import UNITS_MM
from lensfit.rendering.circle import Circle

_LEAST_PX = 0.5
_PART_OF_WIDTH = 2e-3
"""Radius of blur, over the width of the frame, that is taken as out of focus."""


def depth_doubt(
    depth_mm: Float32[np.ndarray, "*shape"],
    circle: Circle,
    unit_mm: float,
    width_px: int,
) -> str | None:
    """Whether the depths put everything out of focus; None if something is in focus.

    Parameters
    ----------
    depth_mm : Perpendicular, from the pinhole; infinite for the sky.
    circle : Of confusion, of the lens at the state of the plate.
    unit_mm : What a number of the depth channel was taken for.
    width_px : Of the frame.
    """
    finite = depth_mm[np.isfinite(depth_mm)]
    if finite.size == 0 or circle.px_mm == 0:
        return None
    near_mm, far_mm = float(finite.min()), float(finite.max())
    focus_mm = circle.depth_mm(0.0)
    most_px = max(_LEAST_PX, _PART_OF_WIDTH * width_px)

    def in_focus(scale: float) -> bool:
        ends_mm = np.array([near_mm, far_mm], np.float32) * np.float32(scale)
        if ends_mm[0] <= focus_mm <= ends_mm[1]:
            return True
        return bool(np.abs(circle.radius_px(ends_mm)).min() <= most_px)

    has_sky = finite.size < depth_mm.size
    sky_px = abs(float(circle.radius_px(np.full(1, np.inf, np.float32))[0]))
    if in_focus(1.0) or (has_sky and sky_px <= most_px):
        return None
    others = [name for name, mm in UNITS_MM.items() if in_focus(mm / unit_mm)]
    remedy = f"in {' or '.join(others)} it would be" if others else "check the unit"
    return (
        f"nothing is in focus: depth lies between {near_mm:g} and {far_mm:g} mm, the "
        f"focus at {focus_mm:g} mm from the pinhole; {remedy} (--depth-unit, "
        "--focus-distance-mm)"
    )
