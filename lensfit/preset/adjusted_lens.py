"""Apply the knobs to a measured lens.

Every knob changes the part of the lens that it is named after, before anything is
rendered, so that a picture, a point-spread function and a map agree. Neutral knobs
return the lens itself, and parts that no knob touches stay the same objects.

- `lensfit.preset.adjusted_aberration`: focal surfaces, coma, spherical, their colour;
- `lensfit.preset.adjusted_vignetting`: the parts of the fall-off;
- `lensfit.preset.adjusted_pupil`: blades, oval, cat's eye, ring, filter;
- distortion and lateral colour here.

A gain of distortion multiplies every coefficient of `lensfit.optics.distortion`: radial
slopes, named terms, free field. The displacement is proportional to the gain to first
order, zero at 0 and the measured one at 1. The map keeps an inverse at any gain, since
each of its factors has one whatever its coefficients are. The ideal projection (a
fisheye's too), the anamorphic squeeze and the principal point stay. Lateral colour is a
small displacement, which the gain multiplies directly.

A lens whose blur was not measured counts as perfect: a knob that needs a pupil or a
wavefront changes that of the perfect lens of its f-number.

A gain multiplies the measured numbers and their standard deviations. A stated amount
was not measured, and fall-off is adjusted by parts that no photograph shows separately:
the standard deviations of these are unknown.
"""

import math
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from lensfit.lens import Lens
from lensfit.optics.distortion import Distortion, log_slope, magnification
from lensfit.optics.lateral import ChannelShift, LateralColour, no_lateral_colour
from lensfit.optics.map_deviations import (
    PERSPECTIVE_NUMBERS,
    MapCovariances,
    gain_of_numbers,
)
from lensfit.preset.adjusted_aberration import adjusted_aberration
from lensfit.preset.adjusted_pupil import blur_with_adjusted_pupil, with_adjusted_rims
from lensfit.preset.adjusted_vignetting import adjusted_illumination
from lensfit.preset.knob_groups import (
    BLUR_TERM_GROUPS,
    LEAST_BLADES,
    AberrationKnobs,
    BokehKnobs,
)
from lensfit.psf.lens_blur import LensBlur

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
        distortion = _with_edge_distortion(
            distortion, edge_mm, knobs.distortion_percent / 100
        )
    if g == 1:
        return distortion
    return replace(
        distortion,
        radial=distortion.radial * g,
        named=distortion.named * g,
        free=distortion.free * g,
    )


