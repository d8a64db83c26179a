"""Apply the knobs to a measured lens.

Every knob changes the part of the lens that it is named after, before anything is
rendered, so that a picture, a point-spread function and a map agree. Neutral knobs
return the lens itself, and parts that no knob touches stay the same objects.

- `lensfit.preset.adjusted_aberration`: focal surfaces, coma, spherical, their colour;
- `lensfit.preset.adjusted_chief_rays`: distortion and lateral colour;
- `lensfit.preset.adjusted_vignetting`: the parts of the fall-off;
- `lensfit.preset.adjusted_pupil`: blades, oval, cat's eye, ring, filter.

A lens whose blur was not measured counts as perfect: a knob that needs a pupil or a
wavefront changes that of the perfect lens of its f-number.

A gain multiplies the measured numbers and their standard deviations. A stated amount
was not measured, and fall-off is adjusted by parts that no photograph shows separately:
the standard deviations of these are unknown.
"""

import math
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from lensfit.lens import Lens
from lensfit.optics.lateral import LateralColour, no_lateral_colour
from lensfit.optics.map_covariances import MapCovariances
from lensfit.optics.object_deviation import PERSPECTIVE_NUMBERS
from lensfit.optics.position_deviation import gain_of_numbers
from lensfit.preset.aberration_knobs import BLUR_FAMILIES, AberrationKnobs
from lensfit.preset.adjusted_aberration import adjusted_aberration
from lensfit.preset.adjusted_chief_rays import (
    adjusted_distortion,
    adjusted_lateral_colour,
    lateral_gains,
)
from lensfit.preset.adjusted_pupil import blur_with_adjusted_pupil, with_adjusted_rims
from lensfit.preset.adjusted_vignetting import adjusted_illumination
from lensfit.preset.bokeh_knobs import LEAST_BLADES, BokehKnobs
from lensfit.psf.lens_blur import LensBlur

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
        any(getattr(aberration, f"{name}_um") for name in BLUR_FAMILIES)
        or (bokeh.blades or 0) >= LEAST_BLADES
        or bokeh.ring_brightness != 0
        or bokeh.squeeze != 1
        or bool(bokeh.cat_eye_percent)
        or bokeh.filter_image is not None
    )


def _largest_blur_mm(lens: Lens, bokeh: BokehKnobs) -> float | None:
    percent = bokeh.maximum_blur_percent
    return None if percent is None else lens.sensor_size_mm[0] * percent / 100
