"""From a point on the board to where it lands on the photograph.

    board (flat, or bent and stretched) -> pose -> distortion -> sensor mm

The entrance pupil is the centre of projection and the origin of camera axes (x right,
y down, z into the scene). A board point is (X, Y) in half boards from the middle of
what was seen of it. Poses are small rotations and shifts on top of a start value, so
that no orientation is singular.

Behind cylinders the entrance pupil lies elsewhere for x than for y, so that a lens has
two centres of projection. That of y is the origin; x sees a point (X, Y, Z) from a gap
g farther ahead, as X / (Z - g) times (Z0 - g) / Z0: at the distance Z0 of the boards,
for which the chief-ray map is then made, both centres say the same. The pupil of other
lenses shifts along the axis with field angle (`optics.projection`).

The image of a dot of finite size, photographed obliquely or through distortion, is not
symmetric about the image of its centre: the near half is larger. The centroid bias that
follows is taken off what was observed (`centroid_shift_mm`). The dot's radiance is
uniform, so its centroid is that of the area inside its outline, an integral along the
outline. The outline is interpolated by a trigonometric polynomial through eight points,
which is exact for every quadratic map, the leading term. Check: for a flat dot tilted
by `a` the bias is f (r/Z)^2 sin(a) cos(a).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from lensfit.fitting.parameters import (
    APERTURE_SHIFT_TERMS,
    LOWEST_BEND_DEGREE,
    Layout,
    board_degrees,
)
from lensfit.optics import field
from lensfit.optics.distortion import Distortion, distorted_from_direction
from lensfit.optics.projection import PupilShift, equivalent_chart_point
from lensfit.programs import kept_program

Parts = dict[str, Array]
"""Named blocks of the parameters: those of the lens, and of one photograph."""
NAMED = ("decentering", "thin_prism", "anamorphic")
"""Blocks of the coefficients of `field.named_basis`, in its order."""
_CORNERS = 8
_ANGLES = 2 * np.pi * np.arange(_CORNERS) / _CORNERS
_OUTLINE = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], -1)
_APART = np.subtract.outer(np.arange(_CORNERS), np.arange(_CORNERS))
_SLOPE = (-1.0) ** _APART / 2 / np.tan(np.pi / _CORNERS * np.where(_APART, _APART, 4))
"""Derivative along the angle of the trigonometric polynomial through eight points."""


class Frame(NamedTuple):
    """Constants that give the dimensionless parameters their scale; never fitted.

    `board_distance_mm` is Z0, at which all of a pupil that is not one point agrees.
    """

    stated_focal_length_mm: Float[Array, ""]
    reference_radius_mm: Float[Array, ""]
    stated_squeeze: Float[Array, "2"]
    valid_radius: Float[Array, ""]
    box: Float[Array, "2 2"]
    board_distance_mm: Float[Array, ""]


class BoardPose(NamedTuple):
    """One photograph's start pose and board; stacked over photographs for the fit.

    `whole_board` is 1 where the photograph shows the board that `board_stretch`
    describes, from edge to edge, and 0 elsewhere.
    """

    rotation: Float[Array, "3 3"]
    translation_mm: Float[Array, "3"]
    aperture: Int[Array, ""]
    half_board_mm: Float[Array, "2"]
    whole_board: Float[Array, ""]


def parts_of(shared: Array, local: Array, layout: Layout) -> Parts:
    """The blocks of the shared parameters and of one photograph's, by name."""
    shared_parts = {name: shared[where] for name, where in layout.blocks.items()}
    local_parts = {name: local[where] for name, where in layout.local_blocks.items()}
    return shared_parts | local_parts


def distortion_of(shared: Array, layout: Layout, frame: Frame) -> Distortion:
    """The lens that the shared parameters describe."""
    parts = {name: shared[where] for name, where in layout.blocks.items()}
    return lens_of(parts, layout, frame)


compiled_distortion_of = jax.jit(distortion_of, static_argnames=("layout",))
"""The same as one program, for callers that are none."""


def lens_of(parts: Parts, layout: Layout, frame: Frame) -> Distortion:
    """The lens that the named blocks describe."""
    return Distortion(
        principal_distance_mm=frame.stated_focal_length_mm
        * jnp.exp(parts["focal_length"][0]),
        principal_point_mm=parts["principal_point"] * frame.reference_radius_mm,
        radial=parts["radial"],
        valid_radius=frame.valid_radius,
        squeeze=frame.stated_squeeze + parts["squeeze"],
        named=jnp.concatenate([parts[name] for name in NAMED]),
        free=parts["free_field"].reshape(2, -1),
        box=frame.box,
        reference_radius_mm=frame.reference_radius_mm,
        base=layout.base,
        degree=layout.free_degree,
    )


def named_parts(named: Float[Array, " named"]) -> Parts:
    """Coefficients (or slopes) of `field.named_basis` by the blocks they belong to."""
    sizes = (field.DECENTERING_TERMS, field.PRISM_TERMS, field.ANAMORPHIC_TERMS)
    ends = np.cumsum(sizes)
    return {
        name: named[end - size : end]
        for name, size, end in zip(NAMED, sizes, ends.tolist(), strict=True)
    }


def predicted_mm(
    board: Float[Array, "2"],
    shared: Array,
    local: Float[Array, " local"],
    view: BoardPose,
    layout: Layout,
    frame: Frame,
) -> Float[Array, "2"]:
    """Sensor mm where the point's chief ray lands, moved by its aperture's shift."""
    parts = parts_of(shared, local, layout)
    lens = lens_of(parts, layout, frame)
    point = board_point_mm(board, parts, view, layout)
    landed = distorted_from_direction(direction_of(point, parts, view, frame), lens)
    return shifted_mm(landed, parts, view, lens, layout)


