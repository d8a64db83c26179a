"""Standard deviation of image positions of objects at other distances than the chart.

A chief-ray map that was measured on a chart holds at the chart's distance. At other
distances it depends on the position of the entrance pupil and its shift with field
angle, which a chart parallel to the sensor weakly determines. The standard deviation
therefore grows with the difference of the vergences of object and chart, seen from the
pupil.

An affine map of the image is removed first, because shift and scale of a whole plane of
objects can be compensated by the camera's pose.

Reference: as `lensfit.optics.position_deviation`.
"""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lensfit.batches import in_batches
from lensfit.optics.distortion import Distortion, distorted_from_direction
from lensfit.optics.position_deviation import changed_distortion, numbers_in
from lensfit.optics.pupil_shift import PupilShift, equivalent_chart_point

PERSPECTIVE_NUMBERS = 2
"""Entrance-pupil offset and its shift with field angle, mm; they follow the numbers of
`changed_distortion`."""
_BATCH = 1024


class Perspective(eqx.Module):
    """What makes chief rays of objects at any distance.

    Attributes
    ----------
    entrance_pupil_offset_mm : In front of the sensor.
    distortion : The chief-ray map at the chart's distance.
    pupil_shift : None for a pupil that stands still.
    """

    entrance_pupil_offset_mm: Float[Array, ""]
    distortion: Distortion
    pupil_shift: PupilShift | None


def object_deviations_mm(
    object_points_mm: Float[np.ndarray, "points 3"],
    perspective: Perspective,
    covariance: Float[np.ndarray, "numbers numbers"],
    frame_mm: Float[np.ndarray, "seen 2"],
) -> Float[np.ndarray, "points 2"]:
    """Standard deviation, along x and y, of where objects land.

    Parameters
    ----------
    object_points_mm : x right, y down, z from the sensor.
    covariance : Of the numbers of `changed_distortion`, then of pupil offset and shift.
    frame_mm : Points of the undistorted picture that cover the frame: over these, at
        each distance, the affine map is taken out.
    """
    found = np.full((len(object_points_mm), 2), np.nan)
    pupil_mm = float(perspective.entrance_pupil_offset_mm)
    c_mm = float(perspective.distortion.principal_distance_mm)
    centre_mm = np.asarray(perspective.distortion.principal_point_mm)
    for distance_mm in np.unique(object_points_mm[:, 2]):
        mine = object_points_mm[:, 2] == distance_mm
        across_mm = (frame_mm - centre_mm) / c_mm * (distance_mm - pupil_mm)
        frame = np.column_stack([across_mm, np.full(len(across_mm), distance_mm)])
        landed, by_number = _slopes(frame, perspective)
        undone, *_ = np.linalg.lstsq(_affine(landed), by_number, rcond=1e-10)
        landed, by_number = _slopes(object_points_mm[mine], perspective)
        left = by_number - _affine(landed) @ undone
        variance = np.einsum("cn,nm,cm->c", left, covariance, left)
        found[mine] = np.sqrt(np.maximum(variance, 0.0)).reshape(-1, 2)
    return found


def _affine(landed_mm: Float[np.ndarray, "points 2"]) -> np.ndarray:
    """How coordinates (x and y in turn) move with the six numbers of an affine map."""
    base = np.column_stack([np.ones(len(landed_mm)), landed_mm])
    return np.einsum("pk,ij->pikj", base, np.eye(2)).reshape(-1, 6)


def _slopes(
    points: Float[np.ndarray, "points 3"], perspective: Perspective
) -> tuple[Float[np.ndarray, "points 2"], Float[np.ndarray, "coordinates numbers"]]:
    """Where points land, and how that moves with every number."""
    both = in_batches(lambda p: _slopes_of_batch(p, perspective), points, _BATCH)
    return both[..., 0], both[..., 1:].reshape(-1, both.shape[-1] - 1)


@eqx.filter_jit
def _slopes_of_batch(
    points: Float[Array, "points 3"], perspective: Perspective
) -> Float[Array, "points 2 place_and_numbers"]:
    still = jnp.zeros(numbers_in(perspective.distortion) + PERSPECTIVE_NUMBERS)

    def one(point: Array) -> Array:
        def at(moves: Array) -> Array:
            return landed_mm(point, moved_perspective(perspective, moves))

        return jnp.column_stack([at(still), jax.jacrev(at)(still)])

    return jax.vmap(one)(jnp.asarray(points))


def landed_mm(
    point_mm: Float[Array, "3"], perspective: Perspective
) -> Float[Array, "2"]:
    """Where the chief ray of an object point lands."""
    ahead = point_mm.at[2].add(-perspective.entrance_pupil_offset_mm)
    direction = equivalent_chart_point(ahead, perspective.pupil_shift)
    return distorted_from_direction(direction, perspective.distortion)


def moved_perspective(
    perspective: Perspective, moves: Float[Array, " numbers"]
) -> Perspective:
    """The same with its numbers moved; the chart stays where it was."""
    offset_mm, shift_mm = moves[-2], moves[-1]
    pupil_shift = perspective.pupil_shift
    if pupil_shift is not None:
        pupil_shift = PupilShift(
            pupil_shift.shift_mm + shift_mm, pupil_shift.chart_distance_mm - offset_mm
        )
    return replace(
        perspective,
        entrance_pupil_offset_mm=perspective.entrance_pupil_offset_mm + offset_mm,
        distortion=changed_distortion(perspective.distortion, moves[:-2]),
        pupil_shift=pupil_shift,
    )
