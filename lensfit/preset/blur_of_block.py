"""Convert a preset's blur block to the optics, and back.

The file lists each term of the aberration function with its change by colour, and the
pupil's squeeze as a ratio; the optics keep arrays in the order of their terms, colour
apart, and the logarithm of the squeeze. Nothing else is converted.

`lens_blur` then sets f-number and focus. The radius of a stop that was not photographed
follows its f-number, corrected by interpolation between the photographed stops. A focus
distance that was not photographed is reached by first-order optics: the image plane
moves as if the whole lens did (unit focusing).
"""

import math
from collections.abc import Iterable

import jax.numpy as jnp
import numpy as np

from lensfit.optics.aberration import Aberration
from lensfit.optics.paraxial import (
    defocus_mm,
    first_order_of,
    rim_sine,
)
from lensfit.optics.pupil import Pupil
from lensfit.optics.spectrum import CENTRES_NM, WIDTHS_NM, bands
from lensfit.optics.terms import Term
from lensfit.preset import blur_blocks as blocks
from lensfit.preset.entry import Entry
from lensfit.preset.photographed_stops import radius_ratio
from lensfit.psf.lens_blur import LensBlur

ROUND_SLACK = 1.02
"""Blades show above this times the widest round f-number."""
_COLOURS = 2


def blur_block(
    aberration: Aberration,
    pupil: Pupil,
    *,
    pupil_magnification: float,
    reference_distance_mm: float,
    focus_offset_mm: float,
    stops: Iterable[blocks.Stop],
    round_f_number: float,
    band_centres_nm: tuple[float, float, float] = CENTRES_NM,
    band_widths_nm: tuple[float, float, float] = WIDTHS_NM,
    assumed: tuple[str, ...] = (),
    beyond_offset_mm: float | None = None,
) -> blocks.Blur:
    """The block that describes this optics in a file; see `blur_blocks.Blur`."""
    return blocks.Blur(
        aberrations=_terms_of(aberration),
        field_radius_mm=float(aberration.field_radius_mm),
        reference_sine=float(aberration.reference_sine),
        exit_pupil_distance_mm=float(aberration.exit_pupil_distance_mm),
        chief_bend=float(aberration.chief_bend),
        pupil_magnification=float(pupil_magnification),
        reference_distance_mm=float(reference_distance_mm),
        focus_offset_mm=float(focus_offset_mm),
        pupil=_pupil_block(pupil),
        stops=tuple(sorted(stops, key=lambda stop: stop.f_number)),
        band_centres_nm=_three(band_centres_nm),
        band_widths_nm=_three(band_widths_nm),
        round_f_number=float(round_f_number),
        assumed=tuple(assumed),
        beyond_offset_mm=beyond_offset_mm,
    )


def aberration_of(blur: blocks.Blur) -> Aberration:
    """The aberration function of a block."""
    terms = tuple(_term(t) for t in blur.aberrations)
    coloured = [t for t in blur.aberrations if t.um_by_colour]
    colour = [(*t.um_by_colour, 0.0)[:_COLOURS] for t in coloured]
    return Aberration(
        coefficients_um=_numbers([t.um for t in blur.aberrations]),
        colour_um=_numbers(colour).reshape(-1, _COLOURS).T,
        field_radius_mm=_numbers(blur.field_radius_mm),
        reference_sine=_numbers(blur.reference_sine),
        exit_pupil_distance_mm=_numbers(blur.exit_pupil_distance_mm),
        chief_bend=_numbers(blur.chief_bend),
        terms=terms,
        colour_terms=tuple(_term(t) for t in coloured),
    )


def pupil_of(pupil: blocks.Pupil, *, bladed: bool = True) -> Pupil:
    """The opening of a block; without its blades where the stop is wide open."""
    return Pupil(
        rim_shift=_numbers([rim.shift for rim in pupil.rims]).reshape(-1, 2),
        rim_radius=_numbers([rim.radius for rim in pupil.rims]).reshape(-1, 2),
        stop_shift=_numbers(pupil.stop_shift),
        stretch=_numbers([pupil.stretch_along, pupil.stretch_across]),
        squeeze=_numbers(math.log(pupil.squeeze)),
        blade_rotation_rad=_numbers(pupil.blade_rotation_rad),
        blade_curvature=_numbers(pupil.blade_curvature),
        blades=pupil.blades if bladed else 0,
    )


