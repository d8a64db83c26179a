"""Point-spread functions of a lens on pixels, to an accuracy that is asked for.

As in `spot`, every ray is a Gaussian integrated over pixels, but the rays are
laid for pictures rather than for derivatives:

- they crowd towards the rim of the pupil, where a disc of blur has its edge: with t
  even in (0, 1), the share 1 - (1 - t)^2 of the area lies inside;
- their azimuths advance by `optics.pupil_nodes.TURN`, exactly;
- a Gaussian has the area of its cell's image, |det dx/du|, so that folds of the
  wavefront (caustics) stay sharp.

How many rays: a probe of a few measures the width of the blur in pixels and how
unevenly the light lies in it; the relative error (L2, against 10^6 rays) is then close
to proportional to width over rays, up to 4.5 times as much for folded light. Rays are
computed in float64, pixels in float32.

Rays are laid in turns of a fixed number, and each point gets as many turns as it needs.
Points, rays and pixels have a program each. The first two are long to compile and know
nothing of pixels, so that one of each serves every lens of the same terms and every
size of array; that of the pixels is short and is compiled for a few sizes.

A blur that is known to within some independent moves, each of one standard deviation,
has point-spread functions whose covariance is J C J', to first order: the sum of the
outer products of what every move does to the pixels. Each is a central difference over
half the move, made with the very same rays, so that what rays leave open cancels.

All arrays sum to 1, moved or not: what a pixel gains others lose.

Part of the doubt may be where the light of a point lies about its chief ray, which a
single photograph of dots does not tell; where the picture lies is then known none the
less, since chief rays were fitted to that light. So the error of a function's shape is
told apart: what every move leaves after the best shift.
"""

from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from lensfit.optics.distortion import Distortion
from lensfit.optics.pupil_nodes import TURN
from lensfit.psf.lens_blur import LateralColour, LensBlur, Pencil, pencil
from lensfit.psf.polar_rays import PupilPlaces, Rays, rays_through
from lensfit.psf.spot import LEAST_SIGMA_PX, pixel_shares

_TURN_RAD = 2 * np.pi * TURN
_RAYS = 384
"""In one turn of the loop; a multiple of every number of wavelengths."""
_RAYS_PER_PX = 1.3
"""Rays per pixel of width and per unit of relative error, for a plain disc."""
_EVEN, _UNEVEN, _MOST_FOLDED = 0.15, 10.0, 4.5
_LONGEST = 512
_TOGETHER = 12
"""Points, and turns of rays, that a program takes at a time; fewer are filled up."""
_LEAST_ROOM = 32
STEP = 0.5
"""Share of a standard deviation by which a blur is moved. Smaller ones follow edges of
light more closely, and the unevenness of the rays with them."""
_STEP_PX = 0.25
"""To both sides, of shifts."""


class Raster(NamedTuple):
    """Pixels that are asked for.

    Attributes
    ----------
    pitch_mm : Along x and y.
    tolerance : Relative error to aim at.
    size_px : Rows and columns.
    shift_px : How far right and down of its place everything lands.
    """

    pitch_mm: Float[Array, "2"]
    tolerance: Float[Array, ""]
    size_px: int
    shift_px: tuple[float, float] = (0.0, 0.0)


Points = tuple[Float[Array, "points 2"], Float[Array, " points"], Int[Array, " points"]]
"""Where green chief rays land (the middle of each array), object distances, which may
be infinite, and channels."""
Optics = tuple[LensBlur, Distortion, LateralColour]


def lens_psfs(
    points: Points,
    optics: Optics,
    raster: Raster,
    turns: Int[np.ndarray, " points"] | None = None,
) -> Float[np.ndarray, "points size size"]:
    """Point-spread functions of many points, row 0 on top; each sums to 1.

    Parameters
    ----------
    turns : Of rays for each point (`turns_needed`); as many as are needed when left
        out.
    """
    found = np.empty((len(points[0]), raster.size_px, raster.size_px))
    for some, batch in _batches(points):
        known = None if turns is None else turns[some]
        found[some] = _patches(batch, optics, raster, known)
    return found


def turns_needed(
    points: Points, optics: Optics, raster: Raster
) -> Int[np.ndarray, " points"]:
    """Turns of rays for each point."""
    found = np.empty(len(points[0]), int)
    for some, batch in _batches(points):
        needed = _turns_of(_pencils_of(batch, optics), optics[0], raster)
        found[some] = needed[: len(batch[0])]
    return found


def _batches(points: Points) -> Iterator[tuple[slice, Points]]:
    """Up to `_TOGETHER` points at a time, and which they are."""
    at, distance_mm, channel = points
    for first in range(0, len(at), _TOGETHER):
        some = slice(first, first + _TOGETHER)
        yield some, (at[some], distance_mm[some], channel[some])


