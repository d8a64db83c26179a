"""Where places of a chart's board land on the sensor, and how its image is scaled,
turned and bent around them.

The geometry of a photograph gives all of this: the pose of its board, the entrance
pupil and distortion. Places are in half boards, as in `fitting.view_stack`.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lensfit.batches import in_batches
from lensfit.fitting.adjust import fitted_depths_mm
from lensfit.fitting.geometry import (
    BoardPose,
    Frame,
    board_point_mm,
    direction_of,
    lens_of,
    parts_of,
)
from lensfit.fitting.parameters import Layout as GeometryLayout
from lensfit.fitting.wavefront.dot_patches import DotPhotograph
from lensfit.optics.depth import ObjectShift, object_shift
from lensfit.optics.distortion import distorted_from_direction
from lensfit.optics.paraxial import FirstOrder

_BATCH = 512


def object_shifts_and_jacobians(
    board: Float[np.ndarray, "dots 2"],
    photograph: DotPhotograph,
    first_order: FirstOrder,
    reference_mm: float,
    depth_scale: float = 1.0,
) -> tuple[ObjectShift, Float[np.ndarray, "dots 2 2"]]:
    """Shifts from the reference depth, and d sensor mm / d board mm, of places on the
    board of one photograph, half boards.

    Parameters
    ----------
    first_order : The thin lens with these chief rays.
    reference_mm : Distance from the sensor at which the aberrations hold.
    depth_scale : Factor on the depths of the geometry.
    """
    seen_by = _camera_of(photograph)
    return in_batches(
        lambda some: _object_shift_and_jacobian(
            jnp.asarray(some),
            *seen_by,
            photograph.geometry.adjustment.layout,
            first_order,
            jnp.asarray(reference_mm),
            jnp.asarray(depth_scale),
        ),
        board,
        _BATCH,
    )


def landing_bends_mm(
    board: Float[np.ndarray, "dots 2"],
    photograph: DotPhotograph,
    unit_mm: Float[np.ndarray, "dots 2"],
) -> Float[np.ndarray, "dots 2 2 2"]:
    """Second derivatives of where points of the board land, sensor mm, by units of so
    many mm along both axes of the board."""
    seen_by = _camera_of(photograph)
    layout = photograph.geometry.adjustment.layout
    per_half = in_batches(
        lambda some: _landing_bends(jnp.asarray(some), *seen_by, layout), board, _BATCH
    )
    half_mm = np.asarray(photograph.geometry.adjustment.stack.view.half_board_mm)
    units = unit_mm / half_mm[photograph.index]
    return per_half * units[:, None, :, None] * units[:, None, None]


class _Camera(NamedTuple):
    """What a photograph sees its board through, of this photograph alone: one program
    serves shoots of any number of them.

    Attributes
    ----------
    shared, local : Parameters of the geometry.
    factor : On depths (`_depth_factor`).
    view, frame : As of the adjustment.
    """

    shared: Float[Array, " shared"]
    local: Float[Array, " local"]
    factor: Float[Array, ""]
    view: BoardPose
    frame: Frame


def _camera_of(photograph: DotPhotograph) -> _Camera:
    adjustment, index = photograph.geometry.adjustment, photograph.index
    layout, numbers = adjustment.layout, np.asarray(adjustment.parameters)
    of_all = jax.tree.map(np.asarray, adjustment.stack.view)
    return _Camera(
        jnp.asarray(numbers[: layout.shared]),
        jnp.asarray(numbers[layout.shared :].reshape(-1, layout.local)[index]),
        jnp.asarray(_depth_factor(photograph)),
        jax.tree.map(lambda a: jnp.asarray(a[index]), of_all),
        adjustment.frame,
    )


def _depth_factor(photograph: DotPhotograph) -> float:
    """Correction factor of the geometry's depths.

    Blur moves centroids outward at some f-numbers (`aperture_shift`), which looks like
    a nearer board. The factor is the median ratio of measured distance to fitted depth
    over the takes of that state and f-number.
    """
    ratios = [
        (take.target_distance_mm - photograph.pupil_offset_mm) / depth_mm
        for take, depth_mm in zip(
            photograph.geometry.takes,
            fitted_depths_mm(photograph.geometry.adjustment),
            strict=True,
        )
        if take.target_distance_mm and take.f_number == photograph.take.f_number
    ]
    return float(np.median(ratios)) if ratios else 1.0


@partial(jax.jit, static_argnames=("layout",))
def _object_shift_and_jacobian(
    board: Array,
    shared: Array,
    local: Array,
    factor: Array,
    view: BoardPose,
    frame: Frame,
    layout: GeometryLayout,
    first_order: FirstOrder,
    reference_mm: Array,
    depth_scale: Array,
) -> tuple[ObjectShift, Array]:
    """Of each detected point: shift from the reference depth, and d sensor / d board
    mm."""
    camera = _Camera(shared, local, factor, view, frame)
    ahead, landed = _directions_and_landings(camera, layout)

    def slope_of(mark):
        return ahead(mark)[:2] / ahead(mark)[2]

    def one(mark):
        slope = slope_of(mark)
        per_slope = jax.jacfwd(landed)(slope)
        per_board = per_slope @ jax.jacfwd(slope_of)(mark) / view.half_board_mm[None]
        distance = depth_scale * ahead(mark)[2] + first_order.entrance_pupil_offset_mm
        shift = object_shift(slope, per_slope, first_order, reference_mm, distance)
        return shift, per_board

    return jax.vmap(one)(board)


@partial(jax.jit, static_argnames=("layout",))
def _landing_bends(
    board: Array,
    shared: Array,
    local: Array,
    factor: Array,
    view: BoardPose,
    frame: Frame,
    layout: GeometryLayout,
) -> Array:
    """d2 sensor mm / d board2 of each detected point, half boards."""
    camera = _Camera(shared, local, factor, view, frame)
    ahead, landed = _directions_and_landings(camera, layout)

    def landed_mark(mark):
        return landed(ahead(mark)[:2] / ahead(mark)[2])

    return jax.vmap(jax.hessian(landed_mark))(board)


def _directions_and_landings(
    camera: _Camera, layout: GeometryLayout
) -> tuple[Callable[[Array], Array], Callable[[Array], Array]]:
    """The direction that a mark of the board is seen in, and where a slope lands."""
    parts = parts_of(camera.shared, camera.local, layout)
    lens = lens_of(parts, layout, camera.frame)

    def ahead(mark):
        point = board_point_mm(mark, parts, camera.view, layout)
        direction = direction_of(point, parts, camera.view, camera.frame)
        return direction.at[2].multiply(camera.factor)

    def landed(slope):
        return distorted_from_direction(jnp.append(slope, 1.0), lens)

    return ahead, landed
