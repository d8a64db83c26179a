"""Point-spread functions of a lens on pixels, to an accuracy that is asked for.

As in `kernel.pixels`, every ray is a Gaussian integrated over pixels, but the rays are
laid for pictures rather than for derivatives:

- they crowd towards the rim of the pupil, where a disc of blur has its edge: with t
  even in (0, 1), the share 1 - (1 - t)^2 of the area lies inside;
- their azimuths advance by 1/sqrt(3) of a turn: its multiples, and those of three
  times it, are spread about evenly, so that rays may be dealt to three wavelengths and
  each wavelength still fills the pupil by itself;
- a Gaussian has the area of its cell's image, |det dx/du|, so that folds of the
  wavefront (caustics) stay sharp.

How many rays: a probe of a few measures the width of the blur in pixels and how
unevenly the light lies in it; the relative error (L2, against 10^6 rays) is then close
to proportional to width over rays, up to 4.5 times as much for folded light. The loop
over rays is as long as each point needs, so one program serves every lens of the same
terms. Rays are computed in float64, pixels in float32.
"""

from dataclasses import replace
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from lensfit.kernel.lens_blur import LateralColour, LensBlur, Pencil, pencil
from lensfit.kernel.pixels import AIRY_SIGMA, LEAST_SIGMA_PX, pixel_shares
from lensfit.optics.aberration import LocalWavefront, landing_and_jacobian_mm
from lensfit.optics.distortion import Distortion
from lensfit.optics.pupil import nearest_in_opening, places_in_stop, pupil_rays
from lensfit.optics.transmission import transmitted

FOOTPRINT = 0.35
"""Variance of a ray's Gaussian over the area of its cell's image."""
_TURN = 2 * np.pi / 3**0.5
_RAYS = 384
"""In one turn of the loop; a multiple of every number of wavelengths."""
_RAYS_PER_PX = 1.3
"""Rays per pixel of width and per unit of relative error, for a plain disc."""
_EVEN, _UNEVEN, _MOST_FOLDED = 0.15, 10.0, 4.5
_LONGEST = 512
_LEAST_ROOM = 32
_LEAST_DETERMINANT = 0.05


class _Rays(NamedTuple):
    """Some rays: landing points (mm), weights, areas of each one's cell in the pupil
    and of the cell's image (mm^2)."""

    landing_mm: Array
    weight: Array
    cell: Array
    cell_mm2: Array
    wavelength: np.ndarray


class _Dealt(NamedTuple):
    """Rays of one wavelength: u, the nearest that was measured, whether that is it."""

    u: Array
    own: Array
    is_known: Array


def lens_psfs(
    image_points_mm: Float[Array, "points 2"],
    object_distance_mm: Float[Array, " points"],
    channel: Int[Array, " points"],
    blur: LensBlur,
    distortion: Distortion,
    lateral_colour: LateralColour,
    pixel_pitch_mm: Float[Array, "2"],
    tolerance: Float[Array, ""],
    *,
    size_px: int,
) -> Float[Array, "points size size"]:
    """Point-spread functions of many points, row 0 on top; each sums to 1.

    Parameters
    ----------
    image_points_mm : Where green chief rays land: the middle of each array.
    object_distance_mm, channel : Of each point; distances may be infinite.
    tolerance : Relative error to aim at.
    """
    found = _in_room(
        (image_points_mm, object_distance_mm, channel),
        blur,
        distortion,
        lateral_colour,
        pixel_pitch_mm,
        tolerance,
        jnp.asarray(float(size_px)),
        room_px=_room(size_px),
    )
    return found[:, :size_px, :size_px]


def _room(size_px: int) -> int:
    """The next of a few sizes, so that one program serves several."""
    octave = 1 << max(size_px - 1, _LEAST_ROOM - 1).bit_length()
    return 3 * octave // 4 if size_px <= 3 * octave // 4 else octave


@partial(jax.jit, static_argnames=("room_px",))
def _in_room(
    points: tuple[Array, Array, Array],
    blur: LensBlur,
    distortion: Distortion,
    lateral_colour: LateralColour,
    pixel_pitch_mm: Array,
    tolerance: Array,
    size_px: Array,
    *,
    room_px: int,
) -> Array:
    """Arrays of `room_px` whose first `size_px` rows and columns are asked for."""

    def one(point: tuple[Array, Array, Array]) -> Array:
        seen = pencil(*point, blur, distortion, lateral_colour)
        turns = _turns_needed(seen, blur, pixel_pitch_mm, tolerance)
        return _patch(seen, blur, pixel_pitch_mm, turns, size_px, room_px)

    return jax.lax.map(one, points)


def _turns_needed(
    seen: Pencil, blur: LensBlur, pixel_pitch_mm: Array, tolerance: Array
) -> Array:
    """How often the loop runs: from the width and the evenness of the light."""
    rays = _rays(seen, blur, jnp.asarray(0), jnp.asarray(1))
    share = rays.weight / jnp.maximum(jnp.sum(rays.weight), 1e-300)
    at = rays.landing_mm / pixel_pitch_mm[None]
    away = at - (share @ at)[None]
    width_px = 2 * jnp.sqrt(2 * jnp.sum(share @ (away * away)))
    # The image of a cell over its area in the pupil.
    spread = rays.cell_mm2 / rays.cell
    mean = share @ spread
    uneven = jnp.sqrt(share @ (spread - mean) ** 2) / jnp.maximum(mean, 1e-300)
    folded = jnp.clip(1 + _UNEVEN * (uneven - _EVEN), 1.0, _MOST_FOLDED)
    needed = _RAYS_PER_PX * width_px * folded / tolerance / _RAYS
    return jnp.clip(jnp.ceil(needed), 2, _LONGEST).astype(int)


