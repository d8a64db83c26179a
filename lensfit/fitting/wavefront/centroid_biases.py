"""Centroid bias of every dot: its detected point minus where its chief ray lands.

The detected point of a small dot is the centroid of its light (`light_centroid`). That
of a broad dot, a checker corner or a line is where detection finds it on what the model
draws (`detected_point`). Where the model has the detected point farther out by some
amount, the chief ray lands farther in by the same amount.
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
from lensfit.fitting.wavefront.detected_point import (
    detected_point_offset_slopes_mm,
    detected_point_offsets_mm,
    line_light_shares,
)
from lensfit.fitting.wavefront.dot_arrays import BroadKind, are_lines, rows_of_kinds
from lensfit.fitting.wavefront.dot_data import (
    DotData,
    rows_spread_over_takes,
    select_dots,
)
from lensfit.fitting.wavefront.light_centroid import centroid_slopes_mm, centroids_mm
from lensfit.fitting.wavefront.normal import as_float32
from lensfit.fitting.wavefront.parameters import Layout, Scale
from lensfit.fitting.wavefront.stages import Stage, with_iris
from lensfit.programs import kept_program

_BATCH, _BROAD_BATCH, _SLOPES_BATCH = 512, 32, 32
"""Dots that go through a program at a time."""
_SAMPLED, _SAMPLED_FOR_ALL = 12, 40
"""Dots of a take at which moves of detected points by errors of the wavefront are
computed, and at which biases themselves are."""


def centroid_biases_mm(
    stage: Stage, dot_data: DotData
) -> Float[np.ndarray, "dots 3 2"]:
    """Detected point of every dot and channel from where its chief ray lands."""
    if dot_data.dots.broad is None:
        return _evaluate_on_dots(centroids_mm, stage, dot_data, _BATCH)
    return _evaluate_by_kind(detected_point_offsets_mm, stage, dot_data)


def smooth_centroid_biases_mm(
    stage: Stage, dot_data: DotData
) -> Float[np.ndarray, "dots 3 2"]:
    """The same; of broad dots, which are costly to draw, computed at a few and
    interpolated."""
    if dot_data.dots.broad is None:
        return centroid_biases_mm(stage, dot_data)
    return _smooth(centroid_biases_mm, stage, dot_data)


def smooth_line_light_shares(
    stage: Stage, dot_data: DotData
) -> Float[np.ndarray, "dots 3 2"]:
    """Share of the light that detection measures of lines of constant i and j at every
    sample, computed at a few and interpolated; 1 of other targets."""
    broad = dot_data.dots.broad
    if broad is None or not are_lines(broad).any():
        return np.ones((len(dot_data.take), 3, 2))

    def of_few(stage: Stage, few: DotData) -> np.ndarray:
        return _evaluate_on_dots(line_light_shares, stage, few, _BROAD_BATCH)

    return _smooth(of_few, stage, dot_data)


def _smooth(
    function: Callable[[Stage, DotData], Float[np.ndarray, "few 3 2"]],
    stage: Stage,
    dot_data: DotData,
) -> Float[np.ndarray, "dots 3 2"]:
    """A function of every dot, computed at a few of every take and interpolated."""
    few = select_dots(dot_data, rows_spread_over_takes(dot_data, _SAMPLED_FOR_ALL))
    return _interpolated_to_all(function(stage, few)[:, None], few, dot_data)[:, 0]


def centroid_bias_slopes_mm(
    stage: Stage, dot_data: DotData
) -> Float[np.ndarray, "dots 3 2 parameters"]:
    """d `centroid_biases_mm` / d parameter; it costs ten times as much."""
    if dot_data.dots.broad is None:
        return _evaluate_on_dots(centroid_slopes_mm, stage, dot_data, _SLOPES_BATCH)
    return _evaluate_by_kind(detected_point_offset_slopes_mm, stage, dot_data)


def sampled_dots(dot_data: DotData) -> DotData:
    """A few of every take, between which the bias is smooth."""
    return select_dots(dot_data, rows_spread_over_takes(dot_data, _SAMPLED))


def detected_point_moves_mm(
    stage: Stage, dot_data: DotData, moves: Float[np.ndarray, "moves parameters"]
) -> Float[np.ndarray, "dots moves 3 2"]:
    """How detected points move with the parameters, for moves of any size."""
    few = sampled_dots(dot_data)
    still = centroid_biases_mm(stage, few)
    against = np.zeros((len(still), len(moves), *still.shape[1:]))
    for k, move in enumerate(moves):
        moved = replace(stage, parameters=stage.parameters + move)
        against[:, k] = still - centroid_biases_mm(moved, few)
    return _interpolated_to_all(against, few, dot_data)


def linear_detected_point_moves_mm(
    stage: Stage, dot_data: DotData, moves: Float[np.ndarray, "moves parameters"]
) -> Float[np.ndarray, "dots moves 3 2"]:
    """The same, linear in the moves and within a tenth."""
    if not len(moves):
        return np.zeros((len(dot_data.take), 0, 3, 2))
    few = sampled_dots(dot_data)
    against = -np.einsum("dcip,mp->dmci", centroid_bias_slopes_mm(stage, few), moves)
    return _interpolated_to_all(against, few, dot_data)


def _interpolated_to_all(
    against_mm: Float[np.ndarray, "few moves 3 2"], few: DotData, dot_data: DotData
) -> Float[np.ndarray, "dots moves 3 2"]:
    """By a thin-plate spline through a few dots of every take."""
    field_mm, known_mm = (np.asarray(g.dots.field_mm) for g in (dot_data, few))
    found = np.zeros((len(field_mm), *against_mm.shape[1:]))
    for k in range(len(dot_data.photographs)):
        mine, known = dot_data.take == k, few.take == k
        values = against_mm[known].reshape(known.sum(), -1)
        plate = RBFInterpolator(known_mm[known], values, kernel="thin_plate_spline")
        found[mine] = plate(field_mm[mine]).reshape(mine.sum(), *found.shape[1:])
    return found


def _evaluate_by_kind(
    function: Callable[..., Array], stage: Stage, dot_data: DotData
) -> Float[np.ndarray, "dots 3 2 *shape"]:
    """Values of a function of one broad target and its kind."""
    broad = dot_data.dots.broad
    assert broad is not None
    rows_of = rows_of_kinds(broad)
    of_kinds = [
        _evaluate_on_dots(function, stage, select_dots(dot_data, rows), _BROAD_BATCH, k)
        for k, rows in rows_of.items()
    ]
    order = np.argsort(np.concatenate(list(rows_of.values())))
    return np.concatenate(of_kinds)[order]


def _evaluate_on_dots(
    function: Callable[..., Array],
    stage: Stage,
    dot_data: DotData,
    batch: int,
    kind: BroadKind | None = None,
) -> Float[np.ndarray, "dots 3 2 *shape"]:
    """Values of a function of one dot, such as `centroids_mm`, for all dots at the
    parameters of the fit.

    Parameters
    ----------
    kind : Of all of them, where the function asks for it.
    """
    dots, transfer = with_iris(dot_data, stage.blades), dot_data.transfer
    is_broad = transfer is not None
    numbers = stage.parameters, dot_data.wavelengths_nm, dot_data.scale
    parameters, wavelengths_nm, scale = jax.tree.map(jnp.asarray, numbers)

    def found(part: tuple[Any, ...]) -> Array:
        part = jax.tree.map(jnp.asarray, part)
        seen = parameters, part, wavelengths_nm, scale
        if is_broad:  # in single precision, as the fit draws them
            seen = jax.tree.map(as_float32, seen)
        return _map_over_dots(function, kind, stage.layout, *seen)

    rows = (dots, transfer) if is_broad else (dots,)
    return in_batches(found, rows, batch).astype(float)


@kept_program(static_argnames=("function", "kind", "layout"))
def _map_over_dots(
    function: Callable[..., Array],
    kind: BroadKind | None,
    layout: Layout,
    parameters: Array,
    dots: tuple[Any, ...],
    wavelengths_nm: Array,
    scale: Scale,
) -> Array:
    """Of dots, or of dots and their transfers."""

    def one(part: tuple[Any, ...]) -> Array:
        seen = parameters, *part, wavelengths_nm, layout, scale
        return function(*seen) if kind is None else function(*seen, kind)

    return jax.lax.map(one, dots)