def lens_blur(
    entry: Entry, f_number: float, measured_focus_mm: float | None
) -> LensBlur:
    """The blur of an entry that has one, at an f-number and the entry's focus.

    Parameters
    ----------
    measured_focus_mm : Focus distance that the entry's numbers hold for; None when
        nobody said: then the lens counts as focused at the reference distance, and is
        sharp where the entry's focus says, if it says so.
    """
    blur, projection = entry.blur, entry.projection
    if blur is None:
        raise ValueError("the entry has no blur")
    reference = _numbers(blur.reference_distance_mm)
    held_mm = measured_focus_mm or blur.reference_distance_mm
    focus_mm = entry.focus_distance_mm or held_mm
    first_order = first_order_of(
        _numbers(projection.principal_distance_mm),
        _numbers(blur.pupil_magnification),
        _numbers(projection.entrance_pupil_offset_mm),
        _numbers(held_mm),
    )
    # A focus that nobody stated is what the offset measures; a stated one replaces it.
    stated = measured_focus_mm is None and entry.focus_distance_mm is not None
    beyond = 0.0 if stated else blur.focus_offset_mm
    nominal = rim_sine(first_order, _numbers(f_number), reference)
    ratio = radius_ratio(blur.stops, f_number) / blur.reference_sine
    bladed = f_number > ROUND_SLACK * blur.round_f_number
    along_y = section_ratio(entry) if blur.beyond_offset_mm is not None else 1.0
    defocus = defocus_mm(first_order, _numbers(focus_mm), reference)
    return LensBlur(
        aberration=aberration_of(blur),
        pupil=pupil_of(blur.pupil, bladed=bladed),
        first_order=first_order,
        reference_distance_mm=reference,
        defocus_mm=along_y * defocus + beyond,
        stop_radius=nominal * ratio,
        bands=bands(3, blur.band_centres_nm, blur.band_widths_nm),
        beyond_mm=None
        if blur.beyond_offset_mm is None
        else _numbers(blur.beyond_offset_mm),
    )


def section_ratio(entry: Entry) -> float:
    """Defocus of the section along y over that of the mean of both sections.

    First-order optics is that of the geometric mean of both principal distances, of
    which defocus goes as the square.
    """
    distortion = entry.distortion
    return distortion.squeeze ** math.cos(2 * distortion.squeeze_axis_rad)


def _terms_of(aberration: Aberration) -> tuple[blocks.AberrationTerm, ...]:
    """Every term once; one that is there for its colour alone has 0 um."""
    um = dict(zip(aberration.terms, _floats(aberration.coefficients_um), strict=True))
    rows = np.asarray(aberration.colour_um, float).T.tolist()
    by_colour = dict(zip(aberration.colour_terms, rows, strict=True))
    return tuple(
        blocks.AberrationTerm(
            degree=term.degree,
            order=term.order_u,
            field_degree=term.field_degree,
            field_order=term.field_order,
            part=term.part,
            um=um.get(term, 0.0),
            um_by_colour=tuple(by_colour.get(term, ())),
        )
        for term in dict.fromkeys((*aberration.terms, *aberration.colour_terms))
    )


def _pupil_block(pupil: Pupil) -> blocks.Pupil:
    rims = zip(np.asarray(pupil.rim_shift), np.asarray(pupil.rim_radius), strict=True)
    along, across = np.asarray(pupil.stretch)
    return blocks.Pupil(
        rims=tuple(blocks.Rim(_pair(shift), _pair(radius)) for shift, radius in rims),
        stop_shift=_pair(pupil.stop_shift),
        stretch_along=_pair(along),
        stretch_across=_pair(across),
        squeeze=math.exp(float(pupil.squeeze)),
        blades=round(float(pupil.blades)),
        blade_rotation_rad=float(pupil.blade_rotation_rad),
        blade_curvature=float(pupil.blade_curvature),
    )


def _term(term: blocks.AberrationTerm) -> Term:
    return Term(term.degree, term.order, term.field_degree, term.field_order, term.part)


def _numbers(values):
    return jnp.asarray(np.asarray(values, float))


def _floats(values) -> list[float]:
    return np.asarray(values, float).tolist()


def _pair(values) -> tuple[float, float]:
    first, second = _floats(values)
    return first, second


def _three(values) -> tuple[float, float, float]:
    r, g, b = _floats(values)
    return r, g, b
