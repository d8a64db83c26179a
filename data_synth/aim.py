"""Aiming rays from points of the scene: chief rays, and where the pupil is open.

A chief ray crosses the centre of the real stop; it is found by Newton's method on the
plane of the paraxial entrance pupil, walking outwards from the axis so that strongly
distorted pupils are followed. All positions of the scene are in the tracer frame.
"""

import numpy as np
from jaxtyping import Float

from data_synth.lens import SetLens, _ray_between
from data_synth.trace import Traced

AIM_STEPS = 8
DIFFERENCE_MM = 1e-4
SCAN_RADII = 1.5
"""Half-width of the area searched for open pupil, in paraxial pupil radii."""
WIDER, MOST_SCANS = 1.5, 6
"""How much more is searched, and how often, while light passes its border: from the
edge of 100 degrees the closed stop of a retrofocus lens looks three times as wide."""
BISECTIONS = 14
_AZIMUTHS = 128
"""At which the edge of an opening is found."""


def tracer_from_object(
    object_mm: Float[np.ndarray, "points 3"],
) -> Float[np.ndarray, "points 3"]:
    """Object space (z into the scene) to the tracer frame (z to the sensor)."""
    return object_mm * np.array([1.0, 1.0, -1.0])


def rays_through_pupil(
    lens: SetLens,
    points_mm: Float[np.ndarray, "rays 3"],
    pupil_mm: Float[np.ndarray, "rays 2"],
    wavelength_nm: float,
) -> tuple[Traced, Float[np.ndarray, "rays 3"]]:
    """Trace from scene points through points of the entrance-pupil plane.

    Returns the traced rays and their directions in the scene.
    """
    plane = np.full((len(pupil_mm), 1), lens.pupil_z_mm)
    start, direction = _ray_between(points_mm, np.hstack([pupil_mm, plane]))
    return lens.trace(start, direction, wavelength_nm), direction


def chief_aim_mm(
    lens: SetLens, points_mm: Float[np.ndarray, "points 3"], wavelength_nm: float
) -> Float[np.ndarray, "points 2"]:
    """Where the entrance-pupil plane must be crossed to pass the stop's centre.

    NaN where no such ray exists.
    """
    aim = np.zeros((len(points_mm), 2))
    for scale in (0.3, 0.6, 0.85, 1.0):
        scaled = points_mm * np.array([scale, scale, 1.0])
        aim = _newton_aim(lens, scaled, aim, wavelength_nm)
    return aim


def _newton_aim(lens, points_mm, aim, wavelength_nm):
    count = len(points_mm)
    shifts = DIFFERENCE_MM * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    repeated = np.tile(points_mm, (3, 1))
    for _ in range(AIM_STEPS):
        trial = np.concatenate([aim + shift for shift in shifts])
        traced, _ = rays_through_pupil(lens, repeated, trial, wavelength_nm)
        stop = traced.stop_mm.reshape(3, count, 2)
        jacobian = np.stack([stop[1] - stop[0], stop[2] - stop[0]], -1) / DIFFERENCE_MM
        step = _solve(jacobian, stop[0])
        aim = aim - step
        if np.nanmax(np.abs(step), initial=0.0) < 1e-9:
            break
    return aim


def _solve(matrices, vectors):
    """Solutions of many 2 x 2 systems; NaN where singular."""
    (a, b), (c, d) = matrices[:, 0].T, matrices[:, 1].T
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / (a * d - b * c)
    x, y = vectors.T
    return np.stack([(d * x - b * y) * inverse, (a * y - c * x) * inverse], -1)


def chief_rays(
    lens: SetLens, points_mm: Float[np.ndarray, "points 3"], wavelength_nm: float
) -> tuple[Float[np.ndarray, "points 2"], Float[np.ndarray, "points 2"]]:
    """Where chief rays of scene points cross the entrance-pupil plane (`chief_aim_mm`),
    and where they land on the sensor (`chief_landings_mm`)."""
    aim = chief_aim_mm(lens, points_mm, wavelength_nm)
    traced, _ = rays_through_pupil(lens, points_mm, aim, wavelength_nm)
    return aim, -traced.landing_mm


def chief_landings_mm(
    lens: SetLens, points_mm: Float[np.ndarray, "points 3"], wavelength_nm: float
) -> Float[np.ndarray, "points 2"]:
    """Sensor positions (upright, x right, y down) of the chief rays of scene points."""
    return chief_rays(lens, points_mm, wavelength_nm)[1]


