"""A peer by hand: a thin lens' disc behind a mask that clips it towards the corner.

What an artist matches to the photographs, grey for all channels, with three numbers:
the disc's radius is `scale` times the thin lens' (stated focal length, f-number, focus
and chart), and never less than `softness_mm` (added in squares); the mask is a disc as
large as that of the widest f-number, shifted along the radius of the field by
`shift` of its radii in the corner, in proportion to the field's height. Its shift
changes sides with the side of focus, as a cat's eye does.

The thin lens has the setting that was stated. Both its pupils are the lens itself, and
it is focused by moving it: `chart.chart_camera` says where it then stands,
`optics.paraxial` how far light misses the sensor.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float
from scipy.optimize import least_squares

from data_synth.bench.peers.dots import PicturedDots, some_of
from lensfit.chart.chart_camera import object_distance_mm
from lensfit.lens import Channel
from lensfit.optics.paraxial import FirstOrder, defocus_mm, exit_pupil_distance_mm


def blur_radius_mm(
    focal_mm: float, f_number: float, focus_mm: float, object_mm: float
) -> float:
    """Of the disc of a point; negative for objects nearer than the focus.

    Parameters
    ----------
    focus_mm, object_mm : From the sensor; either may be infinite.

    Raises
    ------
    ChartError : Nothing is in focus at `focus_mm`.
    """
    to_sensor_mm = focal_mm
    if np.isfinite(focus_mm):
        to_sensor_mm = focus_mm - object_distance_mm(focal_mm, focus_mm)
    lens = FirstOrder(*map(jnp.asarray, (focal_mm, 1.0, to_sensor_mm)))
    focused, placed = jnp.asarray(focus_mm), jnp.asarray(object_mm)
    cone = focal_mm / (2 * f_number) / exit_pupil_distance_mm(lens, placed)
    return float(cone * defocus_mm(lens, focused, placed))


FINE = 4
"""Samples along a cell, or a pixel that is asked for."""
_DOTS = 12
_LEAST_SAMPLES = 0.5
_BOUNDS = ((0.1, 1e-3, -3.0), (4.0, 10.0, 3.0))
_STARTS = ((1.0, 0.5, 0.3), (1.0, 0.5, -0.3))
"""The second number in cells. Rims before the stop clip one side, those behind it the
other."""


class DiscNumbers(NamedTuple):
    """What was matched; see the module."""

    scale: float
    softness_mm: float
    shift: float


class DiscLens(NamedTuple):
    """The disc and its mask at one f-number and focus distance."""

    numbers: DiscNumbers
    focal_length_mm: float
    half_diagonal_mm: float
    widest_f_number: float
    f_number: float
    focus_distance_mm: float

    def psf(
        self,
        image_point_mm: ArrayLike,
        object_distance_mm: float,
        channel: Channel = "g",
        *,
        pixel_pitch_mm: float,
        size_px: int,
    ) -> Float[np.ndarray, "size size"]:
        """The same for every channel; sums to 1 where the mask leaves light."""
        del channel
        thin_mm = blur_radius_mm(
            self.focal_length_mm,
            self.f_number,
            self.focus_distance_mm,
            object_distance_mm,
        )
        place = np.asarray(image_point_mm, float) / self.half_diagonal_mm
        opened = self.f_number / self.widest_f_number
        light = masked_disc(
            jnp.asarray(self.numbers),
            jnp.asarray([thin_mm, thin_mm * opened]),
            jnp.asarray(place),
            jnp.zeros(2),
            jnp.full(2, pixel_pitch_mm / FINE),
            size_px * FINE,
        )
        cells = np.asarray(light).reshape(size_px, FINE, size_px, FINE).sum((1, 3))
        return cells / max(float(cells.sum()), 1e-300)


def masked_disc(
    numbers: Float[Array, "3"],
    thin_mm: Float[Array, "2"],
    place: Float[Array, "2"],
    centre_mm: Float[Array, "2"],
    sample_mm: Float[Array, "2"],
    size: int,
) -> Float[Array, "size size"]:
    """Coverage of samples by the disc and its mask.

    Parameters
    ----------
    numbers : As in `DiscNumbers`.
    thin_mm : The thin lens' radius at this f-number and at the widest, with its sign.
    place : On the field, in half diagonals.
    centre_mm : Of the disc, from the middle of the samples.
    sample_mm : Width and height of one.
    """
    scale, softness_mm, shift = numbers
    radius, open_radius = jnp.hypot(scale * thin_mm, softness_mm)
    side = jnp.where(thin_mm[0] < 0, -1.0, 1.0)
    at = np.arange(size) + 0.5 - size / 2
    x, y = at * sample_mm[0] - centre_mm[0], at * sample_mm[1] - centre_mm[1]
    edge = jnp.sqrt(sample_mm[0] * sample_mm[1])

    def disc(middle: Array, reach: Array) -> Array:
        square = (x[None] - middle[0]) ** 2 + (y[:, None] - middle[1]) ** 2
        inside = jnp.maximum(reach, _LEAST_SAMPLES * edge) - jnp.sqrt(square + 1e-30)
        return jnp.clip(inside / edge + 0.5, 0.0, 1.0)

    shifted = side * shift * open_radius * place
    return disc(jnp.zeros(2), radius) * disc(shifted, open_radius)


def matched_disc(pictures: list[PicturedDots]) -> DiscNumbers:
    """The three numbers that suit the photographs best, every dot counting alike.

    Of each photograph some dots, far from each other; brightness, background and place
    of each are free.
    """
    widest = min(dots.f_number for dots in pictures)
    rows = [_rows(some_of(dots, _DOTS), widest) for dots in pictures]
    every = [jnp.asarray(np.concatenate(parts)) for parts in zip(*rows, strict=True)]
    unit = np.asarray([1.0, min(float(dots.cell_mm.min()) for dots in pictures), 1.0])

    def gap(numbers: np.ndarray) -> np.ndarray:
        return np.asarray(_gaps(jnp.asarray(numbers * unit), *every)).ravel()

    tries = [
        least_squares(gap, start, bounds=_BOUNDS, xtol=1e-3, diff_step=1e-3)
        for start in _STARTS
    ]
    best = min(tries, key=lambda found: found.cost)
    return DiscNumbers(*(float(x) for x in best.x * unit))


def _rows(dots: PicturedDots, widest: float) -> tuple[np.ndarray, ...]:
    """Per dot and channel: what `_gap` takes."""
    count, channels, side = dots.light.shape[:3]
    each = count * channels
    thin_mm = blur_radius_mm(
        dots.focal_length_mm,
        dots.f_number,
        dots.focus_distance_mm,
        dots.object_distance_mm,
    )
    centre_mm = (dots.centre_cells - side / 2) * dots.cell_mm
    place = np.repeat(dots.place_mm / dots.half_diagonal_mm, channels, axis=0)
    seen = [_seen_through(dots.hole_mm2[k, k], dots.cell_mm[k], side) for k in (0, 1)]
    return (
        np.tile([thin_mm, thin_mm * dots.f_number / widest], (each, 1)),
        place,
        centre_mm.reshape(each, 2),
        np.tile(dots.cell_mm / FINE, (each, 1)),
        *(np.broadcast_to(one, (each, *one.shape)) for one in seen),
        dots.light.reshape(each, side, side),
        dots.use.reshape(each, side, side).astype(float),
    )


def _seen_through(hole_mm2: float, cell_mm: float, side: int) -> np.ndarray:
    """Cells of samples along one axis, each spread by the hole: (cells, samples)."""
    at = (np.arange(side * FINE) + 0.5) * cell_mm / FINE
    wide = 2 * hole_mm2 + 1e-12 * cell_mm**2
    spread = np.exp(-((at[:, None] - at[None]) ** 2) / wide)
    spread /= spread.sum(0)
    return spread.reshape(side, FINE, side * FINE).mean(1)


@jax.jit
def _gaps(numbers: Array, *rows: Array) -> Array:
    return jax.lax.map(lambda row: _gap(numbers, *row), rows)


def _gap(numbers, thin_mm, place, centre_mm, sample_mm, in_x, in_y, light, use):
    """What the disc leaves of a dot over the dot's own light, (rows, columns)."""

    def drawn(at_mm: Array) -> Array:
        size = in_x.shape[1]
        fine = masked_disc(numbers, thin_mm, place, at_mm, sample_mm, size)
        return in_y @ fine @ in_x.T

    cells = drawn(jnp.zeros(2))
    total = jnp.maximum(jnp.sum(cells), 1e-12)
    steps = np.arange(len(cells)) + 0.5 - len(cells) / 2
    at = steps[None] * sample_mm[:, None] * FINE
    own_mm = jnp.stack([jnp.sum(cells, 0) @ at[0], jnp.sum(cells, 1) @ at[1]]) / total
    model = drawn(centre_mm - own_mm)
    model = model / jnp.maximum(jnp.max(model), 1e-12)
    # What a small shift of it changes stands for the place, which is free.
    parts = jnp.stack([model, jnp.ones_like(model), *jnp.gradient(model)])
    parts = (parts * use[None]).reshape(4, -1)
    target = (light * use).reshape(-1)
    normal = parts @ parts.T
    normal = normal + 1e-9 * jnp.trace(normal) * jnp.eye(4)
    share = jnp.linalg.solve(normal, parts @ target)
    signal = (target - share[1] * parts[1]) * use.reshape(-1)
    left = target - share @ parts
    return left / jnp.maximum(jnp.linalg.norm(signal), 1e-12)
