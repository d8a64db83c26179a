"""Focus on what is so far from the entrance pupil.

Depth and some focus distances are measured from the pinhole of the CG camera, which is
the lens' entrance pupil; the distance that lenses are focused by, from the sensor.
Between them lies the pupil's offset, which may itself change with focus.
"""

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lensfit.lens import Lens

_ROUNDS = 4


def from_sensor_mm(
    depth_mm: float, lens_focused_at: Callable[[float | None], "Lens"]
) -> float:
    """Focus distance from the sensor of what is `depth_mm` from the entrance pupil.

    Parameters
    ----------
    lens_focused_at : The lens at a focus distance.
    """
    if math.isinf(depth_mm):
        return depth_mm
    focus_mm = depth_mm
    for _ in range(_ROUNDS):
        lens = lens_focused_at(focus_mm)
        closer = depth_mm + float(lens.entrance_pupil_offset_mm)
        if abs(closer - focus_mm) < 1e-6:
            break
        focus_mm = closer
    return float(f"{focus_mm:.7g}")
