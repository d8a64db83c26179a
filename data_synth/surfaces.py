"""One refracting surface: its shape, where a ray meets it, and its normal there.

Shapes: sphere, conic, even asphere (sag = conic + a4 r^4 + a6 r^6 + ...), and toric:
the curve of curvature c_y in the y-z plane, swept about an axis parallel to y at
distance 1/c_x (a cylinder when one curvature is zero). Curvature is positive when its
centre lies on the sensor's side. Rays are arrays of components, in the frame of the
surface's vertex; a ray that misses becomes NaN and stays so.
"""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from data_synth.glass import AIR, Glass

Component = Float[np.ndarray, " rays"]
Vector = tuple[Component, Component, Component]

NEWTON_STEPS = 12
NEWTON_TOLERANCE_MM = 1e-13


@dataclass(frozen=True)
class Surface:
    """A surface and what follows it.

    Attributes
    ----------
    curvature_x_per_mm, curvature_y_per_mm : Vertex curvatures; equal unless toric.
    conic : Conic constant (0 sphere, -1 paraboloid); rotationally symmetric only.
    even_coefficients : a4, a6, ... of the asphere, mm^-3, mm^-5, ...
    semi_diameter_mm : Radius of the clear aperture; infinity when it clips nothing.
    thickness_mm : Distance to the next vertex (the last: to the sensor).
    glass : The medium after the surface.
    is_stop : The aperture stop lies in this surface's vertex plane.
    decentre_mm, tilt_rad : Shift of the vertex in x, y, and rotation about x, then y.
    """

    curvature_x_per_mm: float
    curvature_y_per_mm: float
    thickness_mm: float
    semi_diameter_mm: float = float("inf")
    glass: Glass = field(default=AIR)
    conic: float = 0.0
    even_coefficients: tuple[float, ...] = ()
    is_stop: bool = False
    decentre_mm: tuple[float, float] = (0.0, 0.0)
    tilt_rad: tuple[float, float] = (0.0, 0.0)

    @property
    def is_toric(self) -> bool:
        return self.curvature_x_per_mm != self.curvature_y_per_mm

    @property
    def is_displaced(self) -> bool:
        return any(self.decentre_mm) or any(self.tilt_rad)

    def rotation(self) -> Float[np.ndarray, "3 3"]:
        """Columns are the surface's axes in the lens frame."""
        (cos_x, cos_y), (sin_x, sin_y) = np.cos(self.tilt_rad), np.sin(self.tilt_rad)
        about_x = np.array([[1, 0, 0], [0, cos_x, -sin_x], [0, sin_x, cos_x]])
        about_y = np.array([[cos_y, 0, sin_y], [0, 1, 0], [-sin_y, 0, cos_y]])
        return about_y @ about_x


def intersect(
    surface: Surface, position: Vector, direction: Vector
) -> tuple[Vector, Vector]:
    """Where rays meet the surface, and its unit normals there (towards the scene)."""
    if surface.is_toric:
        return _newton(surface, position, direction, _toric_sag)
    if surface.even_coefficients:
        return _newton(surface, position, direction, _asphere_sag)
    return _intersect_conic(surface, position, direction)


def _intersect_conic(
    surface: Surface, position: Vector, direction: Vector
) -> tuple[Vector, Vector]:
    """Closed form: c (x^2 + y^2 + (1 + k) z^2) = 2 z, the root near the vertex."""
    curvature, conic = surface.curvature_x_per_mm, surface.conic
    l, m, n = direction  # noqa: E741 (direction cosines)
    advance = -position[2] / n
    x, y = position[0] + l * advance, position[1] + m * advance
    if curvature == 0.0:
        zero = np.zeros_like(x)
        return (x, y, zero), (zero, zero, zero - 1.0)
    constant = curvature * (x * x + y * y)
    half_linear = n - curvature * (x * l + y * m)
    quadratic = curvature * (1.0 + conic * n * n) if conic else curvature
    root = np.sqrt(half_linear * half_linear - quadratic * constant)
    distance = constant / (half_linear + root)
    x, y, z = x + l * distance, y + m * distance, n * distance
    normal = (curvature * x, curvature * y, curvature * (1.0 + conic) * z - 1.0)
    return (x, y, z), (_normalised(normal) if conic else normal)


def _newton(
    surface: Surface, position: Vector, direction: Vector, sag
) -> tuple[Vector, Vector]:
    """Solve z = sag(x, y) along the ray, from the vertex plane."""
    l, m, n = direction  # noqa: E741
    distance = -position[2] / n
    for _ in range(NEWTON_STEPS):
        x, y = position[0] + l * distance, position[1] + m * distance
        height, slope_x, slope_y = sag(surface, x, y)
        gap = position[2] + n * distance - height
        step = gap / (n - l * slope_x - m * slope_y)
        distance = distance - step
        if not np.nanmax(np.abs(step), initial=0.0) > NEWTON_TOLERANCE_MM:
            break
    x, y = position[0] + l * distance, position[1] + m * distance
    z = position[2] + n * distance
    _, slope_x, slope_y = sag(surface, x, y)
    return (x, y, z), _normalised((slope_x, slope_y, np.full_like(slope_x, -1.0)))


def _asphere_sag(surface: Surface, x: Component, y: Component) -> Vector:
    """Sag of the conic plus even terms, and its slopes."""
    curvature = surface.curvature_x_per_mm
    square = x * x + y * y
    root = np.sqrt(1.0 - (1.0 + surface.conic) * curvature**2 * square)
    height = curvature * square / (1.0 + root)
    slope_over_radius = curvature / root
    power = square
    for order, coefficient in enumerate(surface.even_coefficients, start=2):
        slope_over_radius = slope_over_radius + 2 * order * coefficient * power
        power = power * square
        height = height + coefficient * power
    return height, slope_over_radius * x, slope_over_radius * y


def _toric_sag(surface: Surface, x: Component, y: Component) -> Vector:
    """Sag of the swept curve and its slopes."""
    curvature_x, curvature_y = surface.curvature_x_per_mm, surface.curvature_y_per_mm
    root_y = np.sqrt(1.0 - (curvature_y * y) ** 2)
    profile = curvature_y * y * y / (1.0 + root_y)
    profile_slope = curvature_y * y / root_y
    reach = 1.0 - curvature_x * profile
    root = np.sqrt(reach * reach - (curvature_x * x) ** 2)
    height = profile + curvature_x * x * x / (reach + root)
    return height, curvature_x * x / root, profile_slope * reach / root


def _normalised(vector: Vector) -> Vector:
    x, y, z = vector
    inverse = 1.0 / np.sqrt(x * x + y * y + z * z)
    return x * inverse, y * inverse, z * inverse
