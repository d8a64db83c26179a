"""Distortion and lateral colour after the knobs are applied.

A gain of distortion multiplies every coefficient of `lensfit.optics.distortion`: radial
slopes, named terms, free field. The displacement is proportional to the gain to first
order, zero at 0 and the measured one at 1. The map keeps an inverse at any gain, since
each of its factors has one whatever its coefficients are. The ideal projection (a
fisheye's too), the anamorphic squeeze and the principal point stay. Lateral colour is a
small displacement, which the gain multiplies directly.
"""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np

from lensfit.optics import radial
from lensfit.optics.distortion import Distortion
from lensfit.optics.lateral import ChannelShift, LateralColour, no_lateral_colour
from lensfit.preset.aberration_knobs import AberrationKnobs

_MM_PER_UM = 1e-3
_NOTHING_MM = 1e-9
_STEEPEST = 30.0
"""Largest logarithm of a slope that a stated percentage may need."""
_RADII = 24


def adjusted_distortion(
    distortion: Distortion, edge_mm: float, knobs: AberrationKnobs
) -> Distortion:
    """The chief-ray map after the knobs are applied.

    Parameters
    ----------
    edge_mm : Edge of the field, from the principal point: the undistorted radius that a
        percentage is stated for.
    """
    g = knobs.distortion_gain
    if knobs.distortion_percent is not None:
        distortion = _stated(distortion, edge_mm, knobs.distortion_percent / 100)
    if g == 1:
        return distortion
    return replace(
        distortion,
        radial=distortion.radial * g,
        named=distortion.named * g,
        free=distortion.free * g,
    )


def _stated(distortion: Distortion, edge_mm: float, relative: float) -> Distortion:
    """With radial distortion of this much at the edge: the measured one multiplied, or
    third order alone where there is none, or no multiple of it does."""
    from scipy.optimize import brentq

    square = (jnp.asarray(edge_mm, float) / distortion.reference_radius_mm) ** 2
    valid = distortion.valid_radius**2
    for shape in (distortion.radial, jnp.ones(1)):
        steepest = float(
            jnp.max(jnp.abs(radial.log_slope(square * _SHARES, shape, valid)))
            if shape.size
            else 0.0
        )
        if steepest == 0:
            continue

        def excess(factor: float, shape=shape) -> float:
            grown = _magnification(square, shape * factor, valid)
            return float(grown) - 1 - relative

        most = _STEEPEST / steepest
        if excess(-most) * excess(most) < 0:
            factor = brentq(excess, -most, most, xtol=1e-12 * most)
            return replace(distortion, radial=shape * factor)
    raise ValueError(f"no distortion of {100 * relative:g} %")


_magnification = jax.jit(radial.magnification)
_SHARES = jnp.asarray(np.linspace(0, 1, 17))


def adjusted_lateral_colour(
    lateral: LateralColour,
    distortion: Distortion,
    edge_mm: float,
    knobs: AberrationKnobs,
) -> LateralColour:
    """Lateral colour after the knobs; the same object if none applies.

    Parameters
    ----------
    edge_mm : Edge of the field, from the principal point.
    """
    stated = (knobs.lateral_red_um, knobs.lateral_blue_um)
    gains = lateral_gains(knobs)
    if gains == (1, 1) and stated == (None, None):
        return lateral
    if lateral is None:
        if stated == (None, None):
            return None
        lateral = no_lateral_colour()
    reference_mm = float(distortion.reference_radius_mm)
    red, blue = (
        _adjusted_shift(shift, reference_mm, edge_mm / reference_mm, gain, um)
        for shift, gain, um in zip(lateral, gains, stated, strict=True)
    )
    return red, blue


def lateral_gains(knobs: AberrationKnobs) -> tuple[float, float]:
    """By what the displacements of red and of blue are multiplied."""
    every = knobs.chromatic_gain
    return knobs.lateral_red_gain * every, knobs.lateral_blue_gain * every


def _adjusted_shift(
    shift: ChannelShift, reference_mm: float, edge: float, gain: float, um: float | None
) -> ChannelShift:
    factor = gain
    if um is not None:
        size_mm = _largest_mm(shift, reference_mm, edge)
        if abs(size_mm) < _NOTHING_MM:
            shift = ChannelShift(jnp.ones(1), jnp.zeros(2), jnp.asarray(edge, float))
            size_mm = _largest_mm(shift, reference_mm, edge)
        factor *= um * _MM_PER_UM / size_mm
    if factor == 1:
        return shift
    return ChannelShift(
        shift.radial * factor,
        shift.shift_mm * factor,
        shift.valid_radius,
        shift.strain * factor,
        shift.decentering * factor,
    )


def _largest_mm(shift: ChannelShift, reference_mm: float, edge: float) -> float:
    """The largest radial displacement over the field, outwards positive."""
    radius = np.minimum(np.linspace(0, edge, _RADII + 1), float(shift.valid_radius))
    relative = np.polynomial.polynomial.polyval(radius**2, np.asarray(shift.radial))
    moved = reference_mm * radius * relative
    return float(moved[np.argmax(np.abs(moved))])