def _patch(
    seen: Pencil,
    blur: LensBlur,
    pixel_pitch_mm: Array,
    turns: Array,
    size_px: Array,
    room_px: int,
) -> Array:
    middle = size_px / 2

    def add(turn: Array, patch: Array) -> Array:
        rays = _rays(seen, blur, turn, turns)
        airy = (AIRY_SIGMA**2 * seen.diffraction_mm2)[rays.wavelength]
        variance = airy + FOOTPRINT * rays.cell_mm2
        at = rays.landing_mm / pixel_pitch_mm[None] + middle
        wide = variance[:, None] / pixel_pitch_mm[None] ** 2 + LEAST_SIGMA_PX**2
        at, sigma, weight = (
            a.astype(jnp.float32) for a in (at, jnp.sqrt(wide), rays.weight)
        )
        in_columns, _ = pixel_shares(at[:, 0], sigma[:, 0], room_px)
        in_rows, _ = pixel_shares(at[:, 1], sigma[:, 1], room_px)
        return patch + (in_rows * weight[None]) @ in_columns.T

    empty = jnp.zeros((room_px, room_px), jnp.float32)
    patch = jax.lax.fori_loop(0, turns, add, empty).astype(float)
    asked = jnp.arange(room_px, dtype=size_px.dtype) < size_px
    patch = jnp.where(asked[:, None] & asked[None], patch, 0.0)
    return patch / jnp.maximum(jnp.sum(patch), 1e-300)


def _rays(seen: Pencil, blur: LensBlur, turn: Array, turns: Array) -> _Rays:
    """The rays of one turn of the loop out of several."""
    first, count = (turn * _RAYS).astype(float), (turns * _RAYS).astype(float)
    inner = np.arange(_RAYS)
    azimuth = first * _TURN % (2 * np.pi) + jnp.asarray(inner * _TURN % (2 * np.pi))
    left = 1 - (first + jnp.asarray(inner + 0.5)) / count
    reach = jnp.sqrt(1 - left * left)
    u, density = pupil_rays(seen.h, blur.stop_radius, blur.pupil, azimuth, reach)
    cell = seen.grown**2 * density * 2 * left / count
    weight = cell
    if blur.transmission is not None:
        at = places_in_stop(u, seen.h, blur.stop_radius, blur.pupil)
        weight = cell * transmitted(*at, seen.channel, count, blur.transmission)
    wavelengths = seen.lateral_mm.shape[0]
    dealt = _dealt(u, seen, blur)

    def landed(
        rays: _Dealt, local: LocalWavefront, lateral: Array
    ) -> tuple[Array, Array]:
        at, slope = jax.vmap(_landing_and_jacobian_mm, (0, None, None))(
            rays, blur, local
        )
        return at + lateral[None], _spread(slope)

    at, spread = jax.vmap(landed, (1, 0, 0), (1, 1))(dealt, seen.local, seen.lateral_mm)
    return _Rays(
        at.reshape(-1, 2), weight, cell, cell * spread.reshape(-1), inner % wavelengths
    )


def _dealt(u: Array, seen: Pencil, blur: LensBlur) -> _Dealt:
    """Rays in turn to one wavelength after the other, (rays, wavelengths, ...)."""
    own, is_known = u, jnp.ones(len(u), bool)
    if blur.known is not None:
        widest = jnp.maximum(blur.stop_radius, 1.0)
        own, is_known = nearest_in_opening(u, seen.h, widest, blur.known)
    wavelengths = seen.lateral_mm.shape[0]
    each = (seen.grown * u, seen.grown * own, is_known)
    return _Dealt(*(a.reshape(-1, wavelengths, *a.shape[1:]) for a in each))


def _landing_and_jacobian_mm(
    ray: _Dealt, blur: LensBlur, local: LocalWavefront
) -> tuple[Array, Array]:
    """Of one ray; an oval lens draws both out along x and y."""
    if blur.known is None:
        at, slope = landing_and_jacobian_mm(ray.u, blur.defocus_mm, local)
    else:
        perfect = replace(local, series_mm=jnp.zeros_like(local.series_mm))
        at, slope = landing_and_jacobian_mm(ray.u, blur.defocus_mm, perfect)
        near = replace(local, depth=None)
        moved, moves = landing_and_jacobian_mm(ray.own, jnp.zeros(()), near)
        at, slope = at + moved, slope + jnp.where(ray.is_known, moves, 0.0)
    if blur.oval is None:
        return at, slope
    return at * blur.oval, slope * blur.oval[:, None]


def _spread(slope: Array) -> Array:
    """Area that a cell's image has per area of the cell; a fold leaves it a little."""
    area = slope[:, 0, 0] * slope[:, 1, 1] - slope[:, 0, 1] * slope[:, 1, 0]
    size = jnp.sum(slope * slope, (1, 2)) / 2
    return jnp.sqrt(area * area + (_LEAST_DETERMINANT * size) ** 2)