def board_point_mm(
    board: Float[Array, "2"], parts: Parts, view: BoardPose, layout: Layout
) -> Float[Array, "3"]:
    """The point in board axes, mm: nominal place, plus stretch and bend."""
    extent = jnp.max(view.half_board_mm)
    stretch = parts["board_stretch"].reshape(2, -1)
    moved = stretch @ board_basis(board, layout.stretch_degree) * view.whole_board
    lifted = parts["board_bend"] @ board_basis(board, layout.bend_degree)
    flat = board * view.half_board_mm + moved * extent
    return jnp.concatenate([flat, (lifted * extent)[None]])


def direction_of(
    point_mm: Float[Array, "3"], parts: Parts, view: BoardPose, frame: Frame
) -> Float[Array, "3"]:
    """A board point seen from the entrance pupil, mm."""
    pose = parts["pose"]
    turned = rotation_from_vector(pose[:3]) @ (view.rotation @ point_mm)
    seen = turned + view.translation_mm + pose[3:] * view.translation_mm[2]
    if parts["pupil_shift"].size:
        shift_mm = parts["pupil_shift"][0] * frame.stated_focal_length_mm
        return equivalent_chart_point(
            seen, PupilShift(shift_mm, frame.board_distance_mm)
        )
    gap_mm = parts["pupil_gap"][0] * frame.stated_focal_length_mm
    at_board = 1 - gap_mm / frame.board_distance_mm
    return seen.at[0].multiply(at_board / (1 - gap_mm / seen[2]))


def shifted_mm(
    landed: Float[Array, "2"],
    parts: Parts,
    view: BoardPose,
    lens: Distortion,
    layout: Layout,
) -> Float[Array, "2"]:
    """What the shutter and a wide aperture do to where a chief ray lands.

    A rolling shutter reads rows one after the other: a camera that moves meanwhile
    shifts each by an amount proportional to its height on the sensor.

    The chief ray belongs to the smallest aperture; at the others the blur is lopsided,
    to first order radially and oddly in the field, from coma and clipping.
    """
    landed = landed + parts["row_drift"] * landed[1]
    if not layout.apertures:
        return landed
    radius_mm = lens.reference_radius_mm
    q = (landed - lens.principal_point_mm) / radius_mm
    shifts = parts["aperture_shift"].reshape(layout.apertures, APERTURE_SHIFT_TERMS)
    mine = jnp.concatenate([jnp.zeros((1, APERTURE_SHIFT_TERMS)), shifts])
    terms = mine[view.aperture]
    r2 = jnp.sum(q**2)
    return landed + q * (terms[0] + r2 * (terms[1] + r2 * terms[2])) * radius_mm


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


def board_basis(board: Float[Array, "2"], degree: int) -> Float[Array, " terms"]:
    """Chebyshev products of degrees 2 and more; lower ones belong to the pose."""
    if degree < LOWEST_BEND_DEGREE:
        return jnp.zeros(0, board.dtype)
    unit = jnp.clip(board, -1.2, 1.2)
    rows = [jnp.ones_like(unit), unit]
    for _ in range(2, degree + 1):
        rows.append(2 * unit * rows[-1] - rows[-2])
    chebyshev = jnp.stack(rows)
    pairs = board_degrees(degree)
    return chebyshev[pairs[:, 0], 0] * chebyshev[pairs[:, 1], 1]


def split_parameters(parameters: Array, layout: Layout) -> tuple[Array, Array]:
    """Shared parameters, and one row of local ones for each view."""
    local = parameters[layout.shared :].reshape(-1, layout.local)
    return parameters[: layout.shared], local


@kept_program(static_argnames=("layout",))
def centroid_shift_mm(
    parameters: Float[Array, " parameters"],
    views: BoardPose,
    view_of_chunk: Int[Array, " chunks"],
    board: Float[Array, "chunks detections 2"],
    radius_mm: Float[Array, " views"],
    layout: Layout,
    frame: Frame,
) -> Float[Array, "chunks detections 2"]:
    """Centroid of the image of each dot minus the image of its centre, mm.

    `radius_mm` is that of the dots on the board; zero gives zero.
    """
    shared, local = split_parameters(parameters, layout)
    points = jnp.concatenate([jnp.zeros((1, 2)), jnp.asarray(_OUTLINE)])

    def shift(detection, own, view, radius):
        def image(point):
            around = detection + point * radius / view.half_board_mm
            return predicted_mm(around, shared, own, view, layout, frame)

        # One loop over the nine points keeps the program small.
        images = jax.lax.map(image, points)
        return _centroid(images[1:] - images[:1])

    def chunk_shifts(board, k):
        view = jax.tree.map(lambda a: a[k], views)
        of_detections = jax.vmap(shift, (0, None, None, None))
        return of_detections(board, local[k], view, radius_mm[k])

    shifts_mm = jax.vmap(chunk_shifts)(board, view_of_chunk)
    return jnp.where((radius_mm[view_of_chunk] > 0)[:, None, None], shifts_mm, 0.0)


def _centroid(outline: Float[Array, "corners 2"]) -> Float[Array, "2"]:
    """Centroid of the area inside an outline, relative to the origin inside it.

    From Green's theorem: 2/3 of the mean of the outline, weighed by x dy - y dx.
    """
    slope = jnp.asarray(_SLOPE, outline.dtype) @ outline
    cross = outline[:, 0] * slope[:, 1] - outline[:, 1] * slope[:, 0]
    area = jnp.sum(cross)
    safe = jnp.where(area == 0, 1.0, area)
    return 2 * (cross @ outline) / (3 * safe)
