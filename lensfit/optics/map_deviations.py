"""Standard deviation of where chief rays land: on the chart's plane, and of any object.

The parameters of a distortion have a covariance, which is propagated to first order to
the landing point of a chief ray. Part of that error is equivalent to another pose of
the camera, which is unknown as well and maps the undistorted image by a homography. For
each parameter, the combination of the eight small homographies that best compensates
its effect over the whole frame is subtracted first; the remainder is the error of the
lens.

A chief-ray map that was measured on a chart holds at the chart's distance. At other
distances it depends on the position of the entrance pupil and its shift with field
angle, which a chart parallel to the sensor weakly determines. The standard deviation
therefore grows with the difference of the vergences of object and chart, seen from the
pupil. An affine map of the image is removed first, because shift and scale of a whole
plane of objects can be compensated by the camera's pose.

Reference: the argument follows mrcal's documentation of projection uncertainty.
"""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lensfit.batches import in_batches
from lensfit.optics.distortion import (
    Distortion,
    distorted_from_direction,
    distorted_from_undistorted,
)
from lensfit.optics.many_points import undistort
from lensfit.optics.projection import PupilShift, equivalent_chart_point

FRAME_GRID = (25, 17)
"""Columns and rows of points that stand for the whole frame."""
PERSPECTIVE_NUMBERS = 2
"""Entrance-pupil offset and its shift with field angle, mm; they follow the numbers of
`changed_distortion`."""
_BATCH = 1024


class MapCovariances(eqx.Module):
    """How well the numbers of a lens' maps are known; None where nobody knows.

    Attributes
    ----------
    distortion : Of the numbers of `changed_distortion`.
    perspective : Of those numbers, and of entrance-pupil offset and shift in mm.
    red, blue : Of the terms of `lensfit.optics.lateral.displacement_basis`.
    fall_off : Of the control values of each channel.
    """

    distortion: Float[np.ndarray, "numbers numbers"] | None = None
    perspective: Float[np.ndarray, "numbers numbers"] | None = None
    red: Float[np.ndarray, "terms terms"] | None = None
    blue: Float[np.ndarray, "terms terms"] | None = None
    fall_off: Float[np.ndarray, "3 terms terms"] | None = None


def frame_points_mm(
    distortion: Distortion, sensor_size_mm: tuple[float, float]
) -> Float[np.ndarray, "points 2"]:
    """Points of the undistorted picture that cover the frame, where it has them."""
    x, y = (
        np.linspace(-0.5, 0.5, count) * size
        for count, size in zip(FRAME_GRID, sensor_size_mm, strict=True)
    )
    seen = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
    points = in_batches(lambda p: undistort(p, distortion), seen, _BATCH)
    return points[np.isfinite(points).all(-1)]


def changed_distortion(
    distortion: Distortion, moves: Float[Array, " numbers"]
) -> Distortion:
    """The distortion with its parameters changed.

    Parameters
    ----------
    moves : Changes of the logarithm of the principal distance; of the principal point,
        in reference radii; of `radial`, `squeeze`, `named`, and `free` along x, then y.
    """
    ends = np.cumsum(_sizes(distortion))[:-1]
    scale, point, radial, squeeze, named, free = jnp.split(moves, ends)
    d = distortion
    return replace(
        d,
        principal_distance_mm=d.principal_distance_mm * jnp.exp(scale[0]),
        principal_point_mm=d.principal_point_mm + point * d.reference_radius_mm,
        radial=d.radial + radial,
        squeeze=d.squeeze + squeeze,
        named=d.named + named,
        free=d.free + free.reshape(d.free.shape),
    )


def numbers_in(distortion: Distortion) -> int:
    """How many numbers `changed_distortion` changes."""
    return sum(_sizes(distortion))


def gain_of_numbers(distortion: Distortion, gain: float) -> Float[np.ndarray, " n"]:
    """Factor of each number of `changed_distortion` when the distortion coefficients
    are multiplied by `gain`; projection and squeeze do not change."""
    return np.repeat([1.0, 1.0, gain, 1.0, gain, gain], _sizes(distortion))


def _sizes(distortion: Distortion) -> tuple[int, ...]:
    """How many numbers each part of `changed_distortion` has."""
    d = distortion
    return 1, 2, d.radial.size, 2, d.named.size, d.free.size


