"""Where detection finds a checker corner, on the image that the model draws.

Detection (`detect.corner_fit`) fits two edges that cross, each a step that is blurred
evenly to both sides, on uneven light. Coma blurs edges to one side: the place that fits
best is neither the centroid of the blur nor where the chief ray lands, and follows from
the same fit. How it moves with the image follows from the normal equations where the
fit ended.

Places are cells from the middle of the patch, right and down.
"""

import math

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import erf
from jaxtyping import Array, Float

from lensfit.detect.corner_fit import WINDOW_PER_SQUARE

_STEPS = 12
_FIRST_BLUR_CELLS = 1.5
_FIRST_DAMPING, _EASED, _TIGHTENED = 1e-2, 0.2, 8.0
_BLUR_CELLS = 0.2, 12.0
_LEAST = 1e-9


def corner_of(
    image: Float[Array, "cells cells"],
    side_cells: Float[Array, "2 2"],
    half_width_cells: Float[Array, ""],
) -> Float[Array, "2"]:
    """Place of the corner about the middle.

    Parameters
    ----------
    side_cells : Sides of a square from the corner, in columns.
    half_width_cells : Of detection's window at most.
    """
    places = _places(image.shape[0], image.dtype)
    sides = jnp.einsum("ij,pj->pi", jnp.linalg.inv(side_cells), places)
    inside = (jnp.abs(sides) <= WINDOW_PER_SQUARE).all(-1)
    inside &= jnp.abs(places).max(-1) <= half_width_cells
    weight, light = inside.astype(image.dtype), image.reshape(-1)
    start = _first_guess(light, weight, places, side_cells)

    def cost(numbers: Array) -> Array:
        return jnp.sum(weight * (light - _edges(numbers, places)) ** 2)

    def step(carry: tuple[Array, Array], _: None):
        numbers, damping = carry
        move = _step(numbers, light, weight, places, damping)
        trial = numbers + move
        trial = trial.at[4].set(jnp.clip(trial[4], *map(math.log, _BLUR_CELLS)))
        better = cost(trial) <= cost(numbers)
        damping = jnp.where(better, damping * _EASED, damping * _TIGHTENED)
        return (jnp.where(better, trial, numbers), damping), None

    damping = jnp.asarray(_FIRST_DAMPING, image.dtype)
    (ended, _), _ = jax.lax.scan(step, (start, damping), None, length=_STEPS)
    ended = jax.lax.stop_gradient(ended)
    # One step more, which says how the corner follows the image.
    return (ended + _step(ended, light, weight, places, jnp.zeros_like(damping)))[:2]


def _places(cells: int, dtype) -> Float[Array, "pixels 2"]:
    along = np.arange(cells) - (cells - 1) / 2
    x, y = np.meshgrid(along, along)
    return jnp.asarray(np.stack([x, y], -1).reshape(-1, 2).astype(dtype))


def _first_guess(
    light: Array, weight: Array, places: Array, side_cells: Array
) -> Float[Array, "9"]:
    """Place, both directions, log blur, light and its slopes, contrast."""
    mean = jnp.sum(weight * light) / jnp.maximum(jnp.sum(weight), 1.0)
    directions = jnp.arctan2(side_cells[1], side_cells[0])
    numbers = jnp.zeros(9, light.dtype).at[2:4].set(directions).at[5].set(mean)
    numbers = numbers.at[4].set(math.log(_FIRST_BLUR_CELLS)).at[8].set(1.0)
    shape = weight * (_edges(numbers, places) / _not_zero(mean) - 1)
    contrast = jnp.sum(shape * light) / (jnp.sum(shape**2) + _LEAST)
    return numbers.at[8].set(contrast / _not_zero(mean))


def _edges(numbers: Array, places: Array) -> Float[Array, " pixels"]:
    """Light of two blurred edges that cross."""
    away = places - numbers[None, :2]
    across = [
        away[:, 1] * jnp.cos(angle) - away[:, 0] * jnp.sin(angle)
        for angle in (numbers[2], numbers[3])
    ]
    blur = jnp.exp(numbers[4])
    uneven = numbers[5] + places @ numbers[6:8]
    return uneven * (1 + numbers[8] * erf(across[0] / blur) * erf(across[1] / blur))


def _step(
    numbers: Array, light: Array, weight: Array, places: Array, damping: Array
) -> Float[Array, "9"]:
    """Of Gauss-Newton."""
    slopes = jax.jacfwd(_edges)(numbers, places)
    weighted = weight[:, None] * slopes
    inner = slopes.T @ weighted
    size = jnp.sqrt(jnp.diagonal(inner) + _LEAST)
    scaled = inner / (size[:, None] * size[None]) + (damping + _LEAST) * jnp.eye(
        len(size), dtype=inner.dtype
    )
    pull = weighted.T @ (light - _edges(numbers, places))
    return jnp.linalg.solve(scaled, pull / size) / size


def _not_zero(value: Array) -> Array:
    return jnp.where(jnp.abs(value) < _LEAST, _LEAST, value)
