"""Weighted mean of the blurs of two lens states.

Terms of the aberration function are matched by their identity; one that a neighbour
lacks is zero there, and so fades in. Rims are matched by their order; one that a
neighbour lacks is too wide to clip there. The pupil's squeeze is interpolated by its
logarithm, the reference distance in dioptres, stops as functions of the f-number, all
other numbers linearly. Blades, and the list of assumed values, come from the nearer
neighbour; if both have the same number of blades, their rotation and roundness are
interpolated.
"""

from itertools import zip_longest

import msgspec

from lensfit.preset.blend_numbers import blended, blended_distance_mm, blended_ratio
from lensfit.preset.blocks import Pair
from lensfit.preset.blur_blocks import AberrationTerm, Blur, Pupil, Rim
from lensfit.preset.photographed_stops import blended_stops

_LINEAR = (
    "field_radius_mm",
    "reference_sine",
    "exit_pupil_distance_mm",
    "chief_bend",
    "pupil_magnification",
    "focus_offset_mm",
    "round_f_number",
)
_TOO_WIDE = (3.0, 0.0)
"""Radius of a rim that does not clip, in radii of the reference stop."""


def blended_blur(first: Blur, second: Blur, weight: float) -> Blur:
    """`first` at weight 0, `second` at weight 1, smooth between."""
    linear = {
        name: blended(getattr(first, name), getattr(second, name), weight)
        for name in _LINEAR
    }
    return msgspec.structs.replace(
        first if weight < 0.5 else second,
        aberrations=_terms(first.aberrations, second.aberrations, weight),
        reference_distance_mm=blended_distance_mm(
            first.reference_distance_mm, second.reference_distance_mm, weight
        ),
        pupil=_pupil(first.pupil, second.pupil, weight),
        stops=blended_stops(first.stops, second.stops, weight),
        beyond_offset_mm=_beyond(first, second, weight),
        band_centres_nm=_each(first.band_centres_nm, second.band_centres_nm, weight),
        band_widths_nm=_each(first.band_widths_nm, second.band_widths_nm, weight),
        **linear,
    )


def _beyond(first: Blur, second: Blur, weight: float) -> float | None:
    found = [first.beyond_offset_mm, second.beyond_offset_mm]
    if found == [None, None]:
        return None
    low, high = (offset or 0.0 for offset in found)
    return blended(low, high, weight)


def _terms(
    first: tuple[AberrationTerm, ...], second: tuple[AberrationTerm, ...], weight: float
) -> tuple[AberrationTerm, ...]:
    low, high = ({_identity(t): t for t in terms} for terms in (first, second))
    return tuple(
        _term(low.get(which, which), high.get(which, which), weight)
        for which in {**low, **high}
    )


def _identity(term: AberrationTerm) -> AberrationTerm:
    """The same term with no coefficient."""
    return msgspec.structs.replace(term, um=0.0, um_by_colour=())


def _term(
    first: AberrationTerm, second: AberrationTerm, weight: float
) -> AberrationTerm:
    return msgspec.structs.replace(
        first,
        um=blended(first.um, second.um, weight),
        um_by_colour=_each(first.um_by_colour, second.um_by_colour, weight),
    )


def _pupil(first: Pupil, second: Pupil, weight: float) -> Pupil:
    nearer = first if weight < 0.5 else second
    turn, bend = nearer.blade_rotation_rad, nearer.blade_curvature
    if first.blades == second.blades:
        turn = blended(first.blade_rotation_rad, second.blade_rotation_rad, weight)
        bend = blended(first.blade_curvature, second.blade_curvature, weight)
    return Pupil(
        rims=tuple(
            _rim(a or _too_wide(b), b or _too_wide(a), weight)
            for a, b in zip_longest(first.rims, second.rims)
        ),
        stop_shift=_pair(first.stop_shift, second.stop_shift, weight),
        stretch_along=_pair(first.stretch_along, second.stretch_along, weight),
        stretch_across=_pair(first.stretch_across, second.stretch_across, weight),
        squeeze=blended_ratio(first.squeeze, second.squeeze, weight),
        blades=nearer.blades,
        blade_rotation_rad=turn,
        blade_curvature=bend,
    )


def _too_wide(rim: Rim) -> Rim:
    return Rim(rim.shift, _TOO_WIDE)


def _rim(first: Rim, second: Rim, weight: float) -> Rim:
    return Rim(
        _pair(first.shift, second.shift, weight),
        _pair(first.radius, second.radius, weight),
    )


def _pair(first: Pair, second: Pair, weight: float) -> Pair:
    return blended(first[0], second[0], weight), blended(first[1], second[1], weight)


def _each(
    first: tuple[float, ...], second: tuple[float, ...], weight: float
) -> tuple[float, ...]:
    """Of lists whose missing numbers are zero."""
    pairs = zip_longest(first, second, fillvalue=0.0)
    return tuple(blended(a, b, weight) for a, b in pairs)
