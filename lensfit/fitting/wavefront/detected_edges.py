"""Where detection finds a checker corner, and the middle of a line, on what the model
draws.

For a corner detection (`detect.corner_fit`) fits two edges that cross, each a step that
is blurred evenly to both sides, on uneven light. Coma blurs edges to one side: the
place that fits best is neither the centroid of the blur nor where the chief ray lands.
It is computed here by the same fit. Its derivative by the image follows from the normal
equations at the solution. Places are cells from the middle of the patch, right and
down. Nine numbers describe the edges: place (2), directions (2), log blur, light and
its slopes (3), contrast.

For a line detection (`detect.line_profile`) takes the light across it above a straight
background, which its flanks tell, and the centroid of that within a window about it.
Coma draws a tail to one side: what of it lies beyond the window has no effect, and what
lies on the flanks counts as background. The light across a line is the sum over rays of
a box as wide as the line, blurred by each ray's own Gaussian. The same window holds the
light that detection measures of a line: a wide blur carries a part of it beyond, and
what reaches the flanks is taken off. The middle moves across the line alone. Both
families of a grid together give a vector whose part across either is that family's
move.
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import erf
from jaxtyping import Array, Float

from lensfit.fitting.levenberg import Prior, Quadratic, minimise
from lensfit.psf.spot import FOOTPRINT, Spot

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


_BINS = 96
_ROUNDS = 3
"""Of moving the window to the middle, as detection does."""
_LEAST_MM2 = 1e-12


class DetectedLine(NamedTuple):
    """A line of either family through a point, as detection finds it.

    Attributes
    ----------
    offset_mm : From where the chief ray lands to the middle of the line.
    light_share : Of the light of lines of constant i and j that is measured.
    """

    offset_mm: Float[Array, "2"]
    light_share: Float[Array, "2"]


def detected_line(
    spot: Spot,
    variance_mm2: Float[Array, "2"],
    square_mm: Float[Array, "2 2"],
    line_width: Float[Array, "2"],
    window_mm: Float[Array, "3"],
) -> DetectedLine:
    """Lines through the point where the chief ray lands.

    Parameters
    ----------
    variance_mm2 : Along x and y, of the Gaussian that every ray is besides its own.
    square_mm, line_width : As `Broad` has them.
    window_mm : Of one channel, as `Broad.line_window_mm` has it.
    """
    normals = jnp.stack([_across(square_mm[:, 1]), _across(square_mm[:, 0])])
    pitches_mm = jnp.abs(jnp.einsum("ai,ia->a", normals, square_mm))
    widths_mm = jnp.abs(line_width) * pitches_mm

    def one(normal: Array, width_mm: Array) -> tuple[Array, Array]:
        return _middle_and_share(spot, variance_mm2, normal, width_mm, window_mm)

    middles_mm, shares = jax.vmap(one)(normals, widths_mm)
    return DetectedLine(jnp.linalg.solve(normals, middles_mm), shares)


def _across(along: Array) -> Float[Array, "2"]:
    """Unit vector across a direction."""
    return jnp.stack([along[1], -along[0]]) / jnp.sqrt(jnp.sum(along**2) + _LEAST_MM2)


def _middle_and_share(
    spot: Spot,
    variance_mm2: Array,
    normal: Array,
    width_mm: Array,
    window_mm: Array,
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """The middle along the normal, mm, and the share of the light."""
    half_mm, fade_mm, flank_mm = window_mm
    reach_mm = half_mm + fade_mm + flank_mm
    steps = (np.arange(_BINS) + 0.5) / _BINS * 2 - 1
    u = reach_mm * jnp.asarray(steps, reach_mm.dtype)
    away = (jnp.abs(u) - half_mm) / fade_mm
    counts = 0.5 + 0.5 * jnp.cos(jnp.pi * jnp.clip(away, 0, 1))
    flank = (away >= 1).astype(u.dtype)
    ray_mm = spot.landing_mm @ normal
    blur_mm = jnp.sqrt(
        normal**2 @ variance_mm2 + FOOTPRINT * spot.cell_mm2 + _LEAST_MM2
    )
    middle, share = jnp.zeros((), u.dtype), jnp.ones((), u.dtype)
    for _ in range(_ROUNDS):
        off = (middle + u)[None] - ray_mm[:, None]
        edges = [
            erf((off + side * width_mm / 2) / (math.sqrt(2) * blur_mm[:, None]))
            for side in (1, -1)
        ]
        light = spot.weight @ (edges[0] - edges[1]) / 2
        light = counts * (light - _straight(light, u, flank))
        measured = jnp.sum(light)
        middle = middle + jnp.sum(light * u) / measured
        share = measured * (2 * reach_mm / _BINS) / width_mm
    return middle, share


def _straight(light: Array, u: Array, flank: Array) -> Float[Array, " bins"]:
    """The straight line through what the flanks show."""
    s0, s1, s2 = (jnp.sum(flank * u**k) for k in range(3))
    t0, t1 = jnp.sum(flank * light), jnp.sum(flank * u * light)
    determinant = s0 * s2 - s1**2
    return (s2 * t0 - s1 * t1 + (s0 * t1 - s1 * t0) * u) / determinant
