"""How far blur drags the mark of every dot (`drag`, of broad dots `mark`, for all).

Where the model says that a mark lies further out by so much, the chief ray lands
further in: marks go against their drags.
"""

from collections.abc import Callable
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.interpolate import RBFInterpolator

from lensfit.batches import in_batches
from lensfit.fit.wavefront.dots import Dots
from lensfit.fit.wavefront.drag import centroid_slopes_mm, centroids_mm
from lensfit.fit.wavefront.gather import Gathered, chosen, spread_over_takes
from lensfit.fit.wavefront.mark import (
    Seen,
    mark_offset_slopes_mm,
    mark_offsets_mm,
)
from lensfit.fit.wavefront.normal import as_float32
from lensfit.fit.wavefront.parameters import Layout, Scale
from lensfit.fit.wavefront.stages import Stage, with_iris
from lensfit.fit.wavefront.waves import Transfer
from lensfit.programs import kept_program

_BATCH, _BROAD_BATCH, _SLOPES_BATCH = 512, 32, 32
"""Dots that go through a program at a time."""
_TELLING, _TELLING_ALL = 12, 40
"""Dots of a take that tell how errors of the wavefront move its marks, and how the
wavefront itself does."""


def drags_mm(stage: Stage, gathered: Gathered) -> Float[np.ndarray, "dots 3 2"]:
    """Mark of every dot and channel from where its chief ray lands."""
    if gathered.dots.broad is None:
        return _of_dots(centroids_mm, stage, gathered, _BATCH)
    return _of_dots(mark_offsets_mm, stage, gathered, _BROAD_BATCH)


def drags_of_all_mm(stage: Stage, gathered: Gathered) -> Float[np.ndarray, "dots 3 2"]:
    """`drags_mm`; of broad dots, which take a drawing each, as a few tell it."""
    if gathered.dots.broad is None:
        return drags_mm(stage, gathered)
    few = chosen(gathered, spread_over_takes(gathered, _TELLING_ALL))
    return _told_to_all(drags_mm(stage, few)[:, None], few, gathered)[:, 0]


def drag_slopes_mm(
    stage: Stage, gathered: Gathered
) -> Float[np.ndarray, "dots 3 2 parameters"]:
    """d `drags_mm` / d parameter; it costs ten times as much."""
    broad = gathered.dots.broad is not None
    slopes = mark_offset_slopes_mm if broad else centroid_slopes_mm
    return _of_dots(slopes, stage, gathered, _SLOPES_BATCH)


def telling_dots(gathered: Gathered) -> Gathered:
    """The few that tell how parameters drag all."""
    return chosen(gathered, spread_over_takes(gathered, _TELLING))


def moves_of_marks_mm(
    stage: Stage, gathered: Gathered, moves: Float[np.ndarray, "moves parameters"]
) -> Float[np.ndarray, "dots moves 3 2"]:
    """How marks go as the parameters move: moves of any size, told as slight ones."""
    few = telling_dots(gathered)
    still = drags_mm(stage, few)
    against = np.zeros((len(still), len(moves), *still.shape[1:]))
    for k, move in enumerate(moves):
        moved = replace(stage, parameters=stage.parameters + move)
        against[:, k] = still - drags_mm(moved, few)
    return _told_to_all(against, few, gathered)


def slight_moves_of_marks_mm(
    stage: Stage, gathered: Gathered, moves: Float[np.ndarray, "moves parameters"]
) -> Float[np.ndarray, "dots moves 3 2"]:
    """The same, linear in the moves and within a tenth."""
    if not len(moves):
        return np.zeros((len(gathered.take), 0, 3, 2))
    few = telling_dots(gathered)
    against = -np.einsum("dcip,mp->dmci", drag_slopes_mm(stage, few), moves)
    return _told_to_all(against, few, gathered)


def _told_to_all(
    against_mm: Float[np.ndarray, "few moves 3 2"], few: Gathered, gathered: Gathered
) -> Float[np.ndarray, "dots moves 3 2"]:
    """From a few dots of every take: what they say varies slowly over the frame, and a
    thin plate tells it for all."""
    field_mm, told_mm = (np.asarray(g.dots.field_mm) for g in (gathered, few))
    found = np.zeros((len(field_mm), *against_mm.shape[1:]))
    for k in range(len(gathered.shown)):
        mine, told = gathered.take == k, few.take == k
        values = against_mm[told].reshape(told.sum(), -1)
        plate = RBFInterpolator(told_mm[told], values, kernel="thin_plate_spline")
        found[mine] = plate(field_mm[mine]).reshape(mine.sum(), *found.shape[1:])
    return found


def _of_dots(
    function: Callable[..., Array], stage: Stage, gathered: Gathered, batch: int
) -> Float[np.ndarray, "dots 3 2 *shape"]:
    """What a function such as `mark_offsets_mm` finds at the parameters of the fit."""
    cells = gathered.light.shape[-1]
    parameters = jnp.asarray(stage.parameters)
    chromatic = jnp.asarray(gathered.chromatic)

    def found(part: tuple[Dots, Transfer | None]) -> Array:
        dots, transfer = jax.tree.map(jnp.asarray, part)
        seen = dots, chromatic, stage.layout, gathered.scale
        if transfer is None:
            return _one_by_one(function, parameters, *seen)
        return _drawn_one_by_one(function, parameters, *seen, transfer, cells)

    dots = with_iris(gathered, stage.blades)
    return in_batches(found, (dots, gathered.transfer), batch).astype(float)


@kept_program(static_argnames=("function", "layout"))
def _one_by_one(
    function: Callable[..., Array],
    parameters: Array,
    dots: Dots,
    chromatic: Array,
    layout: Layout,
    scale: Scale,
) -> Array:
    return jax.lax.map(
        lambda dot: function(parameters, dot, chromatic, layout, scale), dots
    )


@kept_program(static_argnames=("function", "layout", "cells"))
def _drawn_one_by_one(
    function: Callable[..., Array],
    parameters: Array,
    dots: Dots,
    chromatic: Array,
    layout: Layout,
    scale: Scale,
    transfer: Transfer,
    cells: int,
) -> Array:
    """Of broad dots, in single precision as the fit draws them."""
    numbers = parameters, dots, transfer, chromatic, scale
    parameters, dots, transfer, chromatic, scale = jax.tree.map(as_float32, numbers)

    def one(part: tuple[Dots, Transfer]) -> Array:
        return function(parameters, Seen(*part, chromatic, layout, scale), cells)

    return jax.lax.map(one, (dots, transfer))
