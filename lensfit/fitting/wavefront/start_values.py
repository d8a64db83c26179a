"""Where the wavefront fit starts: defocus from statements and blur, rims from light.

The size of every defocus follows from the spread of the dots near the axis, its sign
from focus and chart distance where both were stated. Clipping apertures start where
they explain the fall-off of the dots' brightness.
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from lensfit.fitting.fall_off.illumination import FallOffFit
from lensfit.fitting.wavefront.dot_arrays import dot_aperture_variance_mm2
from lensfit.fitting.wavefront.dot_data import DotData
from lensfit.fitting.wavefront.parameters import Layout
from lensfit.optics.falloff import log_loss
from lensfit.optics.paraxial import defocus_mm
from lensfit.optics.pupil import clear_pupil, relative_illumination
from lensfit.psf.spot import AIRY_SIGMA, WAVELENGTH_MM

_NEAR_AXIS = 0.35
IN_FOCUS_MM = 0.02
"""Defocus too small to have a side."""
_LEAST_BLUR_CELLS = 0.5
"""Standard deviation of the narrowest blur that differs from a slightly larger dot."""
_RADII = 9
_RIM_RADII = (1.02, 1.1, 1.2, 1.35, 1.6, 2.0)
_RIM_SHIFTS = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 1.3)
_INVERSE_PUPIL_MAGNIFICATIONS = 0.25, 4.0
"""Of retrofocus and of telephoto lenses. Breathing beyond is that of elements that move
against each other."""


def stated_defocus_mm(dot_data: DotData) -> Float[np.ndarray, " groups"]:
    """Defocus from stated focus and chart distance, by first-order optics; NaN where
    nothing was stated."""
    return _focused_at_mm(dot_data, _focus_distances_mm(dot_data))


def defocus_deviation_mm(dot_data: DotData) -> Float[np.ndarray, " groups"]:
    """Standard deviation of each stated defocus, from that of the focus distance; NaN
    where nothing was stated."""
    widths, stated_mm = dot_data.widths, _focus_distances_mm(dot_data)
    width_mm = np.hypot(widths.distance_mm, widths.distance * stated_mm)
    width_mm = np.where(np.isinf(stated_mm), 0.0, width_mm)
    moved_mm = _focused_at_mm(dot_data, stated_mm - width_mm)
    return np.abs(moved_mm - _focused_at_mm(dot_data, stated_mm))


def _focus_distances_mm(dot_data: DotData) -> Float[np.ndarray, " groups"]:
    stated_mm = [group.focus_distance_mm for group in dot_data.groups]
    return np.array([np.nan if one is None else one for one in stated_mm])


def _focused_at_mm(
    dot_data: DotData, focus_mm: Float[np.ndarray, " groups"]
) -> Float[np.ndarray, " groups"]:
    """Defocus of every group if its lens was focused there."""
    reference_mm = jnp.asarray(dot_data.reference_distance_mm)
    found = defocus_mm(dot_data.first_order, jnp.asarray(focus_mm), reference_mm)
    return np.asarray(found) * np.exp(_log_squeeze(dot_data))


def defocus_size_mm(dot_data: DotData) -> Float[np.ndarray, " groups"]:
    """Size of every group's defocus, from the spread of its dots near the axis."""
    radius = np.hypot(*dot_data.dots.field_mm.T)
    limit = _NEAR_AXIS * float(dot_data.scale.field_radius_mm)
    central = radius <= max(limit, float(np.quantile(radius, 0.15)))
    # The diameter is that of the disc of the same second moment.
    size = defocus_size_of_variance_mm(dot_data, dot_data.diameter_mm**2 / 16)
    if dot_data.dots.sections is not None:
        # A disc along y, narrower along x: only the mean of both was measured.
        narrow = 1 + np.asarray(dot_data.dots.sections.per_defocus)
        size = size / np.sqrt((1 + narrow**2) / 2)
    found = []
    for group in range(len(dot_data.groups)):
        mine = (dot_data.dots.group == group) & np.isfinite(size)
        near = mine & central if (mine & central).any() else mine
        found.append(float(np.median(size[near])) if near.any() else 0.0)
    return np.array(found)


