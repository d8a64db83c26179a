"""Rays of one object point through chosen places of the pupil.

A place is polar: an azimuth, and a reach that is 0 inside the opening and 1 at its edge
(`optics.pupil.pupil_rays`), so that one set of places fills whatever opening a field
point sees. Rays take the wavelengths of a channel in turn. Each has the light
of its part of the opening, and the area over which that part lands: the determinant
|det dx/du|, which is small where the wavefront folds (caustics).
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from lensfit.optics.aberration import (
    LocalWavefront,
    landing_and_jacobian_mm,
    light_density,
)
from lensfit.optics.distortion import Distortion
from lensfit.optics.pupil import nearest_in_opening, places_in_stop, pupil_rays
from lensfit.optics.stop_places import rays_at_stop, transmitted_light
from lensfit.programs import kept_program
from lensfit.psf.lens_blur import LateralColour, LensBlur, Pencil, pencil
from lensfit.psf.spot import AIRY_SIGMA, Landed

FOOTPRINT = 0.35
"""Variance of a ray's Gaussian over the area of its cell's image."""
_LEAST_DETERMINANT = 0.05
_NO_LIGHT = 1e-30
_POINTS, _RAYS, _PLACES = 360, 96, 100
"""Of a batch; rays a multiple of every number of wavelengths."""
_THREADS = 2


class PupilPlaces(NamedTuple):
    """Where rays pass the pupil; a multiple of three of them.

    Attributes
    ----------
    azimuth_rad, reach : Polar, over the opening.
    share : Of the area of the unit disc that each stands for; they sum to 1.
    """

    azimuth_rad: Float[ArrayLike, " rays"]
    reach: Float[ArrayLike, " rays"]
    share: Float[ArrayLike, " rays"]


class Rays(NamedTuple):
    """Rays of one object point.

    Attributes
    ----------
    landing_mm : From where the green chief ray lands.
    weight : Light of each, up to a factor.
    cell : Area of each one's part of the pupil, in u.
    cell_mm2 : Area of the image of that part.
    variance_mm2 : Of the Gaussian that each is, diffraction included.
    """

    landing_mm: Float[Array, "rays 2"]
    weight: Float[Array, " rays"]
    cell: Float[Array, " rays"]
    cell_mm2: Float[Array, " rays"]
    variance_mm2: Float[Array, " rays"]


class _OfWavelengths(NamedTuple):
    """Rays of one wavelength: u, the nearest that was measured, whether that is it."""

    u: Float[Array, "*rays 2"]
    own: Float[Array, "*rays 2"]
    is_known: Bool[Array, "*rays"]


def rays_through(
    places: PupilPlaces, seen: Pencil, blur: LensBlur, count: Float[Array, ""]
) -> Rays:
    """The rays of a pencil through places of its opening.

    Parameters
    ----------
    count : Rays that fill the opening, where these are some of them.
    """
    u, density = pupil_rays(
        seen.h,
        blur.stop_radius,
        blur.pupil,
        jnp.asarray(places.azimuth_rad),
        jnp.asarray(places.reach),
    )
    cell = seen.grown**2 * density * jnp.asarray(places.share)
    wavelengths = seen.lateral_mm.shape[0]
    parted = _rays_by_wavelength(u, seen, blur)
    found = _landed_by_wavelength(parted, seen, blur)
    weight = cell * found.light.reshape(-1)
    if blur.transmission is not None:
        passed = places_in_stop(u, seen.h, blur.stop_radius, blur.pupil)
        weight *= transmitted_light(*passed, seen.channel, count, blur.transmission)
    cell_mm2 = cell * _spread(found.slope_mm).reshape(-1)
    airy = AIRY_SIGMA**2 * jnp.tile(seen.diffraction_mm2, len(u) // wavelengths)
    at = found.at_mm.reshape(-1, 2)
    return Rays(at, weight, cell, cell_mm2, airy + FOOTPRINT * cell_mm2)


def _rays_by_wavelength(u: Array, seen: Pencil, blur: LensBlur) -> _OfWavelengths:
    """Rays in turn to one wavelength after the other, (rays, wavelengths, ...)."""
    own, is_known = u, jnp.ones(len(u), bool)
    if blur.known is not None:
        widest = jnp.maximum(blur.stop_radius, 1.0)
        own, is_known = nearest_in_opening(u, seen.h, widest, blur.known)
    wavelengths = seen.lateral_mm.shape[0]
    each = (seen.grown * u, seen.grown * own, is_known)
    return _OfWavelengths(*(a.reshape(-1, wavelengths, *a.shape[1:]) for a in each))


def _landed_by_wavelength(
    parted: _OfWavelengths, seen: Pencil, blur: LensBlur
) -> Landed:
    """Rays of every wavelength, from where green's chief ray lands."""

    def one(rays: _OfWavelengths, local: LocalWavefront, lateral: Array) -> Landed:
        found = jax.vmap(_landed_ray, (0, None, None))(rays, blur, local)
        return found._replace(at_mm=found.at_mm + lateral[None])

    return jax.vmap(one, (1, 0, 0), 1)(parted, seen.local, seen.lateral_mm)


