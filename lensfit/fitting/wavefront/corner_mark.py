"""Where detection finds a checker corner on the image that the model draws.

Detection (`detect.corner_fit`) fits two edges that cross, each a step that is blurred
evenly to both sides, on uneven light. Coma blurs edges to one side: the place that fits
best is neither the centroid of the blur nor where the chief ray lands. It is computed
here by the same fit. Its derivative by the image follows from the normal equations at
the solution.

Places are cells from the middle of the patch, right and down. Nine numbers describe the
edges: place (2), directions (2), log blur, light and its slopes (3), contrast.
"""

import math

import jax
import jax.numpy as jnp
from jax.scipy.special import erf
from jaxtyping import Array, Float

from lensfit.fitting.levenberg import Prior, Quadratic, minimise

_FIRST_BLUR_CELLS = 1.5
_TOLERANCE, _MOST_STEPS, _FIRST_DAMPING = 1e-9, 20, 1e-3
_LEAST = 1e-9


def detected_corner(
    image: Float[Array, "cells cells"],
    places: Float[Array, "cells cells 2"],
    side_cells: Float[Array, "2 2"],
    half_width_cells: Float[Array, ""],
    half_width_squares: Float[Array, ""],
) -> Float[Array, "2"]:
    """Place of the corner about the middle; fitted in double precision.

    Parameters
    ----------
    places : Of the cells.
    side_cells : Sides of a square from the corner, in columns.
    half_width_cells, half_width_squares : Of detection's window, at most.
    """
    given = image.reshape(-1), places.reshape(-1, 2), side_cells
    window = half_width_cells, half_width_squares
    light, places, side_cells, *window = (p.astype(float) for p in (*given, *window))
    sides = places @ jnp.linalg.inv(side_cells).T
    inside = jnp.abs(places).max(-1) <= window[0]
    inside &= (jnp.abs(sides) <= window[1]).all(-1)
    weight = inside.astype(float)
    still = jax.lax.stop_gradient(light)
    start = _first_guess(still, weight, places, side_cells)

    def equations(numbers: Array) -> tuple[Quadratic, None]:
        return _equations(numbers, still, weight, places), None

    free = Prior(start, jnp.zeros_like(start), jnp.ones_like(start))
    ended = minimise(
        equations, start, free, _TOLERANCE, _MOST_STEPS, _FIRST_DAMPING
    ).parameters
    # One more Newton step, which carries the derivative by the image.
    here = _equations(ended, light, weight, places)
    step = -jnp.linalg.solve(here.matrix, here.gradient)
    return (ended + step)[:2].astype(image.dtype)


def _first_guess(
    light: Array, weight: Array, places: Array, side_cells: Array
) -> Float[Array, "9"]:
    """Edges along the sides of the squares."""
    mean = jnp.sum(weight * light) / jnp.maximum(jnp.sum(weight), 1.0)
    directions = jnp.arctan2(side_cells[1], side_cells[0])
    numbers = jnp.zeros(9, light.dtype).at[2:4].set(directions).at[5].set(1.0)
    numbers = numbers.at[4].set(math.log(_FIRST_BLUR_CELLS)).at[8].set(1.0)
    shape = weight * (_edges(numbers, places) - 1)
    contrast = jnp.sum(shape * light) / (jnp.sum(shape**2) + _LEAST)
    return numbers.at[5].set(mean).at[8].set(contrast / jnp.maximum(mean, _LEAST))


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


def _equations(numbers: Array, light: Array, weight: Array, places: Array) -> Quadratic:
    """Of Gauss and Newton."""
    slopes = jax.jacfwd(_edges)(numbers, places)
    left = _edges(numbers, places) - light
    weighted = weight[:, None] * slopes
    return Quadratic(slopes.T @ weighted, left @ weighted, weight @ left**2)