def _log_squeeze(dot_data: DotData) -> Float[np.ndarray, " groups"]:
    """Of every group's photographs; along y defocus counts s^2 times that along x."""
    sections, groups = dot_data.dots.sections, range(len(dot_data.groups))
    if sections is None:
        return np.zeros(len(groups))
    group, per_defocus = map(np.asarray, (dot_data.dots.group, sections.per_defocus))
    return np.array([-0.5 * np.log1p(per_defocus[group == k].mean()) for k in groups])


def defocus_size_of_variance_mm(
    dot_data: DotData, variance_mm2: Float[np.ndarray, "*ways dots"]
) -> Float[np.ndarray, "*ways dots"]:
    """Size of the defocus whose disc, with the dot aperture, has this variance along a
    line."""
    sine = float(dot_data.scale.reference_sine) * dot_data.dots.stop_radius
    tangent = sine / np.sqrt(1 - sine**2)
    of_disc = np.maximum(variance_mm2 - dot_aperture_variance_mm2(dot_data.dots), 0.0)
    # A disc of radius R has the variance R^2 / 4.
    return 2 * np.sqrt(of_disc) / tangent


def sharp_f_number(dot_data: DotData) -> float:
    """The smallest f-number at which a chart so deep can be as sharp as its dots are.

    The depth of a slanted chart's image follows from first-order optics. The pupil is
    at most so wide that defocus gives the measured blur, and at least so wide that
    diffraction gives half of it. Blur has other causes too, so that the estimated
    f-number is the least.
    """
    optics, dots = dot_data.first_order, dot_data.dots
    pupil_mm = float(optics.focal_length_mm / optics.pupil_magnification)
    depth_mm = float(optics.focal_length_mm) ** 2 / (1 / dots.vergence - pupil_mm)
    variance_mm2 = dot_data.diameter_mm**2 / 16 - dot_aperture_variance_mm2(dots)
    least_mm2 = (_LEAST_BLUR_CELLS * dots.cell_mm.mean(1)) ** 2
    least = dot_data.f_numbers[0]
    least_f_numbers = [least]
    for take in range(len(dot_data.photographs)):
        mine = dot_data.take == take
        across = depth_mm[mine].std() / 2
        seen_mm2 = np.nanmedian(np.maximum(variance_mm2[mine], least_mm2[mine]))
        size_mm = float(np.sqrt(seen_mm2))
        # Along a line a disc of radius R has the variance R^2 / 4.
        by_depth = across / (2 * size_mm)
        least_f_numbers.append(
            min(by_depth, size_mm / 2 / (AIRY_SIGMA * WAVELENGTH_MM))
        )
    return float(np.max(np.nan_to_num(least_f_numbers, nan=least)))


class FirstDefocus(NamedTuple):
    """What is known of every group's defocus before anything is fitted.

    Attributes
    ----------
    size_mm : Its size, from `defocus_size_mm`.
    stated_mm : From `stated_defocus_mm`; NaN where nothing was stated.
    """

    size_mm: Float[np.ndarray, " groups"]
    stated_mm: Float[np.ndarray, " groups"]

    @property
    def side_stated(self) -> Bool[np.ndarray, " groups"]:
        """Where the sign was stated, or that the chart was in focus."""
        return np.isfinite(self.stated_mm)

    @property
    def value_mm(self) -> Float[np.ndarray, " groups"]:
        """Where to start: the measured size on the stated side."""
        side = np.where(self.side_stated, np.sign(self.stated_mm), 1.0)
        in_focus = np.abs(self.stated_mm) <= IN_FOCUS_MM
        return np.where(in_focus, self.stated_mm, side * self.size_mm)


def first_defocus(dot_data: DotData) -> FirstDefocus:
    """Measured and stated defocus."""
    return FirstDefocus(defocus_size_mm(dot_data), stated_defocus_mm(dot_data))


