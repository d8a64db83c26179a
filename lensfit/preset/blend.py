"""Weighted mean of two blocks of numbers of the same model.

Numbers are interpolated linearly, focus distances as dioptres. Coefficients of a term
that one neighbour lacks are zero there, so that a term fades in; what defines the terms
(base projection, reference radius, degree and box of a free field) must agree.
The photographed radius, beyond which terms are extrapolated more simply, is
interpolated like a number: with the smaller of both, the map would jump where a
sequence leaves an entry. The squeeze is interpolated as the logarithmic strain of
`lensfit.optics.distortion`, which has no jump where its axis turns by half a turn.
Descriptions of the measurement (terms, quality) come from the nearer neighbour.
Standard deviations are left out, since the error between two measured states is
unknown.

Blur that one neighbour lacks is the other's. Terms of the aberration function are
matched by their identity; one that a neighbour lacks is zero there, and so fades in.
Rims are matched by their order; one that a neighbour lacks is too wide to clip there.
The pupil's squeeze is interpolated by its logarithm, the reference distance in
dioptres, stops as functions of the f-number, all other numbers linearly. Blades, and
the list of assumed values, come from the nearer neighbour; if both have the same number
of blades, their rotation and roundness are interpolated.

Fall-offs are first brought to one degree and radius. A fall-off is a Bernstein
polynomial of the squared radius with b_0 = 0 (`lensfit.optics.falloff`), over the
radius it is stated for. Raising its degree and cutting its interval short are exact,
and neither makes rising control values fall (G. Farin, Curves and Surfaces for CAGD,
2002, on Bezier curves). The common radius is interpolated with the weight, so that
nothing jumps where a sequence leaves an entry. The fall-off with the smaller radius is
extended beyond it with its last slope, and interpolated there by a polynomial through
enough of its values.
"""

import math
from functools import cache
from itertools import pairwise, zip_longest
from math import comb
from typing import Any, TypeVar

import msgspec
import numpy as np
from jaxtyping import Float

from lensfit.errors import PresetError
from lensfit.optics.bernstein import bernstein, continued_bernstein
from lensfit.preset.blocks import (
    AberrationTerm,
    Blur,
    Distortion,
    FallOff,
    Pair,
    Pupil,
    Rim,
)
from lensfit.preset.photographed_stops import blended_stops
from lensfit.units import MILLIMETRES_PER_METRE, dioptres_from_mm


def interpolated_number(first: float, second: float, weight: float) -> float:
    """`first` at weight 0, `second` at weight 1, linear between."""
    return (1 - weight) * first + weight * second


def blended_ratio(first: float, second: float, weight: float) -> float:
    """Linear in the logarithm."""
    return math.exp(interpolated_number(math.log(first), math.log(second), weight))


def blended_distance_mm(first: float, second: float, weight: float) -> float:
    """Linear in dioptres; either may be infinite."""
    dioptres = interpolated_number(
        dioptres_from_mm(first), dioptres_from_mm(second), weight
    )
    return MILLIMETRES_PER_METRE / dioptres if dioptres else math.inf


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
        name: interpolated_number(getattr(first, name), getattr(second, name), weight)
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
    return interpolated_number(low, high, weight)


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
        um=interpolated_number(first.um, second.um, weight),
        um_by_colour=_each(first.um_by_colour, second.um_by_colour, weight),
    )


def _pupil(first: Pupil, second: Pupil, weight: float) -> Pupil:
    nearer = first if weight < 0.5 else second
    turn, bend = nearer.blade_rotation_rad, nearer.blade_curvature
    if first.blades == second.blades:
        turn = interpolated_number(
            first.blade_rotation_rad, second.blade_rotation_rad, weight
        )
        bend = interpolated_number(
            first.blade_curvature, second.blade_curvature, weight
        )
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
    return interpolated_number(first[0], second[0], weight), interpolated_number(
        first[1], second[1], weight
    )


