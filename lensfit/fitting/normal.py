"""Normal equations of the geometric fit, with the block structure of bundle adjustment.

A residual depends on the shared parameters and on those of its own photograph only. Its
products are added to the shared block of the matrix, to the block of its photograph,
and to the block that couples the two, so that the cost grows with the number of
detections and not with detections times photographs. One pass gives the equations of
two random halves of the detections separately, because model selection uses held-out
detections.

Parameters are scaled and have priors, which keeps the matrix well within float64.

Most parameters are coefficients of a basis: of the named displacements, the free field,
and the board's bend and stretch. Their derivatives are the basis times the derivative
of the residual by the displaced image point, or by the board point. Only these two
derivatives, and those by pose and pinhole, are computed by automatic differentiation,
in reverse mode: a residual has two components, a lens two hundred parameters.

The coefficients of the displacement are those behind the guard against folding
(`optics.field`); the guard is accounted for once for all detections.
"""

from functools import partial
from math import gcd
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from lensfit.fitting.device_mesh import (
    SHARED,
    cores,
    on_every_core,
    summed_over_cores,
    this_core,
)
from lensfit.fitting.geometry import (
    NAMED,
    BoardPose,
    Frame,
    Parts,
    board_basis,
    board_point_mm,
    direction_of,
    distortion_of,
    lens_of,
    named_parts,
    parts_of,
    predicted_mm,
    shifted_mm,
    split_parameters,
)
from lensfit.fitting.parameters import Layout
from lensfit.fitting.view_stack import Detections
from lensfit.optics import field
from lensfit.optics.distortion import (
    box_from_principal_point,
    on_sensor_mm,
    radial_image,
)
from lensfit.optics.projection import image_of_direction

GUARDED = (*NAMED, "free_field")
"""Blocks behind the guard, which follow each other in the vector."""
_ON_THE_BOARD = ("board_stretch", "board_bend")
BATCH = 4
"""Chunks in one turn of the loop: their rows stay in a processor's cache, no thread
waits for another, and what is looked at besides the chunks in use is little."""