def first_rims(
    fall_off: FallOffFit | None, field_radius_mm: float
) -> Float[np.ndarray, "2"]:
    """Radius and shift of two opposite rims that explain a fall-off best."""
    if fall_off is None:
        return np.array([1.35, 0.6])
    radius_mm = np.linspace(0.1, 1.0, _RADII) * fall_off.valid_radius_mm
    squared = jnp.asarray((radius_mm / fall_off.valid_radius_mm) ** 2)
    control = jnp.asarray(fall_off.control[1])
    seen = np.exp(-np.asarray(jax.vmap(log_loss, (0, None))(squared, control)))
    grid = np.array([(r, a) for r in _RIM_RADII for a in _RIM_SHIFTS])
    lit = np.asarray(
        _relative_illumination(
            jnp.asarray(grid), jnp.asarray(radius_mm / field_radius_mm)
        )
    )
    # Natural fall-off comes on top: a smooth loss that grows as the square.
    loss = np.log(np.maximum(lit, 1e-3)) - np.log(seen)
    shape = (radius_mm / radius_mm[-1]) ** 2
    natural = np.maximum(loss @ shape / (shape @ shape), 0.0)
    left = loss - natural[:, None] * shape[None]
    return grid[int(np.argmin(np.sum(left**2, -1) + 1e-4 * natural**2))]


@jax.jit
def _relative_illumination(rims, h):
    """Relative illumination of each pair of rims at each field height."""

    def one(rim, height):
        pupil = clear_pupil(2)
        shift = jnp.array([[1.0, 0.0], [-1.0, 0.0]]) * rim[1]
        radius = jnp.array([[1.0, 0.0], [1.0, 0.0]]) * rim[0]
        opened = pupil.__class__(
            rim_shift=shift,
            rim_radius=radius,
            stop_shift=pupil.stop_shift,
            stretch=pupil.stretch,
            squeeze=pupil.squeeze,
            blade_rotation_rad=pupil.blade_rotation_rad,
            blade_curvature=pupil.blade_curvature,
        )
        place = jnp.stack([height, jnp.zeros_like(height)])
        return relative_illumination(place, jnp.ones(()), opened)

    return jax.vmap(jax.vmap(one, (None, 0)), (0, None))(rims, h)


def first_parameters(
    dot_data: DotData,
    layout: Layout,
    defocus_mm: Float[np.ndarray, " groups"],
) -> Float[np.ndarray, " parameters"]:
    """The whole vector: a perfect lens with the measured defocus and clipping, and the
    exit pupil that breathing tells."""
    blocks = layout.blocks
    parameters = np.zeros(layout.size)
    parameters[blocks["defocus"]][: len(defocus_mm)] = defocus_mm
    widest = dot_data.fall_offs[0].fit if dot_data.fall_offs else None
    radius, shift = first_rims(widest, float(dot_data.scale.field_radius_mm))
    parameters[blocks["rim_radius"]] = np.tile([radius, 0.0], layout.rims)
    sides = np.resize([shift, 0.0, -shift, 0.0], 2 * layout.rims)
    parameters[blocks["rim_shift"]] = sides
    parameters[blocks["iris"]] = [0.0, 0.0, 0.1]
    parameters[blocks["exit_pupil"]] = [_log_exit_pupil(dot_data), 0.0]
    return parameters


def _log_exit_pupil(dot_data: DotData) -> float:
    """Logarithm of the distance of the exit pupil over the principal distance.

    By `optics.paraxial` that is the pupil magnification, which breathing tells: the
    exit pupil of a telephoto lens is three times nearer to the sensor than its
    principal distance, that of a wide-angle lens four times as far. Elements that move
    make the breathing of most lenses less, and that of some zooms more than any pupil.
    """
    least, largest = _INVERSE_PUPIL_MAGNIFICATIONS
    inverse = 1 / float(dot_data.first_order.pupil_magnification)
    if dot_data.dots.sections is not None or inverse > largest:
        return 0.0  # Behind cylinders there are two pupils.
    return -math.log(max(inverse, least))
