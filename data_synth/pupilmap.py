"""The opening of a lens as a map: where the ray through each pupil point lands.

A square grid over the entrance pupil is traced exactly from every scene point; between
its rays all that a ray carries is smooth and is interpolated by cubics (local, four
points), so that a spot is drawn from many more rays than were traced. The rims of the
lens and of the iris are found on the interpolated clearance, cells on the rim counting
as far as they are open. A test compares spots with those of brute force.

Rims of the glass are kept apart from the iris: one traced map serves every f-number
that is not wider than the lens it was traced through.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from data_synth.aim import pupil_bounds_mm
from data_synth.irradiance import ray_weights
from data_synth.lens import SetLens, _ray_between
from data_synth.trace import Stop, _stop_clearance, trace

REFERENCE_NM = 540.0
LEAST_WIDTH = 1e-6


@dataclass(frozen=True, eq=False)
class PupilMap:
    """Traced rays from scene points through a grid of the entrance-pupil plane.

    Attributes
    ----------
    fields : Per point and ray: landing x and y (mm, upright), stop x and y (mm),
        clearance of the rims without the iris, and cos cos / s^2.
    lost : Rays that never reached the sensor; the other fields are zero there.
    cell_area_mm2 : Of a grid cell in the entrance-pupil plane.
    """

    fields: Float[np.ndarray, "points 6 cells cells"]
    lost: Float[np.ndarray, "points cells cells"]
    cell_area_mm2: Float[np.ndarray, " points"]

    def of_point(self, number: int) -> "PupilMap":
        """The map of one of the points."""
        one = slice(number, number + 1)
        return PupilMap(self.fields[one], self.lost[one], self.cell_area_mm2[one])

    def extent_mm(self, stop: Stop) -> Float[np.ndarray, "points 2 2"]:
        """Lower and upper corner of the box that all light of each point lands in."""
        landing = self.fields[:, :2]
        is_open = self._clearance(self.fields, stop)[:, None] >= -0.02
        is_open &= (self.lost == 0)[:, None]
        low = np.where(is_open, landing, np.inf).min(axis=(2, 3))
        high = np.where(is_open, landing, -np.inf).max(axis=(2, 3))
        return np.stack([low, high], 1)

    @staticmethod
    def _clearance(fields, stop: Stop):
        shape = fields[:, 4].shape
        at_stop = np.stack([fields[:, 2].ravel(), fields[:, 3].ravel()], -1)
        return np.minimum(fields[:, 4], _stop_clearance(stop, at_stop).reshape(shape))

    def refined(self, stop: Stop, across: int) -> "FineRays":
        """Interpolated rays through one iris, `across` to the side of the traced box.

        Only the part of the box is interpolated that the iris leaves open for some
        point.
        """
        cells = self.fields.shape[-1]
        rows, columns = self._open_part(stop, across)
        matrix = interpolation(cells, across)
        down, right = matrix[rows], matrix[columns]
        fields = down @ self.fields @ right.T
        clearance = self._clearance(fields, stop)
        steep = np.hypot(*np.gradient(clearance, axis=(1, 2)))
        cover = np.clip(0.5 + clearance / np.maximum(steep, 1e-12), 0.0, 1.0)
        if self.lost.any():
            cover[np.abs(down) @ self.lost @ np.abs(right).T > 0] = 0.0
        widths = [np.hypot(*np.gradient(fields[:, k], axis=(1, 2))) for k in (0, 1)]
        flux = (
            fields[:, 5]
            * cover
            * (self.cell_area_mm2 * (cells / across) ** 2)[:, None, None]
        )
        return FineRays(fields[:, :2], np.stack(widths, 1), flux)

    def _open_part(self, stop: Stop, across: int) -> tuple[slice, slice]:
        """Rows and columns of fine cells that may be open, two coarse cells more."""
        cells = self.fields.shape[-1]
        is_open = np.any(self._clearance(self.fields, stop) >= 0, axis=0)
        parts = []
        for axis in (1, 0):
            lit = np.flatnonzero(np.any(is_open, axis=axis))
            if not len(lit):
                return slice(0, 2), slice(0, 2)
            first, last = (lit[0] - 2) / cells, (lit[-1] + 3) / cells
            first, last = max(int(first * across), 0), min(int(last * across), across)
            parts.append(slice(first, max(last, first + 2)))
        return parts[0], parts[1]


@dataclass(frozen=True, eq=False)
class FineRays:
    """Interpolated rays: landing (mm), size of each ray's cell on the sensor, flux."""

    landing_mm: Float[np.ndarray, "points 2 rows columns"]
    width_mm: Float[np.ndarray, "points 2 rows columns"]
    flux: Float[np.ndarray, "points rows columns"]


