"""The lens as it was turned: what the knobs do to the one that was measured.

Every knob acts on the part of the lens that it is named after, before anything is
rendered, so that a picture, a point-spread function and a map show the same. Neutral
knobs return the lens itself, and parts that no knob touches stay the same objects.

- `lensfit.preset.adjusted_aberration`: focal surfaces, coma, spherical, colour of
these; - `lensfit.preset.adjusted_chief_rays`: distortion and lateral colour; -
`lensfit.preset.adjusted_vignetting`: the parts of the fall-off; -
`lensfit.preset.adjusted_pupil`: blades, oval, cat's eye, ring, filter; -
`lensfit.preset.adjusted_covariances`: how well the maps are known then.

A lens whose blur was not measured is perfect; what needs an opening or a wavefront to
be turned is turned on that of the perfect lens of its f-number.
"""

import math
from dataclasses import replace

from lensfit.kernel.lens_blur import LensBlur
from lensfit.lens import Lens
from lensfit.optics.lateral import LateralColour, no_lateral_colour
from lensfit.preset.aberration_knobs import BLUR_FAMILIES, AberrationKnobs
from lensfit.preset.adjusted_aberration import turned_aberration
from lensfit.preset.adjusted_chief_rays import turned_distortion, turned_lateral
from lensfit.preset.adjusted_covariances import turned_covariances
from lensfit.preset.adjusted_pupil import turned_opening, turned_rims
from lensfit.preset.adjusted_vignetting import turned_illumination
from lensfit.preset.bokeh_knobs import LEAST_BLADES, BokehKnobs


def turned_lens(lens: Lens, aberration: AberrationKnobs, bokeh: BokehKnobs) -> Lens:
    """The lens as it was turned; the same object where nothing was.

    Raises
    ------
    ImageError : The filter image cannot be read, or lets no light through.
    """
    if aberration == AberrationKnobs() and bokeh == BokehKnobs():
        return lens
    edge_mm = math.hypot(*lens.sensor_size_mm) / 2
    distortion = turned_distortion(lens.distortion, edge_mm, aberration)
    turned = replace(
        lens,
        distortion=distortion,
        lateral_colour=turned_lateral(
            lens.lateral_colour, lens.distortion, edge_mm, aberration
        ),
        largest_blur_mm=_largest_blur_mm(lens, bokeh),
    )
    blur = turned.blur
    if blur is None and _needs_blur(turned, aberration, bokeh):
        blur = turned.perfect_blur()
    rims = None
    if blur is not None:
        if bokeh.cat_eye_gain != 1 or bokeh.cat_eye_percent is not None:
            corner = edge_mm / float(blur.aberration.field_radius_mm)
            rims = turned_rims(blur, corner, bokeh)
        blur_turned = _turned_blur(blur, edge_mm, aberration, bokeh)
        parted = _measured_lateral(lens, turned, edge_mm, aberration)
        turned = replace(turned, blur=replace(blur_turned, measured_lateral=parted))
    measured = replace(lens, blur=blur)
    illumination = turned_illumination(measured, edge_mm, rims, aberration)
    turned = replace(turned, illumination=illumination)
    return replace(turned, covariances=turned_covariances(lens, turned, aberration))


def _measured_lateral(
    lens: Lens, turned: Lens, edge_mm: float, aberration: AberrationKnobs
) -> LateralColour:
    """By which wavelengths of a channel part: red and blue that are moved take nothing
    with them; None where that is the turned lens' own."""
    if turned.lateral_colour is lens.lateral_colour:
        return None
    gain = AberrationKnobs(chromatic_gain=aberration.chromatic_gain)
    measured = turned_lateral(lens.lateral_colour, lens.distortion, edge_mm, gain)
    return measured or no_lateral_colour()


def _turned_blur(
    blur: LensBlur, edge_mm: float, aberration: AberrationKnobs, bokeh: BokehKnobs
) -> LensBlur:
    if aberration != AberrationKnobs():
        turned = turned_aberration(blur.aberration, edge_mm, blur.bands, aberration)
        ideal = blur.is_ideal and not turned.terms and not turned.colour_terms
        blur = replace(blur, aberration=turned, is_ideal=ideal)
    if bokeh != BokehKnobs():
        blur = turned_opening(blur, edge_mm, bokeh)
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
