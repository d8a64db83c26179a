"""Where places of a chart's board land on the sensor, and how its image is scaled,
turned and bent around them.

The geometry of a photograph gives all of this: the pose of its board, the entrance
pupil and distortion. It maps from the board, in half boards as in `fitting.view_stack`,
to the sensor, in mm right and down.
"""

from collections.abc import Callable

import equinox as eqx
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


class SeenBoard(eqx.Module):
    """The board of one photograph and the geometry that it is seen through. It holds
    nothing of other photographs: one program serves shoots of any number of them.

    Attributes
    ----------
    shared, local : Parameters of the geometry.
    depth_factor : On depths (`_depth_factor`).
    view, frame, layout : As of the adjustment.
    """

    shared: Float[Array, " shared"]
    local: Float[Array, " local"]
    depth_factor: Float[Array, ""]
    view: BoardPose
    frame: Frame
    layout: GeometryLayout = eqx.field(static=True)

    @property
    def half_board_mm(self) -> Float[np.ndarray, "2"]:
        """The unit of places along both axes."""
        return np.asarray(self.view.half_board_mm)


def seen_board_of(photograph: DotPhotograph) -> SeenBoard:
    """The board of a photograph, as its geometry was fitted."""
    adjustment, index = photograph.geometry.adjustment, photograph.index
    layout, numbers = adjustment.layout, np.asarray(adjustment.parameters)
    of_all = jax.tree.map(np.asarray, adjustment.stack.view)
    return SeenBoard(
        jnp.asarray(numbers[: layout.shared]),
        jnp.asarray(numbers[layout.shared :].reshape(-1, layout.local)[index]),
        jnp.asarray(_depth_factor(photograph)),
        jax.tree.map(lambda a: jnp.asarray(a[index]), of_all),
        adjustment.frame,
        layout,
    )


def object_shifts_and_jacobians(
    places: Float[np.ndarray, "dots 2"],
    board: SeenBoard,
    first_order: FirstOrder,
    reference_mm: float,
    depth_scale: float,
) -> tuple[ObjectShift, Float[np.ndarray, "dots 2 2"]]:
    """Shifts of places from the reference depth, and d sensor mm / d board mm there.

    Parameters
    ----------
    first_order : The thin lens with these chief rays.
    reference_mm : Distance from the sensor at which the aberrations hold.
    depth_scale : Factor on the depths of the geometry.
    """
    known = board, first_order, jnp.asarray(reference_mm), jnp.asarray(depth_scale)
    return in_batches(
        lambda some: _object_shift_and_jacobian(jnp.asarray(some), *known),
        places,
        _BATCH,
    )


def landing_bends_mm(
    places: Float[np.ndarray, "dots 2"],
    board: SeenBoard,
    unit_mm: Float[np.ndarray, "dots 2"],
) -> Float[np.ndarray, "dots 2 2 2"]:
    """Second derivatives of where places land, by units of so many mm along both axes
    of the board; the sensor's axis comes first."""
    per_half = in_batches(
        lambda some: _landing_bends(jnp.asarray(some), board), places, _BATCH
    )
    units = unit_mm / board.half_board_mm
    return per_half * units[:, None, :, None] * units[:, None, None]


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


@jax.jit
def _object_shift_and_jacobian(
    places: Array,
    board: SeenBoard,
    first_order: FirstOrder,
    reference_mm: Array,
    depth_scale: Array,
) -> tuple[ObjectShift, Array]:
    """`object_shifts_and_jacobians` of some places."""
    direction_to, landed = _directions_and_landings(board)
    half_mm = board.view.half_board_mm

    def slope_of(place):
        return _slope(direction_to(place))

    def one(place):
        slope = slope_of(place)
        per_slope = jax.jacfwd(landed)(slope)
        per_board = per_slope @ jax.jacfwd(slope_of)(place) / half_mm[None]
        depth_mm = depth_scale * direction_to(place)[2]
        distance_mm = depth_mm + first_order.entrance_pupil_offset_mm
        shift = object_shift(slope, per_slope, first_order, reference_mm, distance_mm)
        return shift, per_board

    return jax.vmap(one)(places)


@jax.jit
def _landing_bends(places: Array, board: SeenBoard) -> Array:
    """`landing_bends_mm` by half boards."""
    direction_to, landed = _directions_and_landings(board)
    return jax.vmap(jax.hessian(lambda place: landed(_slope(direction_to(place)))))(
        places
    )


def _slope(direction: Float[Array, "3"]) -> Float[Array, "2"]:
    """Its lateral parts over depth."""
    return direction[:2] / direction[2]


def _directions_and_landings(
    board: SeenBoard,
) -> tuple[Callable[[Array], Array], Callable[[Array], Array]]:
    """The direction from the entrance pupil to a place, and where a slope lands."""
    parts = parts_of(board.shared, board.local, board.layout)
    lens = lens_of(parts, board.layout, board.frame)

    def direction_to(place):
        point = board_point_mm(place, parts, board.view, board.layout)
        direction = direction_of(point, parts, board.view, board.frame)
        return direction.at[2].multiply(board.depth_factor)

    def landed(slope):
        return distorted_from_direction(jnp.append(slope, 1.0), lens)

    return direction_to, landed