def _patches(
    points: Points,
    optics: Optics,
    raster: Raster,
    turns: Int[np.ndarray, " points"] | None,
) -> Float[np.ndarray, "points size size"]:
    """`lens_psfs` of up to `_TOGETHER` points."""
    count, seen = len(points[0]), _pencils_of(points, optics)
    turns = _turns_of(seen, optics[0], raster) if turns is None else _whole_batch(turns)
    every = np.arange(_TOGETHER)
    whose = np.repeat(every[:count], turns[:count])
    turn = np.concatenate([np.arange(n) for n in turns[:count]])
    room = _room(raster.size_px)
    light = jnp.zeros((_TOGETHER, room, room), jnp.float32)
    middle = jnp.asarray(raster.size_px / 2 + np.asarray(raster.shift_px))
    for first in range(0, len(whose), _TOGETHER):
        some = slice(first, first + _TOGETHER)
        own, number = _whole_batch(whose[some]), _whole_batch(turn[some])
        rays = _ray_turns(seen, optics[0], own, number, turns[own])
        live = every < len(whose[some])
        light = _patches_with_rays(light, rays, own, live, raster.pitch_mm, middle)
    requested = np.asarray(light)[:count, : raster.size_px, : raster.size_px]
    total = requested.sum((1, 2), dtype=float)
    # Differences of the error function round to a little below zero.
    return np.maximum(requested, 0) / np.maximum(total, 1e-300)[:, None, None]


def _pencils_of(points: Points, optics: Optics) -> Pencil:
    filled = tuple(_whole_batch(part) for part in points)
    return _pencils(filled, *optics)


def _turns_of(
    seen: Pencil, blur: LensBlur, raster: Raster
) -> Int[np.ndarray, " points"]:
    every = np.arange(_TOGETHER)
    probe = _ray_turns(seen, blur, every, 0 * every, 0 * every + 1)
    return np.asarray(_turns_needed(probe, raster.pitch_mm, raster.tolerance))


def _whole_batch(some: Array | np.ndarray) -> np.ndarray:
    """`_TOGETHER` of them; the last is repeated."""
    values = np.asarray(some)
    spare = np.repeat(values[-1:], _TOGETHER - len(values), 0)
    return np.concatenate([values, spare])


def _room(size_px: int) -> int:
    """The next of a few sizes, so that one program serves several."""
    octave = 1 << max(size_px - 1, _LEAST_ROOM - 1).bit_length()
    return 3 * octave // 4 if size_px <= 3 * octave // 4 else octave


@jax.jit
def _pencils(
    points: tuple[Array, Array, Array],
    blur: LensBlur,
    distortion: Distortion,
    lateral_colour: LateralColour,
) -> Pencil:
    def one(point: tuple[Array, Array, Array]) -> Pencil:
        return pencil(*point, blur, distortion, lateral_colour)

    return jax.lax.map(one, points)


@jax.jit
def _ray_turns(
    seen: Pencil, blur: LensBlur, whose: Array, turn: Array, turns: Array
) -> Rays:
    """One turn of rays for each of `whose`, out of so many."""

    def one(item: tuple[Array, Array, Array]) -> Rays:
        own = jax.tree.map(lambda leaf: leaf[item[0]], seen)
        return _rays(own, blur, item[1], item[2])

    return jax.lax.map(one, (whose, turn, turns))


@jax.jit
def _turns_needed(
    probe: Rays, pixel_pitch_mm: Array, tolerance: Array
) -> Int[Array, " points"]:
    """How many turns each point needs, from the width and the evenness of its light;
    none where there is none."""

    def one(rays: Rays) -> Array:
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
        known = jnp.isfinite(needed)
        turns = jnp.clip(jnp.ceil(jnp.where(known, needed, 0.0)), 2, _LONGEST)
        return jnp.where(known, turns, 0.0).astype(int)

    return jax.vmap(one)(probe)


@partial(jax.jit, donate_argnums=0)
def _patches_with_rays(
    patches: Float[Array, "points room room"],
    rays: Rays,
    whose: Array,
    live: Array,
    pixel_pitch_mm: Array,
    middle_px: Float[Array, "2"],
) -> Float[Array, "points room room"]:
    """Patches with some turns of rays added, of which the living count."""
    room_px = patches.shape[-1]

    def shares(rays: Rays, live: Array) -> tuple[Array, Array]:
        at = rays.landing_mm / pixel_pitch_mm[None] + middle_px[None]
        wide = rays.variance_mm2[:, None] / pixel_pitch_mm[None] ** 2
        weight = jnp.where(live, rays.weight, 0.0)
        at, sigma, weight = (
            a.astype(jnp.float32)
            for a in (at, jnp.sqrt(wide + LEAST_SIGMA_PX**2), weight)
        )
        in_columns, _ = pixel_shares(at[:, 0], sigma[:, 0], room_px)
        in_rows, _ = pixel_shares(at[:, 1], sigma[:, 1], room_px)
        return in_rows * weight[None], in_columns

    # All turns at once: a loop over them waits longer than it works.
    in_rows, in_columns = jax.vmap(shares)(rays, live)
    return patches.at[whose].add(jnp.einsum("tir,tjr->tij", in_rows, in_columns))