def _each(
    first: tuple[float, ...], second: tuple[float, ...], weight: float
) -> tuple[float, ...]:
    """Of lists whose missing numbers are zero."""
    pairs = zip_longest(first, second, fillvalue=0.0)
    return tuple(interpolated_number(a, b, weight) for a, b in pairs)


Block = TypeVar("Block", bound=msgspec.Struct)

_MUST_AGREE = {"base", "reference_radius_mm"}
_PHOTOGRAPHED = {"valid_radius", "chart_distance_mm"}
"""What defines the terms, but may differ: it moves from one to the other."""
_LARGER = {"degree"}
"""Coefficients of the degrees that one of the two lacks are zero there."""
_FROM_THE_NEARER = {"assumed", "terms", "quality"}
_UNKNOWN_BETWEEN = {"covariance"}


def blend(first: Block, second: Block, weight: float) -> Block:
    """`first` at weight 0, `second` at weight 1, linear between.

    Raises
    ------
    PresetError : The two are of different models.
    """
    if weight in (0.0, 1.0):
        return first if weight == 0.0 else second
    if isinstance(first, Blur) and isinstance(second, Blur):
        return blended_blur(first, second, weight)
    if isinstance(first, FallOff) and isinstance(second, FallOff):
        first, second = matched_fall_offs(first, second, weight)
    changes = {
        name: _value(name, getattr(first, name), getattr(second, name), weight)
        for name in first.__struct_fields__
    }
    if isinstance(first, Distortion) and isinstance(second, Distortion):
        changes |= _squeeze(first, second, weight)
        if first.field or second.field:
            _common_value("valid_box", first.valid_box, second.valid_box)
    return msgspec.structs.replace(first, **changes)


def _value(name: str, first: Any, second: Any, weight: float) -> Any:
    if name in _UNKNOWN_BETWEEN:
        return None
    if name in _FROM_THE_NEARER:
        return first if weight < 0.5 else second
    if name in _MUST_AGREE:
        return _common_value(name, first, second)
    if name in _LARGER:
        return max(first, second)
    if first is None and second is None:
        return None
    if name == "f_number" and (first is None or second is None):
        return None
    if name == "focus_distance_mm":
        return _focus(first, second, weight)
    if name == "predicted":
        return first or second
    if name == "blur" and (first is None or second is None):
        return first or second  # blur that was not measured is not zero
    if first is None or second is None:
        # Every number of an optional block is a coefficient that is zero without it.
        return (
            _scaled_numbers(second, weight)
            if first is None
            else _scaled_numbers(first, 1 - weight)
        )
    if isinstance(first, msgspec.Struct):
        return blend(first, second, weight)
    if name == "fall_off" and len(first) != len(second):
        # Fall-off that was not measured is not zero.
        return tuple(_without_deviations(one) for one in first or second)
    if isinstance(first, tuple):
        empty = None if first and isinstance(first[0], msgspec.Struct) else 0.0
        pairs = zip_longest(first, second, fillvalue=empty)
        return tuple(_value("", a, b, weight) for a, b in pairs)
    return (1 - weight) * first + weight * second


def _common_value(name: str, first: Any, second: Any) -> Any:
    if first != second:
        raise PresetError(
            f"neighbouring entries differ in {name} ({first} and {second}) and cannot "
            "be interpolated",
            remedy="calibrate them in one run, or request a measured state",
        )
    return first


def _focus(first: float | None, second: float | None, weight: float) -> float | None:
    if first is None or second is None:
        return None
    return blended_distance_mm(first, second, weight)


def _scaled_numbers(value: Any, factor: float) -> Any:
    """`value` with every number but the definition of its terms multiplied."""
    if isinstance(value, msgspec.Struct):
        changes = {
            name: _scaled_numbers(getattr(value, name), factor)
            for name in value.__struct_fields__
            if name not in _MUST_AGREE | _PHOTOGRAPHED | _LARGER | _UNKNOWN_BETWEEN
        }
        return msgspec.structs.replace(_without_deviations(value), **changes)
    if isinstance(value, tuple):
        return tuple(_scaled_numbers(item, factor) for item in value)
    return value * factor