def pupil_bounds_mm(
    lens: SetLens,
    points_mm: Float[np.ndarray, "points 3"],
    wavelength_nm: float,
    cells: int = 24,
) -> tuple[Float[np.ndarray, "points 2"], Float[np.ndarray, "points 2"]]:
    """Box of the entrance-pupil plane that holds all light of each scene point.

    It is that of the scanned rays that pass, one cell wider. Points none of whose rays
    pass get an empty box.

    Returns
    -------
    lower, upper : Corners of the box, mm in the entrance-pupil plane.
    """
    candidates, passed, reach_mm = _scan(lens, points_mm, wavelength_nm, cells)
    cell_mm = 2 * reach_mm[:, None] / cells
    lower = np.where(passed, candidates, np.inf).min(axis=1) - cell_mm
    upper = np.where(passed, candidates, -np.inf).max(axis=1) + cell_mm
    dark = ~passed.any(axis=1)
    return np.where(dark, 0.0, lower), np.where(dark, 0.0, upper)


def pupil_outline_mm(
    lens: SetLens,
    points_mm: Float[np.ndarray, "points 3"],
    wavelength_nm: float,
) -> tuple[Float[np.ndarray, "points 2"], Float[np.ndarray, "points azimuths"]]:
    """Edge of the opening that each scene point sees, in the entrance-pupil plane.

    The opening is an intersection of nearly round apertures and so is convex: along
    each azimuth from its middle the edge is found by bisection.

    Returns
    -------
    centre : A point inside the opening; NaN where no light passes.
    radius : Distance of the edge from it at azimuths 2 pi k / n, k = 0 ... n - 1.
    """
    candidates, passed, reach_mm = _scan(lens, points_mm, wavelength_nm, 24)
    with np.errstate(invalid="ignore"):
        centre = (candidates * passed).sum(axis=1) / passed.sum(axis=1)
    azimuth = 2 * np.pi * np.arange(_AZIMUTHS) / _AZIMUTHS
    outward = np.stack([np.cos(azimuth), np.sin(azimuth)], -1)
    sources = np.repeat(points_mm, _AZIMUTHS, axis=0)

    def clearance(radius):
        pupil = centre[:, None] + radius[..., None] * outward
        traced, _ = rays_through_pupil(
            lens, sources, pupil.reshape(-1, 2), wavelength_nm
        )
        return traced.clearance.reshape(radius.shape)

    inner = np.zeros((len(points_mm), _AZIMUTHS))
    outer = np.zeros_like(inner) + 2 * np.sqrt(2) * reach_mm[:, None]
    within, beyond = clearance(inner), np.full_like(inner, -np.inf)
    for _ in range(BISECTIONS):
        middle = (inner + outer) / 2
        here = clearance(middle)
        is_open = here >= 0
        inner, within = np.where(is_open, (middle, here), (inner, within))
        outer, beyond = np.where(is_open, (outer, beyond), (middle, here))
    with np.errstate(invalid="ignore"):
        part = np.where(np.isfinite(beyond), within / (within - beyond), 0.5)
    return centre, inner + part * (outer - inner)


def _scan(lens: SetLens, points_mm, wavelength_nm: float, cells: int):
    """Which rays pass of a grid around the chief ray, half again the paraxial pupil or
    as wide as the light of the point is.

    Returns pupil points (points, rays, 2), booleans (points, rays, 1), and half the
    side of each point's grid, mm.
    """
    centre = chief_aim_mm(lens, points_mm, wavelength_nm)
    centre = np.where(np.isfinite(centre), centre, 0.0)
    axis = (np.arange(cells) + 0.5) / cells * 2 - 1
    grid = np.stack(np.meshgrid(axis, axis), -1).reshape(-1, 2)
    border = np.abs(grid).max(axis=1) > 1 - 1.5 / cells
    points = np.repeat(points_mm, len(grid), axis=0)
    reach_mm = np.full(len(points_mm), SCAN_RADII * lens.pupil_radius_mm)
    for scans_left in reversed(range(MOST_SCANS)):
        pupil = centre[:, None] + reach_mm[:, None, None] * grid
        through = pupil.reshape(-1, 2)
        traced, _ = rays_through_pupil(lens, points, through, wavelength_nm)
        passed = traced.passed.reshape(len(points_mm), len(grid))
        cut = passed[:, border].any(axis=1)
        if not (scans_left and cut.any()):
            break
        reach_mm = np.where(cut, WIDER * reach_mm, reach_mm)
    return pupil, passed[..., None], reach_mm
