"""From a mark on the board to where it lands on the photograph.

    board (flat, or bent and stretched) -> pose -> distortion -> sensor mm

The entrance pupil is the centre of projection and the origin of camera axes (x right,
y down, z into the scene). A board point is (X, Y) in half boards from the middle of
what was seen of it. Poses are small rotations and shifts on top of a start value, so
that no orientation is singular.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from lensfit.fit.parameters import (
    APERTURE_SHIFT_TERMS,
    DRIFT_PARAMETERS,
    LOWEST_BEND_DEGREE,
    POSE_PARAMETERS,
    Layout,
    board_degrees,
)
from lensfit.optics.distortion import Distortion, distorted_from_direction


class Frame(NamedTuple):
    """Constants that give the dimensionless parameters their scale; never fitted."""

    stated_focal_length_mm: Float[Array, ""]
    reference_radius_mm: Float[Array, ""]
    stated_squeeze: Float[Array, "2"]
    valid_radius: Float[Array, ""]
    box: Float[Array, "2 2"]


class View(NamedTuple):
    """One photograph's start pose and its marks; stacked over views for the fit.

    `whole_board` is 1 where the photograph shows the board that `board_stretch`
    describes, from edge to edge, and 0 elsewhere.
    """

    rotation: Float[Array, "3 3"]
    translation_mm: Float[Array, "3"]
    aperture: Int[Array, ""]
    half_board_mm: Float[Array, "2"]
    whole_board: Float[Array, ""]
    board: Float[Array, "marks 2"]
    observed_mm: Float[Array, "marks 2"]
    whitening: Float[Array, "marks 2 2"]


def distortion_of(shared: Array, layout: Layout, frame: Frame) -> Distortion:
    """The lens that the shared parameters describe."""
    part = {name: shared[where] for name, where in layout.blocks.items()}
    named = jnp.concatenate(
        [part["decentering"], part["thin_prism"], part["anamorphic"]]
    )
    return Distortion(
        principal_distance_mm=frame.stated_focal_length_mm
        * jnp.exp(part["focal_length"][0]),
        principal_point_mm=part["principal_point"] * frame.reference_radius_mm,
        radial=part["radial"],
        valid_radius=frame.valid_radius,
        squeeze=frame.stated_squeeze + part["squeeze"],
        named=named,
        free=part["free_field"].reshape(2, -1),
        box=frame.box,
        reference_radius_mm=frame.reference_radius_mm,
        base=layout.base,
        degree=layout.free_degree,
    )


def board_point_mm(
    board: Float[Array, "2"], shared: Array, bend: Array, view: View, layout: Layout
) -> Float[Array, "3"]:
    """The mark in board axes, mm: nominal place, plus stretch and bend."""
    extent = jnp.max(view.half_board_mm)
    flat = board * view.half_board_mm
    z = jnp.zeros((), board.dtype)
    if layout.stretch_degree >= LOWEST_BEND_DEGREE:
        basis = _board_basis(board, layout.stretch_degree)
        moved = shared[layout.blocks["board_stretch"]].reshape(2, -1) @ basis
        flat = flat + moved * extent * view.whole_board
    if layout.bend_degree >= LOWEST_BEND_DEGREE:
        z = z + bend @ _board_basis(board, layout.bend_degree) * extent
    return jnp.concatenate([flat, z[None]])


def predicted_mm(
    board: Float[Array, "2"],
    shared: Array,
    local: Float[Array, " local"],
    view: View,
    layout: Layout,
    frame: Frame,
) -> Float[Array, "2"]:
    """Sensor mm where the mark's chief ray lands, moved by its aperture's shift."""
    bend = local[POSE_PARAMETERS + DRIFT_PARAMETERS :]
    point = board_point_mm(board, shared, bend, view, layout)
    turned = rotation_from_vector(local[:3]) @ (view.rotation @ point)
    shift = local[3:POSE_PARAMETERS] * view.translation_mm[2]
    direction = turned + view.translation_mm + shift
    landed = distorted_from_direction(direction, distortion_of(shared, layout, frame))
    # A rolling shutter reads rows one after the other: a camera that moves meanwhile
    # shifts each by an amount proportional to its height on the sensor.
    drift = local[POSE_PARAMETERS : POSE_PARAMETERS + DRIFT_PARAMETERS]
    landed = landed + drift * landed[1]
    if not layout.apertures:
        return landed
    return landed + _aperture_shift(landed, shared, view.aperture, layout, frame)


def whitened_residual(
    shared: Array, local: Array, view: View, layout: Layout, frame: Frame
) -> Float[Array, "marks 2"]:
    """(predicted - observed) in standard deviations, for every mark of one view."""
    predict = jax.vmap(predicted_mm, (0, None, None, None, None, None))
    difference = predict(view.board, shared, local, view, layout, frame)
    difference = difference - view.observed_mm
    return jnp.einsum("mij,mj->mi", view.whitening, difference)


def rotation_from_vector(rotation_rad: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """Rodrigues' formula, smooth at zero."""
    x, y, z = rotation_rad[0], rotation_rad[1], rotation_rad[2]
    zero = jnp.zeros_like(x)
    cross = jnp.stack(
        [
            jnp.stack([zero, -z, y]),
            jnp.stack([z, zero, -x]),
            jnp.stack([-y, x, zero]),
        ]
    )
    squared = jnp.sum(rotation_rad**2)
    small = squared < 1e-8
    angle = jnp.sqrt(jnp.where(small, 1.0, squared))
    first = jnp.where(small, 1 - squared / 6, jnp.sin(angle) / angle)
    half = jnp.sin(angle / 2) / angle
    second = jnp.where(small, 0.5 - squared / 24, 2 * half * half)
    return jnp.eye(3, dtype=cross.dtype) + first * cross + second * (cross @ cross)


def _aperture_shift(
    landed: Array, shared: Array, aperture: Array, layout: Layout, frame: Frame
) -> Array:
    """What a wider aperture adds to a centroid: radial, from coma and clipping.

    The chief ray belongs to the smallest aperture; at the others the blur is lopsided,
    to first order radially and oddly in the field.
    """
    distortion = distortion_of(shared, layout, frame)
    q = (landed - distortion.principal_point_mm) / frame.reference_radius_mm
    shifts = shared[layout.blocks["aperture_shift"]]
    shifts = shifts.reshape(layout.apertures, APERTURE_SHIFT_TERMS)
    mine = jnp.concatenate([jnp.zeros((1, APERTURE_SHIFT_TERMS)), shifts])[aperture]
    r2 = jnp.sum(q**2)
    radial = mine[0] + r2 * (mine[1] + r2 * mine[2])
    return q * radial * frame.reference_radius_mm


def _board_basis(board: Array, degree: int) -> Array:
    """Chebyshev products of degrees 2 and more; lower ones belong to the pose."""
    unit = jnp.clip(board, -1.2, 1.2)
    rows = [jnp.ones_like(unit), unit]
    for _ in range(2, degree + 1):
        rows.append(2 * unit * rows[-1] - rows[-2])
    chebyshev = jnp.stack(rows)
    pairs = board_degrees(degree)
    return chebyshev[pairs[:, 0], 0] * chebyshev[pairs[:, 1], 1]