def _landed_ray(ray: _OfWavelengths, blur: LensBlur, local: LocalWavefront) -> Landed:
    """One ray; an oval lens draws where it lands out along x and y."""
    light = light_density(ray.own, blur.defocus_mm, local)
    if blur.known is None:
        at, slope = landing_and_jacobian_mm(ray.u, blur.defocus_mm, local)
    else:
        perfect = replace(local, series_mm=jnp.zeros_like(local.series_mm))
        at, slope = landing_and_jacobian_mm(ray.u, blur.defocus_mm, perfect)
        near = replace(local, depth=None, cylinder_mm=None)
        moved, moves = landing_and_jacobian_mm(ray.own, jnp.zeros(()), near)
        at, slope = at + moved, slope + jnp.where(ray.is_known, moves, 0.0)
    if blur.oval is None:
        return Landed(at, slope, light)
    return Landed(at * blur.oval, slope * blur.oval[:, None], light)


def _spread(slope: Array) -> Array:
    """Area that a cell's image has per area of the cell; a fold leaves it a little."""
    area = slope[..., 0, 0] * slope[..., 1, 1] - slope[..., 0, 1] * slope[..., 1, 0]
    size = jnp.sum(slope * slope, (-2, -1)) / 2
    return jnp.sqrt(area * area + (_LEAST_DETERMINANT * size) ** 2)


class LandedRays(NamedTuple):
    """Rays of many object points, single precision.

    Attributes
    ----------
    landing_mm : From where each point's green chief ray lands.
    share : Of the light of its point.
    airy_mm : Standard deviation of the Gaussian nearest to each point's Airy pattern.
    """

    landing_mm: Float[np.ndarray, "points rays 2"]
    share: Float[np.ndarray, "points rays"]
    airy_mm: Float[np.ndarray, " points"]


def rays_of_points(
    points: tuple[np.ndarray, np.ndarray, np.ndarray],
    optics: tuple[LensBlur, Distortion, LateralColour],
    places: PupilPlaces,
) -> LandedRays:
    """Rays of many object points through the same places of their openings.

    Points and rays are taken in batches of one size, so that one program serves any
    number of them.

    Parameters
    ----------
    points : Where green chief rays land (points, 2), object distances from the sensor,
        and channels.
    """
    filled = tuple(_whole_batches(part, _POINTS) for part in points)
    through = [_whole_batches(part, _RAYS) for part in places]
    n_points, n_rays = len(points[0]), np.size(places.reach)
    count = jnp.asarray(float(n_rays))
    firsts = range(0, len(filled[0]), _POINTS), range(0, len(through[0]), _RAYS)

    def batch(at: tuple[int, int]) -> tuple[np.ndarray, ...]:
        some = tuple(jnp.asarray(part[at[0] : at[0] + _POINTS]) for part in filled)
        rays = PupilPlaces(*(jnp.asarray(p[at[1] : at[1] + _RAYS]) for p in through))
        return tuple(np.asarray(part) for part in _batch(some, optics, rays, count))

    with ThreadPoolExecutor(_THREADS) as pool:
        made = list(pool.map(batch, product(*firsts)))
    across = len(firsts[1])
    rows = [made[n : n + across] for n in range(0, len(made), across)]
    landing, weight = (
        np.concatenate([np.concatenate([b[k] for b in row], 1) for row in rows])
        for k in (0, 1)
    )
    airy = np.concatenate([row[0][2] for row in rows])
    light = weight[:n_points, :n_rays]
    total = np.maximum(light.sum(1, keepdims=True), _NO_LIGHT)
    return LandedRays(landing[:n_points, :n_rays], light / total, airy[:n_points])


