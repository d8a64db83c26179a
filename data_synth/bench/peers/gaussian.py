"""A peer without a lens: an elliptical Gaussian for each dot, smooth over the field.

Of every dot and channel brightness, background, centre and covariance are fitted to
its pixels (least squares, Levenberg-Marquardt), and the covariance of pixel and hole is
taken off. Over the field each photograph's covariances are polynomials of fourth order.
A setting that was not photographed gets the photograph that is nearest in pixels of
thin-lens blur, the sides of focus told apart, and in stops.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from data_synth.bench.peers.disc import blur_radius_mm
from data_synth.bench.peers.dots import PicturedDots
from lensfit.batches import in_batches
from lensfit.fitting.levenberg import Prior, Quadratic, minimise
from lensfit.lens import Channel

ORDER = 4
_DOTS_PER_TERM = 2
_BATCH = 256
_MOST_STEPS = 30
_TOLERANCE = 1e-6
_ROUNDS = 3
_OUTLIER = 5.0
"""Deviations (of a normal distribution of the same median) beyond which a dot is left
out of the polynomial."""
_LEAST_DEVIATION_PX = 0.05


class GaussianDots(NamedTuple):
    """Of each dot and channel, in cells; `usable` where it lies within its picture."""

    covariance: Float[np.ndarray, "dots 3 2 2"]
    usable: Bool[np.ndarray, "dots 3"]


class GaussianField(NamedTuple):
    """Covariances of one photograph over its field, mm^2.

    Attributes
    ----------
    dots : The photograph.
    order : Of the polynomials in x and y over half the diagonal.
    control : For xx, xy and yy.
    """

    dots: PicturedDots
    order: int
    control: Float[np.ndarray, "3 terms 3"]


class GaussianLens(NamedTuple):
    """What is known at one f-number and focus distance: the photographs' Gaussians."""

    fields: tuple[GaussianField, ...]
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
        """The nearest photograph's Gaussian in the middle of the array; sums to 1."""
        setting = self.f_number, self.focus_distance_mm, object_distance_mm
        field = nearest_field(self.fields, *setting)
        found = covariance_mm2(field, np.asarray(image_point_mm, float))
        covariance = found["rgb".index(channel)] / pixel_pitch_mm**2
        # A sample's own variance: light is summed over it.
        precision = np.linalg.inv(covariance + np.eye(2) / 12)
        away = np.arange(size_px) + 0.5 - size_px / 2
        x, y = away[None], away[:, None]
        square = precision[0, 0] * x * x + 2 * precision[0, 1] * x * y
        light = np.exp(-(square + precision[1, 1] * y * y) / 2)
        return light / light.sum()


def gaussian_fields(pictures: list[PicturedDots]) -> tuple[GaussianField, ...]:
    """Gaussians of every photograph, and their polynomials."""
    return tuple(field_of(dots, fitted_gaussians(dots)) for dots in pictures)


def fitted_gaussians(dots: PicturedDots) -> GaussianDots:
    """Of the pixels as they are: with the pixel's and the hole's own width in it."""
    shape = dots.light.shape
    light = dots.light.reshape(-1, *shape[2:])
    use = dots.use.reshape(light.shape)
    background, peak, start = _starts(light, use)
    level = (light - background[:, None, None]) / peak[:, None, None]
    found = np.asarray(in_batches(_fitted, (start, level, use.astype(float)), _BATCH))
    root = _root(found)
    covariance = root @ np.swapaxes(root, -1, -2)
    side = shape[-1]
    size = np.sqrt(np.trace(covariance, axis1=-2, axis2=-1))
    usable = np.isfinite(found).all(-1) & (found[:, 0] > 0.1) & (size < side / 2)
    usable &= (np.abs(found[:, 2:4]) < side / 3).all(-1)
    return GaussianDots(
        covariance.reshape(*shape[:2], 2, 2), usable.reshape(*shape[:2])
    )


def field_of(dots: PicturedDots, found: GaussianDots) -> GaussianField:
    """Polynomials through the dots' covariances, of pixel and hole relieved; dots far
    from them are left out and the others fitted again."""
    scale = np.outer(dots.cell_mm, dots.cell_mm)
    own = np.diag(dots.cell_mm**2) / 12 + dots.hole_mm2
    spot = found.covariance * scale - own
    values = np.stack([spot[..., 0, 0], spot[..., 0, 1], spot[..., 1, 1]], -1)
    order = ORDER
    while order and len(_powers(order)) * _DOTS_PER_TERM > len(spot):
        order -= 1
    design = _design(dots, dots.place_mm, order)
    control = [
        _robust(design[kept], values[kept, k]) for k, kept in enumerate(found.usable.T)
    ]
    return GaussianField(dots, order, np.stack(control))


