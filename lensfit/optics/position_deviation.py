"""Standard deviation of where chief rays land.

The parameters of a distortion have a covariance, which is propagated to first order to
the landing point of a chief ray. Part of that error is equivalent to another pose of
the camera, which is unknown as well and maps the undistorted image by a homography. For
each parameter, the combination of the eight small homographies that best compensates
its effect over the whole frame is subtracted first; the remainder is the error of the
lens.

Reference: the argument follows mrcal's documentation of projection uncertainty.
"""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lensfit.batches import in_batches
from lensfit.optics.distortion import Distortion, distorted_from_undistorted
from lensfit.optics.many_points import undistort

FRAME_GRID = (25, 17)
"""Columns and rows of points that stand for the whole frame."""
_BATCH = 1024


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
    left = by_number - pose @ undone
    variance = np.sum(left @ covariance * left, -1)
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