def _without_deviations(block: Block) -> Block:
    changes = {n: None for n in block.__struct_fields__ if n in _UNKNOWN_BETWEEN}
    return msgspec.structs.replace(block, **changes)


def _squeeze(first: Distortion, second: Distortion, weight: float) -> dict[str, float]:
    """Mean of ln(squeeze) (cos 2a, sin 2a): the axis `a` has no sense of direction."""
    strain = [0.0, 0.0]
    for block, share in ((first, 1 - weight), (second, weight)):
        size, angle = share * math.log(block.squeeze), 2 * block.squeeze_axis_rad
        strain[0] += size * math.cos(angle)
        strain[1] += size * math.sin(angle)
    size = math.hypot(*strain)
    axis = math.atan2(strain[1], strain[0]) / 2 if size else 0.0
    return {"squeeze": math.exp(size), "squeeze_axis_rad": axis}


Control = tuple[float, ...]
_DEGREE_BEYOND = 8
"""Of the polynomial that follows a fall-off over the bend at its radius."""


def matched_fall_offs(
    first: FallOff, second: FallOff, weight: float
) -> tuple[FallOff, FallOff]:
    """Both over a radius between theirs, and of one degree.

    Parameters
    ----------
    weight : Share of the second, 0 to 1.
    """
    a_mm, b_mm = first.valid_radius_mm, second.valid_radius_mm
    radius_mm = (1 - weight) * a_mm + weight * b_mm
    degree = max(len(first.g), len(second.g))
    if a_mm != b_mm:
        degree = max(degree, _DEGREE_BEYOND)
    return _with(first, radius_mm, degree), _with(second, radius_mm, degree)


def _with(block: FallOff, radius_mm: float, degree: int) -> FallOff:
    fraction = (radius_mm / block.valid_radius_mm) ** 2

    def change(control: Control) -> Control:
        if fraction > 1.0:
            return _extended_control(control, fraction, degree)
        return _control_of_degree(_control_of_fraction(control, fraction), degree)

    return msgspec.structs.replace(
        block,
        valid_radius_mm=radius_mm,
        r=change(block.r),
        g=change(block.g),
        b=change(block.b),
    )


def _extended_control(control: Control, fraction: float, degree: int) -> Control:
    """Of the function over [0, fraction], where it is a straight line from 1 on."""
    nodes, inverse = _through_values(degree)
    loss = continued_bernstein(fraction * nodes, len(control)) @ np.array(control)
    found = inverse @ loss
    return tuple(np.maximum.accumulate(np.maximum(found, 0.0)).tolist())


@cache
def _through_values(
    degree: int,
) -> tuple[Float[np.ndarray, " nodes"], Float[np.ndarray, "degree nodes"]]:
    """Places, and the matrix that makes control values of the values there."""
    nodes = (1 - np.cos(np.pi * np.arange(1, degree + 1) / degree)) / 2
    return nodes, np.linalg.inv(bernstein(nodes, degree))


def _control_of_fraction(control: Control, fraction: float) -> Control:
    """The same polynomial with [0, fraction] as its unit interval (de Casteljau)."""
    if fraction == 1.0:
        return control
    row = [0.0, *control]
    left = [row[0]]
    while len(row) > 1:
        row = [(1 - fraction) * a + fraction * b for a, b in pairwise(row)]
        left.append(row[0])
    return tuple(left[1:])


def _control_of_degree(control: Control, degree: int) -> Control:
    """The same polynomial with the control values of a higher degree."""
    low = [0.0, *control]
    n, up = len(control), degree - len(control)
    if up == 0:
        return control
    return tuple(
        sum(
            comb(n, j) * comb(up, i - j) / comb(degree, i) * low[j]
            for j in range(max(0, i - up), min(n, i) + 1)
        )
        for i in range(1, degree + 1)
    )
