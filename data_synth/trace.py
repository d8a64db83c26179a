"""Sequential ray tracing: from the scene through every surface to the sensor plane.

Snell's law in vector form, d' = mu d + (mu cos i - cos t) N with mu = n1/n2. A ray that
misses a surface or is totally reflected becomes NaN; a ray outside a clear aperture or
the stop is traced on but marked as blocked, so that rays can be aimed through apertures
they would not pass. Rays are traced in blocks, all surfaces for one block.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from data_synth.surfaces import Surface, Vector, intersect

RAYS_PER_BLOCK = 32768
"""Enough that Python's share is small, and a block, 2 MB, stays in the cache."""


@dataclass(frozen=True, eq=False)
class Stop:
    """The iris: a circle, or a polygon of the same area with straight or bowed blades.

    Attributes
    ----------
    radius_mm : Radius of the round iris that passes as much light.
    blades : Number of blades; 0 for a round iris.
    rotation_rad : Azimuth of one corner, from x towards y.
    roundness : 0 for straight blades, 1 for a circle.
    """

    radius_mm: float
    blades: int = 0
    rotation_rad: float = 0.0
    roundness: float = 0.0

    def edge_mm(self, azimuth_rad: Float[np.ndarray, " rays"]):
        """Distance of the iris' edge from its centre at an azimuth."""
        if self.blades < 3:
            return np.full_like(azimuth_rad, self.radius_mm)
        sector = 2 * np.pi / self.blades
        apothem = self.radius_mm * np.sqrt(sector / 2 / np.tan(sector / 2))
        within = (azimuth_rad - self.rotation_rad) % sector - sector / 2
        straight = apothem / np.cos(within)
        return straight + self.roundness * (self.radius_mm - straight)


@dataclass(frozen=True, eq=False)
class Traced:
    """Where rays ended.

    Attributes
    ----------
    landing_mm : Intersection with the sensor plane, tracer frame; NaN if lost.
    direction : Direction cosines of the ray as it lands.
    stop_mm : Where the ray crossed the plane of the stop.
    clearance : The least of (1 - distance/radius) over all apertures, the stop among
        them: negative when blocked.
    """

    landing_mm: Float[np.ndarray, "rays 2"]
    direction: Float[np.ndarray, "rays 3"]
    stop_mm: Float[np.ndarray, "rays 2"]
    clearance: Float[np.ndarray, " rays"]

    @property
    def passed(self) -> Bool[np.ndarray, " rays"]:
        return self.clearance >= 0.0


def trace(
    surfaces: tuple[Surface, ...],
    stop: Stop | None,
    origin_mm: Float[np.ndarray, "rays 3"],
    direction: Float[np.ndarray, "rays 3"],
    wavelength_nm: float,
) -> Traced:
    """Trace rays of one wavelength to the sensor plane z = 0.

    Parameters
    ----------
    surfaces : In order; the thickness of the last reaches the sensor.
    stop : The iris, in the vertex plane of the surface marked as the stop; None leaves
        only the clear apertures.
    origin_mm, direction : Tracer frame; directions of unit length with z > 0.
    wavelength_nm : In vacuum, nm.
    """
    index = [1.0, *(s.glass.refractive_index(wavelength_nm) for s in surfaces)]
    result = np.empty((len(origin_mm), 8))
    with np.errstate(invalid="ignore"):
        for start in range(0, len(origin_mm), RAYS_PER_BLOCK):
            block = slice(start, start + RAYS_PER_BLOCK)
            _trace_block(
                surfaces, stop, index, origin_mm[block], direction[block], result[block]
            )
    return Traced(result[:, 0:2], result[:, 2:5], result[:, 5:7], result[:, 7])


def vertex_positions_mm(
    surfaces: tuple[Surface, ...],
) -> Float[np.ndarray, " surfaces"]:
    """z of every vertex, tracer frame: negative, the sensor being at 0."""
    thicknesses = np.array([surface.thickness_mm for surface in surfaces])
    return -np.cumsum(thicknesses[::-1])[::-1]


def _trace_block(surfaces, stop, index, origin_mm, direction, out) -> None:
    vertices_mm = vertex_positions_mm(surfaces)
    position: Vector = tuple(origin_mm.T.copy())  # pyright: ignore[reportAssignmentType]
    heading: Vector = tuple(direction.T.copy())  # pyright: ignore[reportAssignmentType]
    position = (position[0], position[1], position[2] - vertices_mm[0])
    clearance = np.full(len(origin_mm), np.inf)
    for number, surface in enumerate(surfaces):
        position, heading, height = _cross(
            surface, position, heading, index[number] / index[number + 1]
        )
        if np.isfinite(surface.semi_diameter_mm):
            clearance = np.minimum(clearance, 1.0 - height / surface.semi_diameter_mm)
        if surface.is_stop:
            out[:, 5], out[:, 6] = _at_vertex_plane(position, heading)
            if stop is not None:
                clearance = np.minimum(clearance, _stop_clearance(stop, out[:, 5:7]))
        x, y, z = position
        position = (x, y, z - surface.thickness_mm)
    out[:, 0], out[:, 1] = _at_vertex_plane(position, heading)
    out[:, 2], out[:, 3], out[:, 4] = heading
    lost = ~np.isfinite(out[:, 0])
    out[:, 7] = np.where(lost, -np.inf, clearance)


def _cross(surface: Surface, position: Vector, heading: Vector, ratio: float):
    """Go to the surface and refract; also the ray's height over the surface's axis."""
    if surface.is_displaced:
        position, heading = _into_frame(surface, position, heading)
    position, normal = intersect(surface, position, heading)
    height = np.sqrt(position[0] ** 2 + position[1] ** 2)
    if ratio != 1.0:
        heading = _refract(heading, normal, ratio)
    if surface.is_displaced:
        position, heading = _out_of_frame(surface, position, heading)
    return position, heading, height


def _refract(heading: Vector, normal: Vector, ratio: float) -> Vector:
    cos_in = -(heading[0] * normal[0] + heading[1] * normal[1] + heading[2] * normal[2])
    cos_out = np.sqrt(1.0 - ratio * ratio * (1.0 - cos_in * cos_in))
    along = ratio * cos_in - cos_out
    return (
        ratio * heading[0] + along * normal[0],
        ratio * heading[1] + along * normal[1],
        ratio * heading[2] + along * normal[2],
    )


def _into_frame(surface: Surface, position: Vector, heading: Vector):
    shift = np.array([*surface.decentre_mm, 0.0])[:, None]
    axes = surface.rotation().T
    return (
        tuple(axes @ (np.stack(position) - shift)),
        tuple(axes @ np.stack(heading)),
    )


def _out_of_frame(surface: Surface, position: Vector, heading: Vector):
    shift = np.array([*surface.decentre_mm, 0.0])[:, None]
    axes = surface.rotation()
    return (
        tuple(axes @ np.stack(position) + shift),
        tuple(axes @ np.stack(heading)),
    )


def _at_vertex_plane(position: Vector, heading: Vector):
    distance = position[2] / heading[2]
    return position[0] - heading[0] * distance, position[1] - heading[1] * distance


def _stop_clearance(stop: Stop, stop_mm: Float[np.ndarray, "rays 2"]):
    radius = np.hypot(stop_mm[:, 0], stop_mm[:, 1])
    if stop.blades < 3:
        return 1.0 - radius / stop.radius_mm
    azimuth = np.arctan2(stop_mm[:, 1], stop_mm[:, 0])
    return 1.0 - radius / stop.edge_mm(azimuth)
