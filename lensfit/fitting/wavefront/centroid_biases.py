"""Centroid bias of every dot: how far its mark lies from where its chief ray lands.

Of a small hole a mark is the centroid of its light (`light_centroid`), of a broad dot
or a checker corner where detection finds it on the modelled image (`mark`). Where the
model has a mark farther out by so much, the chief ray lands farther in.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.interpolate import RBFInterpolator

from lensfit.batches import in_batches
from lensfit.fitting.wavefront.gather import Gathered, chosen, spread_over_takes
from lensfit.fitting.wavefront.light_centroid import centroid_slopes_mm, centroids_mm
from lensfit.fitting.wavefront.mark import mark_offset_slopes_mm, mark_offsets_mm
from lensfit.fitting.wavefront.normal import as_float32
from lensfit.fitting.wavefront.parameters import Layout, Scale
from lensfit.fitting.wavefront.stages import Stage, with_iris
from lensfit.programs import kept_program

_BATCH, _BROAD_BATCH, _SLOPES_BATCH = 512, 32, 32
"""Dots that go through a program at a time."""
_SAMPLED, _SAMPLED_FOR_ALL = 12, 40
"""Dots of a take at which it is computed how errors of the wavefront move marks, and
how the wavefront itself does."""


def centroid_biases_mm(
    stage: Stage, gathered: Gathered
) -> Float[np.ndarray, "dots 3 2"]:
    """Mark of every dot and channel from where its chief ray lands."""
    if gathered.dots.broad is None:
        return _of_dots(centroids_mm, stage, gathered, _BATCH)
    return _of_dots(mark_offsets_mm, stage, gathered, _BROAD_BATCH)


def smooth_centroid_biases_mm(
    stage: Stage, gathered: Gathered
) -> Float[np.ndarray, "dots 3 2"]:
    """The same; between a few broad dots, which take a drawing each, interpolated."""
    if gathered.dots.broad is None:
        return centroid_biases_mm(stage, gathered)
    few = chosen(gathered, spread_over_takes(gathered, _SAMPLED_FOR_ALL))
    of_few_mm = centroid_biases_mm(stage, few)[:, None]
    return _interpolated_to_all(of_few_mm, few, gathered)[:, 0]


def centroid_bias_slopes_mm(
    stage: Stage, gathered: Gathered
) -> Float[np.ndarray, "dots 3 2 parameters"]:
    """d `centroid_biases_mm` / d parameter; it costs ten times as much."""
    broad = gathered.dots.broad is not None
    slopes = mark_offset_slopes_mm if broad else centroid_slopes_mm
    return _of_dots(slopes, stage, gathered, _SLOPES_BATCH)


def sampled_dots(gathered: Gathered) -> Gathered:
    """A few of every take, between which the bias is smooth."""
    return chosen(gathered, spread_over_takes(gathered, _SAMPLED))


def moves_of_marks_mm(
    stage: Stage, gathered: Gathered, moves: Float[np.ndarray, "moves parameters"]
) -> Float[np.ndarray, "dots moves 3 2"]:
    """How marks go as the parameters move: moves of any size."""
    few = sampled_dots(gathered)
    still = centroid_biases_mm(stage, few)
    against = np.zeros((len(still), len(moves), *still.shape[1:]))
    for k, move in enumerate(moves):
        moved = replace(stage, parameters=stage.parameters + move)
        against[:, k] = still - centroid_biases_mm(moved, few)
    return _interpolated_to_all(against, few, gathered)


def slight_moves_of_marks_mm(
    stage: Stage, gathered: Gathered, moves: Float[np.ndarray, "moves parameters"]
) -> Float[np.ndarray, "dots moves 3 2"]:
    """The same, linear in the moves and within a tenth."""
    if not len(moves):
        return np.zeros((len(gathered.take), 0, 3, 2))
    few = sampled_dots(gathered)
    against = -np.einsum("dcip,mp->dmci", centroid_bias_slopes_mm(stage, few), moves)
    return _interpolated_to_all(against, few, gathered)


def _interpolated_to_all(
    against_mm: Float[np.ndarray, "few moves 3 2"], few: Gathered, gathered: Gathered
) -> Float[np.ndarray, "dots moves 3 2"]:
    """By a thin plate through a few dots of every take."""
    field_mm, known_mm = (np.asarray(g.dots.field_mm) for g in (gathered, few))
    found = np.zeros((len(field_mm), *against_mm.shape[1:]))
    for k in range(len(gathered.shown)):
        mine, known = gathered.take == k, few.take == k
        values = against_mm[known].reshape(known.sum(), -1)
        plate = RBFInterpolator(known_mm[known], values, kernel="thin_plate_spline")
        found[mine] = plate(field_mm[mine]).reshape(mine.sum(), *found.shape[1:])
    return found


def _of_dots(
    function: Callable[..., Array], stage: Stage, gathered: Gathered, batch: int
) -> Float[np.ndarray, "dots 3 2 *shape"]:
    """What a function such as `mark_offsets_mm` finds at the parameters of the fit."""
    dots, transfer = with_iris(gathered, stage.blades), gathered.transfer
    is_broad = transfer is not None
    numbers = stage.parameters, gathered.chromatic, gathered.scale
    parameters, chromatic, scale = jax.tree.map(jnp.asarray, numbers)

    def found(part: tuple[Any, ...]) -> Array:
        part = jax.tree.map(jnp.asarray, part)
        seen = parameters, part, chromatic, scale
        if is_broad:  # in single precision, as the fit draws them
            seen = jax.tree.map(as_float32, seen)
        return _one_by_one(function, stage.layout, *seen)

    rows = (dots, transfer) if is_broad else (dots,)
    return in_batches(found, rows, batch).astype(float)


@kept_program(static_argnames=("function", "layout"))
def _one_by_one(
    function: Callable[..., Array],
    layout: Layout,
    parameters: Array,
    dots: tuple[Any, ...],
    chromatic: Array,
    scale: Scale,
) -> Array:
    """Of dots, or of dots and their transfers."""

    def one(part: tuple[Any, ...]) -> Array:
        return function(parameters, *part, chromatic, layout, scale)

    return jax.lax.map(one, dots)