def _rays(seen: Pencil, blur: LensBlur, turn: Array, turns: Array) -> Rays:
    """The rays of one turn of the loop out of several."""
    first, count = (turn * _RAYS).astype(float), (turns * _RAYS).astype(float)
    inner = np.arange(_RAYS)
    azimuth = first * _TURN_RAD % (2 * np.pi) + jnp.asarray(
        inner * _TURN_RAD % (2 * np.pi)
    )
    left = 1 - (first + jnp.asarray(inner + 0.5)) / count
    places = PupilPlaces(azimuth, jnp.sqrt(1 - left * left), 2 * left / count)
    return rays_through(places, seen, blur, count)


class MovedBlur(NamedTuple):
    """A blur moved forth and back by a share of a standard deviation, `STEP` or less
    where that would leave what a blur can be."""

    forth: LensBlur
    back: LensBlur
    step: float


MovedBlurs = Iterable[MovedBlur]
"""One for each independent move."""


class KnownPsfs(NamedTuple):
    """Point-spread functions and how well they are known.

    Attributes
    ----------
    deviation : Standard deviation of every pixel.
    shape_deviation : Of each whole, root of the sum of squares over its pixels, of what
        errors leave after the best shift.
    """

    psf: Float[np.ndarray, "points size size"]
    deviation: Float[np.ndarray, "points size size"]
    shape_deviation: Float[np.ndarray, " points"]

    def relative_error(self) -> Float[np.ndarray, " points"]:
        """Expected error of each whole, root mean square, relative (L2)."""
        return _norms(self.deviation) / self._sizes()

    def relative_shape_error(self) -> Float[np.ndarray, " points"]:
        """The same after the best shift of each."""
        return self.shape_deviation / self._sizes()

    def _sizes(self) -> Float[np.ndarray, " points"]:
        """1 where there is no light."""
        size = _norms(self.psf)
        return np.where(size > 0, size, 1.0)


def known_psfs(
    points: Points, optics: Optics, raster: Raster, moved: MovedBlurs
) -> KnownPsfs:
    """Point-spread functions of many points with their standard deviations.

    Parameters
    ----------
    moved : Independent moves of the blur in `optics`.
    """
    turns = turns_needed(points, optics, raster)

    def drawn(
        blur: LensBlur, right_px: float = 0.0, down_px: float = 0.0
    ) -> np.ndarray:
        shifted = raster._replace(shift_px=(right_px, down_px))
        return lens_psfs(points, (blur, *optics[1:]), shifted, turns)

    blur = optics[0]
    psf = drawn(blur)
    across = drawn(blur, right_px=_STEP_PX) - drawn(blur, right_px=-_STEP_PX)
    down = drawn(blur, down_px=_STEP_PX) - drawn(blur, down_px=-_STEP_PX)
    shifts = _orthonormal(across, down)
    variance, of_shape = np.zeros_like(psf), np.zeros(len(psf))
    for one in moved:
        change = (drawn(one.forth) - drawn(one.back)) / (2 * one.step)
        variance += change**2
        along = np.einsum("pkij,pij->pk", shifts, change)
        of_shape += np.sum(change**2, (1, 2)) - np.sum(along**2, 1)
    return KnownPsfs(psf, np.sqrt(variance), np.sqrt(np.maximum(of_shape, 0.0)))


def _norms(
    arrays: Float[np.ndarray, "points size size"],
) -> Float[np.ndarray, " points"]:
    return np.sqrt(np.sum(arrays**2, (1, 2)))


def _orthonormal(
    *changes: Float[np.ndarray, "points size size"],
) -> Float[np.ndarray, "points changes size size"]:
    """Orthogonal arrays of norm 1 that span these changes."""
    points, size, _ = changes[0].shape
    unit, _ = np.linalg.qr(np.stack(changes, -1).reshape(points, size * size, -1))
    return np.swapaxes(unit, 1, 2).reshape(points, -1, size, size)


def fewer_moves(
    moves: Sequence[Sequence[float]], count: int
) -> Float[np.ndarray, "count numbers"]:
    """So many moves that stand for all: sums of them with random signs, always the
    same, whose outer products add up to the same covariance on average.

    Reference: M. F. Hutchinson, Communications in Statistics B 19 (1990) 433.
    """
    signs = np.random.default_rng(0).choice([-1.0, 1.0], (count, len(moves)))
    return signs @ np.asarray(moves, float).reshape(len(moves), -1) / count**0.5