class Detection(NamedTuple):
    """One detection; see `view_stack.Detections`."""

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
        _ordered_slopes(
            slopes
            | _displacement_parts(nudge, displacement)
            | _board_parts(nudge, bases),
            layout,
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


def _displacement_parts(nudge: _Nudge, displacement: _Displacement) -> Parts:
    by_free = jnp.outer(nudge.image, displacement.free).reshape(-1)
    by_named = named_parts(displacement.named @ nudge.image)
    return by_named | {"free_field": by_free}


def _board_bases(board: Array, view: BoardPose, layout: Layout) -> tuple[Array, Array]:
    """mm that the board point moves per unit of stretch, and of bend."""
    extent = jnp.max(view.half_board_mm)
    stretch = board_basis(board, layout.stretch_degree) * view.whole_board
    return stretch * extent, board_basis(board, layout.bend_degree) * extent


def _board_parts(nudge: _Nudge, bases: tuple[Array, Array]) -> Parts:
    stretch, bend = bases
    return {
        "board_stretch": jnp.outer(nudge.board_mm[:2], stretch).reshape(-1),
        "board_bend": nudge.board_mm[2] * bend,
    }


def _ordered_slopes(slopes: Parts, layout: Layout) -> Array:
    names = (*layout.blocks, *layout.local_blocks)
    return jnp.concatenate([slopes[name] for name in names])


class Equations(NamedTuple):
    """J^T J, J^T r and r^T r of two halves of the detections.

    Shared parameters come first, then each photograph's.
    """

    matrix: Float[Array, "2 parameters parameters"]
    gradient: Float[Array, "2 parameters"]
    chi_squared: Float[Array, "2"]


class _Blocks(NamedTuple):
    shared: Float[Array, "2 shared shared"]
    own: Float[Array, "2 views row local"]
    gradient: Float[Array, "2 views row"]
    chi_squared: Float[Array, "2"]


def predictions_mm(
    parameters: Float[Array, " parameters"],
    views: BoardPose,
    view_of_chunk: Int[Array, " chunks"],
    board: Float[Array, "chunks detections 2"],
    layout: Layout,
    frame: Frame,
) -> Float[Array, "chunks detections 2"]:
    """Where points on the boards should be seen."""
    shared, local = split_parameters(parameters, layout)
    of_detections = jax.vmap(predicted_mm, (0, None, None, None, None, None))

    def predictions_of_chunk(board, k):
        view = jax.tree.map(lambda a: a[k], views)
        return of_detections(board, shared, local[k], view, layout, frame)

    return jax.vmap(predictions_of_chunk)(board, view_of_chunk)


def equations(
    parameters: Float[Array, " parameters"],
    views: BoardPose,
    detections: Detections,
    layout: Layout,
    frame: Frame,
) -> Equations:
    """Gathered over the chunks in use; a chunk's every other detection makes a half.

    Quick where the number of chunks is a multiple of `BATCH`. Every core takes every so
    many-th batch.
    """
    pass_of_core = partial(_equations_of_core, layout=layout)
    found = on_every_core(pass_of_core, takes=SHARED, gives=SHARED)
    return found(parameters, views, detections, frame)


def _equations_of_core(
    parameters: Array,
    views: BoardPose,
    detections: Detections,
    frame: Frame,
    layout: Layout,
) -> Equations:
    """The equations, from what this core and the others find."""
    shared, local = split_parameters(parameters, layout)
    guarded, by_coefficient = _behind_guard(shared, layout, frame)
    k, n = layout.shared, layout.shared + layout.local
    count, batch = local.shape[0], gcd(BATCH, detections.view.shape[0])
    of_detections = jax.vmap(row, (0, None, None, None, None))
    every = Detection(detections.board, detections.observed_mm, detections.whitening)

    def chunk_rows(own, detection: Detection):
        view = jax.tree.map(lambda a: a[own], views)
        parts: Parts = parts_of(shared, local[own], layout) | guarded
        rows, values = of_detections(detection, parts, view, layout, frame)
        rows = jnp.swapaxes(rows.reshape(-1, 2, 2, n), 0, 1).reshape(2, -1, n)
        return rows, jnp.swapaxes(values.reshape(-1, 2, 2), 0, 1).reshape(2, -1)

    def add(i, sums: _Blocks) -> _Blocks:
        own, detection = jax.tree.map(
            lambda a: jax.lax.dynamic_slice_in_dim(a, i * batch, batch),
            (detections.view, every),
        )
        rows, values = jax.vmap(chunk_rows, out_axes=1)(own, detection)
        flat = rows[..., :k].reshape(2, -1, k)
        return _Blocks(
            sums.shared + jnp.einsum("hra,hrb->hab", flat, flat),
            sums.own.at[:, own].add(jnp.einsum("hcra,hcrb->hcab", rows, rows[..., k:])),
            sums.gradient.at[:, own].add(jnp.einsum("hcra,hcr->hca", rows, values)),
            sums.chi_squared + jnp.sum(values**2, (1, 2)),
        )

    empty = _Blocks(
        jnp.zeros((2, k, k)),
        jnp.zeros((2, count, n, layout.local)),
        jnp.zeros((2, count, n)),
        jnp.zeros(2),
    )
    batches = -(-detections.chunks // batch)
    first = this_core().astype(batches.dtype)
    mine = -((first - batches) // cores().size)
    sums = jax.lax.fori_loop(
        0, mine, lambda i, sums: add(first + i * cores().size, sums), empty
    )
    sums = _through_guard(summed_over_cores(sums), by_coefficient, layout)
    return _assembled_equations(sums, layout)


def _behind_guard(
    shared: Array, layout: Layout, frame: Frame
) -> tuple[Parts, Float[Array, "guarded guarded"]]:
    """Coefficients as they act, and their derivative by those that are fitted."""
    where = _guarded_slice(layout)
    box = box_from_principal_point(distortion_of(shared, layout, frame))
    named = layout.blocks["free_field"].start - where.start

    def acting(fitted):
        return fitted * field.fold_guard(
            fitted[:named],
            fitted[named:].reshape(2, -1),
            box,
            layout.free_degree,
        )

    fitted = shared[where]
    value, slope = acting(fitted), jax.jacrev(acting)(fitted)
    return named_parts(value[:named]) | {"free_field": value[named:]}, slope


def _through_guard(sums: _Blocks, by_coefficient: Array, layout: Layout) -> _Blocks:
    """The same sums by the coefficients that are fitted: chain rule, once for all."""
    where = _guarded_slice(layout)
    turn = by_coefficient.T
    rows = sums.shared.at[:, where].set(turn @ sums.shared[:, where])
    both = rows.at[:, :, where].set(rows[:, :, where] @ by_coefficient)
    own = sums.own.at[:, :, where].set(turn @ sums.own[:, :, where])
    gradient = sums.gradient.at[..., where].set(
        sums.gradient[..., where] @ by_coefficient
    )
    return _Blocks(both, own, gradient, sums.chi_squared)


def _guarded_slice(layout: Layout) -> slice:
    blocks = layout.blocks
    return slice(blocks[GUARDED[0]].start, blocks[GUARDED[-1]].stop)


def _assembled_equations(sums: _Blocks, layout: Layout) -> Equations:
    """The whole matrix: shared ones first, then each view's."""
    k, local = layout.shared, layout.local
    count = sums.own.shape[1]
    n = k + local * count
    rows = k + jnp.arange(local * count).reshape(count, local)
    shared = jnp.arange(k)
    across, within = sums.own[:, :, :k], sums.own[:, :, k:]
    matrix = jnp.zeros((2, n, n)).at[:, :k, :k].set(sums.shared)
    matrix = matrix.at[:, shared[None, :, None], rows[:, None, :]].set(across)
    matrix = matrix.at[:, rows[:, :, None], shared[None, None, :]].set(
        jnp.swapaxes(across, 2, 3)
    )
    matrix = matrix.at[:, rows[:, :, None], rows[:, None, :]].set(within)
    local_gradient = sums.gradient[:, :, k:].reshape(2, -1)
    gradient = jnp.concatenate(
        [jnp.sum(sums.gradient[:, :, :k], 1), local_gradient], axis=1
    )
    return Equations(matrix, gradient, sums.chi_squared)
