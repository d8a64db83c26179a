"""The lens traced from the sensor into the scene.

Light takes the same path both ways, so the surfaces are put in reverse order, each with
its curvature negated and the medium that came before it; decentrings stay, tilts change
sign. Mirrored frame: z towards the scene, the paraxial entrance-pupil plane at z = 0,
the sensor at the entrance pupil's z of the tracer frame; x and y as in the tracer
frame, where a picture is upside down.
"""

import dataclasses
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from data_synth.glass import AIR
from data_synth.lens import REFERENCE_NM, SetLens
from data_synth.paraxial import Section, first_order
from data_synth.scene.layers import SceneRays
from data_synth.surfaces import Surface
from data_synth.trace import trace, vertex_positions_mm

SCAN_RADII = 2.0
"""Half-width of the slopes searched for light, in those of the paraxial exit pupil."""
SCAN_CELLS = 48
NODES = (17, 13)
SECTIONS: tuple[Section, Section] = ("x", "y")


@dataclass(frozen=True, eq=False)
class BackwardLens:
    """A set lens, to be traced from the sensor.

    Attributes
    ----------
    surfaces : Reversed.
    exit_pupil_mm : From the sensor to the paraxial exit pupil, towards the scene, in
        the x and the y section.
    slope_radius : Slope between the axis and the rim of the exit pupil, in each.
    """

    lens: SetLens
    surfaces: tuple[Surface, ...]
    exit_pupil_mm: Float[np.ndarray, "2"]
    slope_radius: Float[np.ndarray, "2"]

    def middle_slope(
        self, sensor_mm: Float[np.ndarray, "points 2"]
    ) -> Float[np.ndarray, "points 2"]:
        """Slopes from upright sensor positions to the middle of the exit pupil."""
        return sensor_mm / self.exit_pupil_mm

    def rays_into_scene(
        self,
        sensor_mm: Float[np.ndarray, "rays 2"],
        slope: Float[np.ndarray, "rays 2"],
        wavelength_nm: float,
    ) -> tuple[SceneRays, Float[np.ndarray, " rays"]]:
        """Trace from upright sensor positions; slopes dx/dz, dy/dz, mirrored frame.

        Returns
        -------
        rays : On the scene's side, NaN where lost.
        clearance : As in `data_synth.trace`: negative where blocked.
        """
        start = np.full((len(sensor_mm), 3), self.lens.pupil_z_mm)
        start[:, :2] = -sensor_mm
        direction = np.ones((len(slope), 3))
        direction[:, :2] = slope
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        traced = trace(self.surfaces, self.lens.stop, start, direction, wavelength_nm)
        with np.errstate(invalid="ignore"):
            outward = traced.direction[:, :2] / traced.direction[:, 2:]
        return SceneRays(traced.landing_mm, outward), traced.clearance


def backward_lens(lens: SetLens) -> BackwardLens:
    """The lens, reversed."""
    surfaces = lens.surfaces
    front_mm = float(vertex_positions_mm(surfaces)[0])
    reversed_surfaces: list[Surface] = []
    for number in range(len(surfaces) - 1, -1, -1):
        surface = surfaces[number]
        before = surfaces[number - 1] if number else None
        to_next_mm = before.thickness_mm if before else front_mm - lens.pupil_z_mm
        if surface.is_stop and _is_no_plane_in_one_medium(surface, before):
            # The iris stands where rays leave this surface on their way to the sensor.
            iris = Surface(0.0, 0.0, 0.0, glass=surface.glass, is_stop=True)
            reversed_surfaces.append(iris)
            surface = dataclasses.replace(surface, is_stop=False)
        reversed_surfaces.append(
            dataclasses.replace(
                surface,
                curvature_x_per_mm=-surface.curvature_x_per_mm,
                curvature_y_per_mm=-surface.curvature_y_per_mm,
                even_coefficients=tuple(-a for a in surface.even_coefficients),
                thickness_mm=to_next_mm,
                glass=before.glass if before else AIR,
                tilt_rad=(-surface.tilt_rad[0], -surface.tilt_rad[1]),
            )
        )
    pupils = [first_order(surfaces, REFERENCE_NM, section) for section in SECTIONS]
    distance_mm = np.array([-pupil.exit_pupil_z_mm for pupil in pupils])
    magnification = np.array([pupil.exit_pupil_magnification for pupil in pupils])
    return BackwardLens(
        lens,
        tuple(reversed_surfaces),
        distance_mm,
        np.abs(lens.stop.radius_mm * magnification / distance_mm),
    )


def _is_no_plane_in_one_medium(surface: Surface, before: Surface | None) -> bool:
    flat = surface.curvature_x_per_mm == surface.curvature_y_per_mm == 0.0
    return not flat or surface.glass != (before.glass if before else AIR)


@dataclass(frozen=True, eq=False)
class Openings:
    """Boxes of slopes that hold all light of each cell of a grid over the sensor.

    Attributes
    ----------
    size_mm : Of the sensor.
    lower, upper : Corners of the boxes, less the slope to the exit pupil's middle;
        upper is below lower where no light arrives.
    """

    size_mm: tuple[float, float]
    lower: Float[np.ndarray, "rows columns 2"]
    upper: Float[np.ndarray, "rows columns 2"]

    def boxes(
        self, sensor_mm: Float[np.ndarray, "points 2"]
    ) -> tuple[Float[np.ndarray, "points 2"], Float[np.ndarray, "points 2"]]:
        """Lower corner and sides of the box of each position; no sides in the dark."""
        rows, columns = self.lower.shape[:2]
        part = sensor_mm / np.array(self.size_mm) + 0.5
        column, row = np.floor(part * np.array([columns, rows])).astype(int).T
        at = np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)
        sides = self.upper[at] - self.lower[at]
        lit = (sides > 0).all(axis=1, keepdims=True)
        return np.where(lit, self.lower[at], 0.0), np.where(lit, sides, 0.0)


def openings(backward: BackwardLens, size_mm: tuple[float, float]) -> Openings:
    """Where light comes from over the sensor, found by scanning at grid nodes.

    A cell's box holds those of its four corners, each one step of the scan wider.
    """
    x_mm, y_mm = (
        np.linspace(-0.5, 0.5, n) * size for n, size in zip(NODES, size_mm, strict=True)
    )
    nodes_mm = np.stack(np.meshgrid(x_mm, y_mm), -1).reshape(-1, 2)
    steps = ((np.arange(SCAN_CELLS) + 0.5) / SCAN_CELLS * 2 - 1) * SCAN_RADII
    offset = np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2)
    offset = offset * backward.slope_radius
    slope = backward.middle_slope(nodes_mm)[:, None] + offset
    _, clearance = backward.rays_into_scene(
        np.repeat(nodes_mm, len(offset), axis=0), slope.reshape(-1, 2), 540.0
    )
    passed = (clearance >= 0).reshape(len(nodes_mm), len(offset), 1)
    wider = 2 * SCAN_RADII / SCAN_CELLS * backward.slope_radius
    shape = (NODES[1], NODES[0], 2)
    lower = np.where(passed, offset, np.inf).min(axis=1).reshape(shape) - wider
    upper = np.where(passed, offset, -np.inf).max(axis=1).reshape(shape) + wider
    return Openings(
        size_mm, _of_corners(lower, np.minimum), _of_corners(upper, np.maximum)
    )


def _of_corners(nodes, extreme):
    """The extreme of the four nodes at the corners of each cell."""
    across = extreme(nodes[:, :-1], nodes[:, 1:])
    return extreme(across[:-1], across[1:])
