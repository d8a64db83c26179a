"""Fall-off polynomials on a common footing, so that they can be averaged.

A fall-off is a Bernstein polynomial of the squared radius with b_0 = 0
(`lensfit.optics.falloff`), over the radius that was photographed. Raising its degree
and cutting its interval short are exact, and neither makes rising control values fall
(G. Farin, Curves and Surfaces for CAGD, 2002, on Bezier curves).
"""

from itertools import pairwise
from math import comb

import msgspec

from lensfit.preset.blocks import FallOff

Control = tuple[float, ...]


def on_common_footing(first: FallOff, second: FallOff) -> tuple[FallOff, FallOff]:
    """Both with the smaller of their radii and the larger of their degrees."""
    radius_mm = min(first.valid_radius_mm, second.valid_radius_mm)
    degree = max(len(first.g), len(second.g))
    return _with(first, radius_mm, degree), _with(second, radius_mm, degree)


def _with(block: FallOff, radius_mm: float, degree: int) -> FallOff:
    fraction = (radius_mm / block.valid_radius_mm) ** 2

    def change(control: Control) -> Control:
        return _raised(_shortened(control, fraction), degree)

    return msgspec.structs.replace(
        block,
        valid_radius_mm=radius_mm,
        r=change(block.r),
        g=change(block.g),
        b=change(block.b),
    )


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