def _with_edge_distortion(
    distortion: Distortion, edge_mm: float, relative: float
) -> Distortion:
    """With radial distortion of this much at the edge: the measured one multiplied, or
    third order alone where there is none, or no multiple of it does."""
    from scipy.optimize import brentq

    square = (jnp.asarray(edge_mm, float) / distortion.reference_radius_mm) ** 2
    valid = distortion.valid_radius**2
    for shape in (distortion.radial, jnp.ones(1)):
        steepest = float(
            jnp.max(jnp.abs(log_slope(square * _SHARES, shape, valid)))
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


_magnification = jax.jit(magnification)
_SHARES = np.linspace(0, 1, 17)


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


Matrix = Float[np.ndarray, "numbers numbers"]


def adjusted_covariances(
    lens: Lens, adjusted: Lens, knobs: AberrationKnobs
) -> MapCovariances:
    """Covariances of the maps of an adjusted lens.

    Parameters
    ----------
    lens : As it was measured.
    adjusted : The same with its maps adjusted.
    """
    known = lens.covariances
    of_numbers = gain_of_numbers(lens.distortion, knobs.distortion_gain)
    with_pupil = np.append(of_numbers, np.ones(PERSPECTIVE_NUMBERS))
    is_stated = knobs.distortion_percent is not None
    red_gain, blue_gain = lateral_gains(knobs)
    light_stays = adjusted.illumination is lens.illumination
    return MapCovariances(
        distortion=None if is_stated else _grown(known.distortion, of_numbers),
        perspective=None if is_stated else _grown(known.perspective, with_pupil),
        red=None if knobs.lateral_red_um is not None else _grown(known.red, red_gain),
        blue=None
        if knobs.lateral_blue_um is not None
        else _grown(known.blue, blue_gain),
        fall_off=known.fall_off if light_stays else None,
    )


def _grown(covariance: Matrix | None, gain: np.ndarray | float) -> Matrix | None:
    """Of numbers that are multiplied: all of them by one gain, or each by its own."""
    if covariance is None:
        return None
    each = np.broadcast_to(gain, len(covariance))
    return covariance * np.outer(each, each)


def adjusted_lens(lens: Lens, aberration: AberrationKnobs, bokeh: BokehKnobs) -> Lens:
    """The lens with its knobs applied; the same object if none applies.

    Raises
    ------
    ImageError : The filter image cannot be read, or lets no light through.
    """
    if aberration == AberrationKnobs() and bokeh == BokehKnobs():
        return lens
    edge_mm = math.hypot(*lens.sensor_size_mm) / 2
    distortion = adjusted_distortion(lens.distortion, edge_mm, aberration)
    adjusted = replace(
        lens,
        distortion=distortion,
        lateral_colour=adjusted_lateral_colour(
            lens.lateral_colour, lens.distortion, edge_mm, aberration
        ),
        largest_blur_mm=_largest_blur_mm(lens, bokeh),
    )
    blur = adjusted.blur
    if blur is None and _needs_blur(adjusted, aberration, bokeh):
        blur = adjusted.perfect_blur()
    rims = None
    if blur is not None:
        if bokeh.cat_eye_gain != 1 or bokeh.cat_eye_percent is not None:
            corner = edge_mm / float(blur.aberration.field_radius_mm)
            rims = with_adjusted_rims(blur, corner, bokeh)
        adjusted_blur = _adjusted_blur(blur, edge_mm, aberration, bokeh)
        parted = _measured_lateral(lens, adjusted, edge_mm, aberration)
        adjusted = replace(
            adjusted, blur=replace(adjusted_blur, measured_lateral=parted)
        )
    measured = replace(lens, blur=blur)
    illumination = adjusted_illumination(measured, edge_mm, rims, aberration)
    adjusted = replace(adjusted, illumination=illumination)
    return replace(
        adjusted, covariances=adjusted_covariances(lens, adjusted, aberration)
    )


def _measured_lateral(
    lens: Lens, adjusted: Lens, edge_mm: float, aberration: AberrationKnobs
) -> LateralColour:
    """By which wavelengths of a channel part: red and blue that are moved take nothing
    with them; None where that is the adjusted lens' own."""
    if adjusted.lateral_colour is lens.lateral_colour:
        return None
    gain = AberrationKnobs(chromatic_gain=aberration.chromatic_gain)
    measured = adjusted_lateral_colour(
        lens.lateral_colour, lens.distortion, edge_mm, gain
    )
    return measured or no_lateral_colour()


def _adjusted_blur(
    blur: LensBlur, edge_mm: float, aberration: AberrationKnobs, bokeh: BokehKnobs
) -> LensBlur:
    if aberration != AberrationKnobs():
        adjusted = adjusted_aberration(blur.aberration, edge_mm, blur.bands, aberration)
        ideal = blur.is_ideal and not adjusted.terms and not adjusted.colour_terms
        blur = replace(blur, aberration=adjusted, is_ideal=ideal)
    if bokeh != BokehKnobs():
        blur = blur_with_adjusted_pupil(blur, edge_mm, bokeh)
    return blur


def _needs_blur(lens: Lens, aberration: AberrationKnobs, bokeh: BokehKnobs) -> bool:
    """Whether a perfect lens would look otherwise; its state must be known for it."""
    if lens.f_number is None or lens.focus_distance_mm is None:
        return False
    return (
        any(getattr(aberration, f"{name}_um") for name in BLUR_TERM_GROUPS)
        or (bokeh.blades or 0) >= LEAST_BLADES
        or bokeh.ring_brightness != 0
        or bokeh.squeeze != 1
        or bool(bokeh.cat_eye_percent)
        or bokeh.filter_image is not None
    )


def _largest_blur_mm(lens: Lens, bokeh: BokehKnobs) -> float | None:
    percent = bokeh.maximum_blur_percent
    return None if percent is None else lens.sensor_size_mm[0] * percent / 100