def position_deviations_mm(
    undistorted_mm: Float[np.ndarray, "points 2"],
    distortion: Distortion,
    covariance: Float[np.ndarray, "*errors numbers numbers"],
    frame_mm: Float[np.ndarray, "seen 2"],
) -> Float[np.ndarray, "*errors points 2"]:
    """Standard deviation, along x and y, of where points of the undistorted picture
    land.

    Parameters
    ----------
    covariance : Of the numbers of `changed_distortion`; of several errors at once.
    frame_mm : Points of the undistorted picture that cover the frame: it is over these
        that the moves a pose would undo are taken out.
    """
    place, by_number = _slopes(frame_mm, distortion)
    unit_mm = float(distortion.reference_radius_mm)
    pose = pose_moves(place, frame_mm, unit_mm)
    undone, *_ = np.linalg.lstsq(pose, by_number, rcond=1e-10)
    if undistorted_mm is not frame_mm:
        place, by_number = _slopes(undistorted_mm, distortion)
        pose = pose_moves(place, undistorted_mm, unit_mm)
    return _deviations(by_number - pose @ undone, covariance)


def _deviations(
    by_number: Float[np.ndarray, "coordinates numbers"],
    covariance: Float[np.ndarray, "*errors numbers numbers"],
) -> Float[np.ndarray, "*errors points 2"]:
    """Standard deviations of coordinates (x and y in turn) that move so with numbers of
    this covariance."""
    variance = np.sum(by_number @ covariance * by_number, -1)
    return np.sqrt(np.maximum(variance, 0.0)).reshape(*variance.shape[:-1], -1, 2)


def pose_moves(
    by_place: Float[np.ndarray, "points 2 2"],
    undistorted_mm: Float[np.ndarray, "points 2"],
    unit_mm: float,
) -> Float[np.ndarray, "coordinates 8"]:
    """How the distorted points (x and y in turn) move as the camera's pose changes.

    Parameters
    ----------
    by_place : d distorted / d undistorted.
    unit_mm : A length of the order of the frame, in which the eight moves count.
    """
    x, y = (undistorted_mm / unit_mm).T
    one, zero = np.ones_like(x), np.zeros_like(x)
    in_x = [one, zero, x, y, zero, zero, x * x, x * y]
    in_y = [zero, one, zero, zero, x, y, x * y, y * y]
    moves = np.stack([np.stack(in_x, -1), np.stack(in_y, -1)], 1)
    return np.einsum("pij,pjk->pik", by_place, moves).reshape(-1, 8)


def _slopes(
    points: Float[np.ndarray, "points 2"], distortion: Distortion
) -> tuple[Float[np.ndarray, "points 2 2"], Float[np.ndarray, "coordinates numbers"]]:
    """Derivatives of the distorted positions by undistorted position, and by the
    numbers of `changed_distortion`."""
    both = in_batches(lambda p: _slopes_of_batch(p, distortion), points, _BATCH)
    return both[..., :2], both[..., 2:].reshape(-1, both.shape[-1] - 2)


@eqx.filter_jit
def _slopes_of_batch(
    points: Float[Array, "points 2"], distortion: Distortion
) -> Float[Array, "points 2 place_and_numbers"]:
    def at(point: Array, moves: Array) -> Array:
        return distorted_from_undistorted(point, changed_distortion(distortion, moves))

    # In reverse: a position has two components, a lens two hundred numbers.
    slopes = jax.vmap(jax.jacrev(at, (0, 1)), (0, None))
    still = jnp.zeros(numbers_in(distortion))
    return jnp.concatenate(slopes(jnp.asarray(points), still), -1)


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
        landed, by_number = _object_slopes(frame, perspective)
        undone, *_ = np.linalg.lstsq(_affine(landed), by_number, rcond=1e-10)
        landed, by_number = _object_slopes(object_points_mm[mine], perspective)
        found[mine] = _deviations(by_number - _affine(landed) @ undone, covariance)
    return found


def _affine(landed_mm: Float[np.ndarray, "points 2"]) -> np.ndarray:
    """How coordinates (x and y in turn) move with the six numbers of an affine map."""
    base = np.column_stack([np.ones(len(landed_mm)), landed_mm])
    return np.einsum("pk,ij->pikj", base, np.eye(2)).reshape(-1, 6)


def _object_slopes(
    points: Float[np.ndarray, "points 3"], perspective: Perspective
) -> tuple[Float[np.ndarray, "points 2"], Float[np.ndarray, "coordinates numbers"]]:
    """Where points land, and how that moves with every number."""
    both = in_batches(lambda p: _object_slopes_of_batch(p, perspective), points, _BATCH)
    return both[..., 0], both[..., 1:].reshape(-1, both.shape[-1] - 1)


@eqx.filter_jit
def _object_slopes_of_batch(
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
