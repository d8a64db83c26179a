"""Weighted mean of two blocks of numbers of the same model.

Numbers are interpolated linearly, focus distances as dioptres. Coefficients of a term
that one neighbour lacks are zero there, so that a term fades in; what defines the terms
(base projection, reference radius, degree and box of a free field) must agree.
The photographed radius, beyond
which terms are extrapolated more simply, is interpolated like a number: with the
smaller of both, the map would jump where a sequence leaves an entry. The squeeze is
interpolated as the logarithmic strain of `lensfit.optics.distortion`, which has no jump
where its axis turns by half a turn. Blur that one neighbour lacks is the other's
(`lensfit.preset.blend_blur` has the rules for the rest). Descriptions of the
measurement (terms, quality) come from the nearer neighbour. Standard deviations are
left out, since the error between two measured states is unknown.

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
from lensfit.preset.blend_blur import blended_blur
from lensfit.preset.blend_numbers import blended_distance_mm
from lensfit.preset.blocks import Distortion, FallOff
from lensfit.preset.blur_blocks import Blur

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
            _agreed("valid_box", first.valid_box, second.valid_box)
    return msgspec.structs.replace(first, **changes)


def _value(name: str, first: Any, second: Any, weight: float) -> Any:
    if name in _UNKNOWN_BETWEEN:
        return None
    if name in _FROM_THE_NEARER:
        return first if weight < 0.5 else second
    if name in _MUST_AGREE:
        return _agreed(name, first, second)
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
        return _scaled(second, weight) if first is None else _scaled(first, 1 - weight)
    if isinstance(first, msgspec.Struct):
        return blend(first, second, weight)
    if name == "fall_off" and len(first) != len(second):
        # Fall-off that was not measured is not zero.
        return tuple(_of_unknown_deviation(one) for one in first or second)
    if isinstance(first, tuple):
        empty = None if first and isinstance(first[0], msgspec.Struct) else 0.0
        pairs = zip_longest(first, second, fillvalue=empty)
        return tuple(_value("", a, b, weight) for a, b in pairs)
    return (1 - weight) * first + weight * second


def _agreed(name: str, first: Any, second: Any) -> Any:
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


def _scaled(value: Any, factor: float) -> Any:
    """`value` with every number but the definition of its terms multiplied."""
    if isinstance(value, msgspec.Struct):
        changes = {
            name: _scaled(getattr(value, name), factor)
            for name in value.__struct_fields__
            if name not in _MUST_AGREE | _PHOTOGRAPHED | _LARGER | _UNKNOWN_BETWEEN
        }
        return msgspec.structs.replace(_of_unknown_deviation(value), **changes)
    if isinstance(value, tuple):
        return tuple(_scaled(item, factor) for item in value)
    return value * factor


def _of_unknown_deviation(block: Block) -> Block:
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
            return _followed(control, fraction, degree)
        return _raised(_shortened(control, fraction), degree)

    return msgspec.structs.replace(
        block,
        valid_radius_mm=radius_mm,
        r=change(block.r),
        g=change(block.g),
        b=change(block.b),
    )


def _followed(control: Control, fraction: float, degree: int) -> Control:
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


def _shortened(control: Control, fraction: float) -> Control:
    """The same polynomial with [0, fraction] as its unit interval (de Casteljau)."""
    if fraction == 1.0:
        return control
    row = [0.0, *control]
    left = [row[0]]
    while len(row) > 1:
        row = [(1 - fraction) * a + fraction * b for a, b in pairwise(row)]
        left.append(row[0])
    return tuple(left[1:])


def _raised(control: Control, degree: int) -> Control:
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
