"""The residual of one detection and its derivatives by all parameters.

Most parameters are coefficients of a basis: of the named displacements, the free field,
and the board's bend and stretch. Their derivatives are the basis times the derivative
of the residual by the displaced image point, or by the board point. Only these two
derivatives, and those by pose and pinhole, are computed by automatic differentiation,
in reverse mode: a residual has two components, a lens two hundred parameters.

The coefficients of the displacement are those behind the guard against folding
(`optics.field`); `normal` accounts for the guard once for all detections.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from lensfit.fitting.geometry import (
    NAMED,
    BoardPose,
    Frame,
    Parts,
    board_basis,
    board_point_mm,
    direction_of,
    lens_of,
    named_parts,
    shifted_mm,
)
from lensfit.fitting.parameters import Layout
from lensfit.optics import field
from lensfit.optics.base import image_of_direction
from lensfit.optics.distortion import (
    box_from_principal_point,
    on_sensor_mm,
    radial_image,
)

GUARDED = (*NAMED, "free_field")
"""Blocks behind the guard, which follow each other in the vector."""
_ON_THE_BOARD = ("board_stretch", "board_bend")


class Detection(NamedTuple):
    """One detection; see `chunks.Detections`."""

    board: Float[Array, "2"]
    observed_mm: Float[Array, "2"]
    whitening: Float[Array, "2 2"]


class _Nudge(NamedTuple):
    """Moves of the board point, mm, and of the displaced image point."""

    board_mm: Float[Array, "3"]
    image: Float[Array, "2"]


class _Displacement(NamedTuple):
    """The displacement near one image point, and its basis there."""

    q: Float[Array, "2"]
    corner: Float[Array, "2"]
    value: Float[Array, "2"]
    by_q: Float[Array, "2 2"]
    by_corner: Float[Array, "2 2"]
    named: Float[Array, "named 2"]
    free: Float[Array, " free"]

    def at(self, q: Array, corner: Array) -> Array:
        """Exact in value and slope where it was taken."""
        moved = self.by_q @ (q - self.q) + self.by_corner @ (corner - self.corner)
        return self.value + moved


def row(
    detection: Detection, parts: Parts, view: BoardPose, layout: Layout, frame: Frame
) -> tuple[Float[Array, "2 parameters"], Float[Array, "2"]]:
    """Derivative of a whitened residual, in the order of the blocks, and the residual.

    The coefficients of `GUARDED` blocks in `parts` are those behind the guard.
    """
    curved = {n: v for n, v in parts.items() if n not in (*GUARDED, *_ON_THE_BOARD)}
    held = {n: parts[n] for n in (*GUARDED, *_ON_THE_BOARD)}
    point_mm = board_point_mm(detection.board, parts, view, layout)
    still = _Nudge(jnp.zeros(3), jnp.zeros(2))

    def image(curved: Parts, nudge: _Nudge):
        lens = lens_of(curved | held, layout, frame)
        direction = direction_of(point_mm + nudge.board_mm, curved, view, frame)
        q = radial_image(image_of_direction(direction, layout.base), lens)
        return q, box_from_principal_point(lens)[0], lens

    displacement = _displacement_near(*image(curved, still))

    def residual(curved: Parts, nudge: _Nudge):
        q, corner, lens = image(curved, nudge)
        q = q + displacement.at(q, corner) + nudge.image
        landed = shifted_mm(on_sensor_mm(q, lens), curved, view, lens, layout)
        return detection.whitening @ (landed - detection.observed_mm)

    value, pull = jax.vjp(residual, curved, still)
    pulls = [pull(unit) for unit in jnp.eye(2)]
    bases = _board_bases(detection.board, view, layout)
    rows = [
        _in_order(
            slopes | _guarded(nudge, displacement) | _of_board(nudge, bases), layout
        )
        for slopes, nudge in pulls
    ]
    return jnp.stack(rows), value


def _displacement_near(q: Array, corner: Array, lens) -> _Displacement:
    q, corner = jax.lax.stop_gradient((q, corner))
    size = lens.box[1] - lens.box[0]

    def displaced(q, corner):
        box = jnp.stack([corner, corner + size])
        return field.with_basis(lens.degree, q, lens.named, lens.free, box)

    value, named, free = displaced(q, corner)
    by_q, by_corner = jax.jacfwd(lambda *at: displaced(*at)[0], (0, 1))(q, corner)
    return _Displacement(q, corner, value, by_q, by_corner, named, free)


def _guarded(nudge: _Nudge, displacement: _Displacement) -> Parts:
    by_free = jnp.outer(nudge.image, displacement.free).reshape(-1)
    by_named = named_parts(displacement.named @ nudge.image)
    return by_named | {"free_field": by_free}


def _board_bases(board: Array, view: BoardPose, layout: Layout) -> tuple[Array, Array]:
    """mm that the board point moves per unit of stretch, and of bend."""
    extent = jnp.max(view.half_board_mm)
    stretch = board_basis(board, layout.stretch_degree) * view.whole_board
    return stretch * extent, board_basis(board, layout.bend_degree) * extent


def _of_board(nudge: _Nudge, bases: tuple[Array, Array]) -> Parts:
    stretch, bend = bases
    return {
        "board_stretch": jnp.outer(nudge.board_mm[:2], stretch).reshape(-1),
        "board_bend": nudge.board_mm[2] * bend,
    }


def _in_order(slopes: Parts, layout: Layout) -> Array:
    names = (*layout.blocks, *layout.local_blocks)
    return jnp.concatenate([slopes[name] for name in names])
