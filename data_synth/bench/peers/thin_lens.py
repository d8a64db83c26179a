"""The blur of a thin lens whose setting is only what was stated.

Both its pupils are the lens itself, and it is focused by moving it: `chart.camera` says
where it then stands, `optics.paraxial` how far light misses the sensor.
"""

import jax.numpy as jnp
import numpy as np

from lensfit.chart.camera import object_distance_mm
from lensfit.optics.paraxial import FirstOrder, defocus_mm, exit_pupil_distance_mm


def blur_radius_mm(
    focal_mm: float, f_number: float, focus_mm: float, object_mm: float
) -> float:
    """Of the disc of a point; negative for objects nearer than the focus.

    Parameters
    ----------
    focus_mm, object_mm : From the sensor; either may be infinite.

    Raises
    ------
    ChartError : Nothing is in focus at `focus_mm`.
    """
    to_sensor_mm = focal_mm
    if np.isfinite(focus_mm):
        to_sensor_mm = focus_mm - object_distance_mm(focal_mm, focus_mm)
    lens = FirstOrder(*map(jnp.asarray, (focal_mm, 1.0, to_sensor_mm)))
    focused, placed = jnp.asarray(focus_mm), jnp.asarray(object_mm)
    cone = focal_mm / (2 * f_number) / exit_pupil_distance_mm(lens, placed)
    return float(cone * defocus_mm(lens, focused, placed))