class StopRays(NamedTuple):
    """Rays of many object points through the same places of the stop.

    Attributes
    ----------
    landing_mm : From where each point's green chief ray lands.
    light : Per area of the stop, up to a factor that rays of a point share.
    """

    landing_mm: Float[np.ndarray, "points rays wavelengths 2"]
    light: Float[np.ndarray, "points rays wavelengths"]


def stop_rays(
    points: tuple[np.ndarray, np.ndarray, np.ndarray],
    optics: tuple[LensBlur, Distortion, LateralColour],
    places: Float[np.ndarray, "rays 2"],
) -> StopRays:
    """Rays of every wavelength through places of the stop, open or not.

    Parameters
    ----------
    points : As `rays_of_points`.
    places : From the middle of the stop, in its radii, x right and y down.
    """
    at, distance, channel = (_whole_batches(part, _POINTS) for part in points)
    through, found = jnp.asarray(_whole_batches(places, _PLACES)), []
    for first in range(0, len(at), _POINTS):
        n = slice(first, first + _POINTS)
        some = jnp.asarray(at[n]), jnp.asarray(distance[n]), jnp.asarray(channel[n])
        found.append([np.asarray(p) for p in _stop_batch(some, optics, through)])
    landing, light = (np.concatenate(part) for part in zip(*found, strict=True))
    own = slice(len(points[0])), slice(len(places))
    return StopRays(landing[own], light[own])


@eqx.filter_jit
def _stop_batch(
    points: tuple[Array, Array, Array],
    optics: tuple[LensBlur, Distortion, LateralColour],
    places: Array,
) -> tuple[Array, Array]:
    blur, distortion, lateral = optics

    def one(point: tuple[Array, Array, Array]) -> tuple[Array, Array]:
        seen = pencil(*point, blur, distortion, lateral)
        u = rays_at_stop(places, seen.h, blur.stop_radius, blur.pupil)
        wavelengths = seen.lateral_mm.shape[0]
        parted = _rays_by_wavelength(jnp.repeat(u, wavelengths, 0), seen, blur)
        landed = _landed_by_wavelength(parted, seen, blur)
        return landed.at_mm, landed.light

    return jax.lax.map(one, points)


def _whole_batches(some: ArrayLike, size: int) -> np.ndarray:
    """Whole batches; the last is repeated."""
    values = np.asarray(some)
    return np.concatenate([values, np.repeat(values[-1:], -len(values) % size, 0)])


@kept_program()
def _batch(
    points: tuple[Array, Array, Array],
    optics: tuple[LensBlur, Distortion, LateralColour],
    places: PupilPlaces,
    count: Array,
) -> tuple[Array, Array, Array]:
    blur, distortion, lateral = optics

    def one(point: tuple[Array, Array, Array]) -> tuple[Array, ...]:
        seen = pencil(*point, blur, distortion, lateral)
        rays = rays_through(places, seen, blur, count)
        airy_mm = AIRY_SIGMA * jnp.sqrt(jnp.mean(seen.diffraction_mm2))
        found = rays.landing_mm, rays.weight, airy_mm
        return tuple(part.astype(jnp.float32) for part in found)

    landing, weight, airy = jax.lax.map(one, points)
    return landing, weight, airy