def pupil_map(
    lens: SetLens,
    points_mm: Float[np.ndarray, "points 3"],
    normals: Float[np.ndarray, "points 3"],
    bounds_mm: tuple[Float[np.ndarray, "points 2"], Float[np.ndarray, "points 2"]],
    wavelength_nm: float,
    cells: int,
) -> PupilMap:
    """Trace a grid of `cells` x `cells` rays from each scene point (tracer frame).

    Parameters
    ----------
    normals : Of the radiating surface at the points, tracer frame.
    bounds_mm : Boxes of the entrance-pupil plane, as `pupil_bounds_mm` finds them.
    """
    lower, upper = bounds_mm
    steps = (np.arange(cells) + 0.5) / cells
    grid = np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2)
    pupil = lower[:, None] + (upper - lower)[:, None] * grid
    pupil = pupil.reshape(-1, 2)
    points = np.repeat(points_mm, len(grid), axis=0)
    plane = np.full((len(pupil), 1), lens.pupil_z_mm)
    start, direction = _ray_between(points, np.hstack([pupil, plane]))
    traced = trace(lens.surfaces, None, start, direction, wavelength_nm)
    weight = ray_weights(lens, points, np.repeat(normals, len(grid), axis=0), direction)
    columns = [-traced.landing_mm, traced.stop_mm, traced.clearance, weight]
    table = np.column_stack(columns)
    lost = ~np.isfinite(table).all(axis=1)
    table[lost] = (0.0, 0.0, 0.0, 0.0, -1.0, 0.0)
    table = table.reshape(len(points_mm), cells, cells, 6)
    return PupilMap(
        np.ascontiguousarray(np.moveaxis(table, -1, 1)),
        lost.reshape(len(points_mm), cells, cells).astype(float),
        np.prod(upper - lower, axis=1) / cells**2,
    )


def open_bounds_mm(lens: SetLens, points_mm: Float[np.ndarray, "points 3"]):
    """Boxes that hold the light of each point at every visible wavelength."""
    return pupil_bounds_mm(lens, points_mm, REFERENCE_NM)


def interpolation(cells: int, across: int) -> Float[np.ndarray, "across cells"]:
    """Cubic Lagrange weights from cell centres to the centres of finer cells."""
    place = (np.arange(across) + 0.5) * cells / across - 0.5
    first = np.clip(np.floor(place).astype(int) - 1, 0, cells - 4)
    offset = place - first
    matrix = np.zeros((across, cells))
    for node in range(4):
        others = [k for k in range(4) if k != node]
        value = np.prod([(offset - k) / (node - k) for k in others], axis=0)
        matrix[np.arange(across), first + node] = value
    return matrix


def deposit(
    position: Float[np.ndarray, "rays 2"],
    width: Float[np.ndarray, "rays 2"],
    flux: Float[np.ndarray, " rays"],
    patch: np.ndarray,
    shape: tuple[int, int, int],
) -> Float[np.ndarray, "patches rows columns"]:
    """Spread each ray evenly over a box and add it to a stack of patches.

    Parameters
    ----------
    position, width : Column and row, in pixels of the patch. Boxes are at most one
        pixel wide; wider ones are narrowed. What falls outside is dropped.
    patch : Which patch each ray belongs to.
    """
    count, rows, columns = shape
    width = np.clip(width, LEAST_WIDTH, 1.0)
    first = np.floor(position - width / 2)
    share = np.clip((position + width / 2 - first - 1) / width, 0.0, 1.0)
    first = first.astype(np.int64)
    inside = ((first >= 0) & (first < np.array([columns, rows]) - 1)).all(axis=-1)
    first, share, flux, patch = (
        first[inside],
        share[inside],
        flux[inside],
        patch[inside],
    )
    flat = (patch * rows + first[:, 1]) * columns + first[:, 0]
    out = np.zeros(count * rows * columns)
    down = flux * share[:, 1]
    for step, part in ((0, flux - down), (columns, down)):
        right = part * share[:, 0]
        out += np.bincount(flat + step, part - right, minlength=out.size)
        out += np.bincount(flat + step + 1, right, minlength=out.size)
    return out.reshape(shape)