def covariance_mm2(
    field: GaussianField, place_mm: Float[np.ndarray, "2"]
) -> Float[np.ndarray, "3 2 2"]:
    """Of each channel at a point of the sensor; no direction is narrower than a small
    part of a cell. Beyond the dots it is that of their edge."""
    low, high = field.dots.place_mm.min(0), field.dots.place_mm.max(0)
    inside = np.clip(place_mm, low, high)
    terms = _design(field.dots, inside, field.order)
    xx, xy, yy = np.moveaxis(terms @ field.control, -1, 0)
    matrix = np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -2)
    least = (_LEAST_DEVIATION_PX * field.dots.cell_mm.min()) ** 2
    values, axes = np.linalg.eigh(matrix)
    return (axes * np.maximum(values, least)[:, None]) @ np.swapaxes(axes, -1, -2)


def nearest_field(
    fields: tuple[GaussianField, ...],
    f_number: float,
    focus_mm: float,
    object_mm: float,
) -> GaussianField:
    """Of the photograph whose blur is most like that of a setting."""

    def away(field: GaussianField) -> float:
        dots = field.dots
        focal_mm = dots.focal_length_mm
        own = (dots.f_number, dots.focus_distance_mm, dots.object_distance_mm)
        radii = [
            blur_radius_mm(focal_mm, *setting)
            for setting in (own, (f_number, focus_mm, object_mm))
        ]
        pixels = 2 * (radii[0] - radii[1]) / dots.cell_mm.min()
        return float(np.hypot(pixels, np.log2(dots.f_number / f_number) * 2))

    return min(fields, key=away)


def _starts(light, use) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Background, peak, and parameters from moments of what is well above the
    background; x and y from the middle."""
    known = np.where(use, light, np.nan).reshape(len(light), -1)
    known[~use.any((1, 2))] = 0.0
    background = np.nanpercentile(known, 20, axis=1)
    peak = np.maximum(np.nanmax(known, axis=1) - background, 1e-12)
    level = (light - background[:, None, None]) / peak[:, None, None]
    bright = np.where(use, np.clip(level - 0.2, 0.0, None), 0.0)
    bright /= np.maximum(bright.sum((1, 2), keepdims=True), 1e-12)
    at = np.arange(light.shape[-1]) + 0.5 - light.shape[-1] / 2
    x, y = bright.sum(1) @ at, bright.sum(2) @ at
    wide = [
        np.sqrt(np.maximum(bright.sum(k) @ at**2 - mean**2, 0.1))
        for k, mean in ((1, x), (2, y))
    ]
    none = np.zeros(len(light))
    start = [none + 1, none, x, y, np.log(wide[0]), none, np.log(wide[1])]
    return background, peak, np.stack(start, -1)


def _root(parameters: np.ndarray) -> np.ndarray:
    """Triangular root of the covariance."""
    root = np.zeros((*parameters.shape[:-1], 2, 2))
    root[..., 0, 0] = np.exp(parameters[..., 4])
    root[..., 1, 0] = parameters[..., 5]
    root[..., 1, 1] = np.exp(parameters[..., 6])
    return root


@jax.jit
def _fitted(rows: tuple[Array, Array, Array]) -> Array:
    return jax.vmap(_fitted_dot)(*rows)


def _fitted_dot(start: Array, level: Array, use: Array) -> Array:
    side = level.shape[-1]
    at = np.arange(side) + 0.5 - side / 2

    def residual(p: Array) -> Array:
        x = (at - p[2]) * jnp.exp(-p[4])
        y = (at[:, None] - p[3] - p[5] * x[None]) * jnp.exp(-p[6])
        drawn = p[0] * jnp.exp(-(x[None] ** 2 + y**2) / 2) + p[1]
        return ((drawn - level) * use).reshape(-1)

    def equations(p: Array) -> tuple[Quadratic, None]:
        gap, slope = residual(p), jax.jacfwd(residual)(p)
        return Quadratic(slope.T @ slope, slope.T @ gap, gap @ gap + 1e-12), None

    free = jnp.ones_like(start)
    # Little more than what keeps a picture without light from having no answer.
    prior = Prior(start, 1e-6 * free, free)
    return minimise(equations, start, prior, _TOLERANCE, _MOST_STEPS, 1e-2).parameters


def _powers(order: int) -> list[tuple[int, int]]:
    return [(i, k - i) for k in range(order + 1) for i in range(k + 1)]


def _design(dots: PicturedDots, place_mm: np.ndarray, order: int) -> np.ndarray:
    x, y = np.moveaxis(place_mm / dots.half_diagonal_mm, -1, 0)
    return np.stack([x**i * y**j for i, j in _powers(order)], -1)


def _robust(design: np.ndarray, values: np.ndarray) -> Float[np.ndarray, "terms 3"]:
    kept = np.ones(len(values), bool)
    solve = partial(np.linalg.lstsq, rcond=1e-10)
    control = solve(design, values)[0]
    for _ in range(_ROUNDS):
        away = np.abs(values - design @ control)
        usual = 1.4826 * np.median(away[kept], axis=0)
        kept = (away <= _OUTLIER * np.maximum(usual, 1e-12)).all(-1)
        control = solve(design[kept], values[kept])[0]
    return control
