"""First-order data of a lens, in the x or the y section.

The linear limit of the ray tracer: height y and slope u, u' n' = u n - c (n' - n) y at
a surface, y' = y + u' t between them. The two sections differ for cylinders only.
Positions are z in the tracer frame (towards the sensor positive, sensor at 0).
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from data_synth.surfaces import Surface
from data_synth.trace import vertex_positions_mm

Section = Literal["x", "y"]


@dataclass(frozen=True)
class FirstOrder:
    """Cardinal data of one section at one wavelength.

    Attributes
    ----------
    focal_length_mm : Effective focal length.
    back_focus_mm : From the last vertex to the rear focal point.
    entrance_pupil_z_mm, exit_pupil_z_mm : Positions of the stop's images.
    entrance_pupil_magnification, exit_pupil_magnification : Pupil over stop diameter.
    """

    focal_length_mm: float
    back_focus_mm: float
    entrance_pupil_z_mm: float
    exit_pupil_z_mm: float
    entrance_pupil_magnification: float
    exit_pupil_magnification: float


def first_order(
    surfaces: tuple[Surface, ...], wavelength_nm: float, section: Section = "y"
) -> FirstOrder:
    """First-order data of centred surfaces, the scene and the sensor in air."""
    stop = next(i for i, surface in enumerate(surfaces) if surface.is_stop)
    vertices_mm = vertex_positions_mm(surfaces)
    whole = _system_matrix(surfaces, wavelength_nm, section)
    front = _system_matrix(surfaces, wavelength_nm, section, 0, stop)
    rear = _system_matrix(surfaces, wavelength_nm, section, stop, len(surfaces))
    to_stop_mm = surfaces[stop - 1].thickness_mm if stop else 0.0
    entry = np.array([[1.0, to_stop_mm], [0.0, 1.0]]) @ front
    # The entrance pupil is where a ray through the stop's centre seems to cross the
    # axis in the scene: entry @ [y, u] has height 0.
    return FirstOrder(
        focal_length_mm=-1.0 / whole[1, 0],
        back_focus_mm=-whole[0, 0] / whole[1, 0],
        entrance_pupil_z_mm=vertices_mm[0] + entry[0, 1] / entry[0, 0],
        exit_pupil_z_mm=vertices_mm[-1] - rear[0, 1] / rear[1, 1],
        entrance_pupil_magnification=1.0 / entry[0, 0],
        exit_pupil_magnification=float(np.linalg.det(rear) / rear[1, 1]),
    )


def _system_matrix(
    surfaces: tuple[Surface, ...],
    wavelength_nm: float,
    section: Section,
    first: int = 0,
    end: int | None = None,
) -> Float[np.ndarray, "2 2"]:
    """Maps (height, slope) before surface `first` to those just after `end - 1`."""
    index = [1.0, *(s.glass.refractive_index(wavelength_nm) for s in surfaces)]
    matrix = np.eye(2)
    end = len(surfaces) if end is None else end
    for number in range(first, end):
        surface = surfaces[number]
        curvature = _vertex_curvature(surface, section)
        before, after = index[number], index[number + 1]
        power = curvature * (after - before) / after
        matrix = np.array([[1.0, 0.0], [-power, before / after]]) @ matrix
        if number < end - 1:
            matrix = np.array([[1.0, surface.thickness_mm], [0.0, 1.0]]) @ matrix
    return matrix


def _vertex_curvature(surface: Surface, section: Section) -> float:
    if section == "x":
        return surface.curvature_x_per_mm
    return surface.curvature_y_per_mm
