"""Convert fall-off polynomials to a common degree and radius for averaging.

A fall-off is a Bernstein polynomial of the squared radius with b_0 = 0
(`lensfit.optics.falloff`), over the radius it is stated for. Raising its degree
and cutting its interval short are exact, and neither makes rising control values fall
(G. Farin, Curves and Surfaces for CAGD, 2002, on Bezier curves). The common radius is
interpolated with the weight, so that nothing jumps where a sequence leaves an entry.
The fall-off with the smaller radius is extended beyond it with its last slope, and
interpolated there by a polynomial through enough of its values.
"""

from functools import cache
from itertools import pairwise
from math import comb

import msgspec
import numpy as np
from jaxtyping import Float

from lensfit.optics.bernstein import bernstein, continued_bernstein
from lensfit.preset.blocks import FallOff

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
