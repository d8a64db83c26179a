"""What was stated of a shoot, as evidence of the wavefront beside its dots.

A disc says how wide it is, not whether a wide opening or a far focus made it so: opened
by a tenth less, a lens that is out of focus by a tenth more draws the same dots. Two
statements tell the two apart:

- the widest f-number says how wide the beam on the axis is. That is the unit of the
  opening, so no rim cuts that beam; what the f-number is wrong by is borne by defocus;
- focus and chart distances say how far the photographs of a shoot lie apart along the
  axis. They err each by itself, as distances do, and all in proportion, as the square
  of the focal length and the f-number do; a lens whose field curves, or whose marks are
  off, has all moved together by an amount that nobody knows.

Both are residuals in units of their own deviations. Distances that contradict the dots
are mistaken, not inaccurate: they lose weight as 1 / (1 + (r / 3)^2), r rms.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lensfit.fitting.levenberg import Quadratic
from lensfit.fitting.wavefront.gather import Gathered
from lensfit.fitting.wavefront.parameters import Layout
from lensfit.fitting.wavefront.start import defocus_deviation_mm, stated_defocus_mm

_TOGETHER = 0.5
"""Deviation of what all are moved by, in the largest defocus."""
_CAUCHY_SCALE = 3.0
_CUT = 0.01
"""Of the opening's radius that a rim may take on the axis: small, and yet a slope that
a solve can follow."""


class Stated(NamedTuple):
    """Statements, ready for a solve.

    Attributes
    ----------
    defocus_mm : Of every group.
    rows : Of the differences from it, so that they are independent and of unit
        deviation; zero where nothing was stated.
    """

    defocus_mm: Float[Array, " groups"]
    rows: Float[Array, "groups groups"]


def stated_opening(layout: Layout) -> Stated:
    """The f-number alone."""
    nothing = jnp.zeros((layout.groups, layout.groups))
    return Stated(jnp.zeros(layout.groups), nothing)


def stated_opening_and_focus(
    gathered: Gathered, layout: Layout, defocus_mm: Float[np.ndarray, " groups"]
) -> Stated:
    """The f-number, and distances as far as they suit a defocus that dots showed."""
    found = stated_opening(layout)
    stated_mm = stated_defocus_mm(gathered)
    known = np.flatnonzero(np.isfinite(stated_mm))
    if len(known) < 2:
        return found
    known_mm, widths = stated_mm[known], gathered.widths
    in_proportion = np.hypot(2 * widths.focal_length, widths.f_number)
    covariance = (
        np.diag(defocus_deviation_mm(gathered)[known] ** 2)
        + in_proportion**2 * np.outer(known_mm, known_mm)
        + (_TOGETHER * np.abs(known_mm).max()) ** 2
    )
    rows = np.linalg.inv(np.linalg.cholesky(covariance))
    off = rows @ (defocus_mm[known] - known_mm)
    weight = 1 / (1 + np.mean(off**2) / _CAUCHY_SCALE**2)
    every = np.zeros((layout.groups, layout.groups))
    every[np.ix_(known, known)] = np.sqrt(weight) * rows
    every_mm = np.zeros(layout.groups)
    every_mm[known] = known_mm
    return found._replace(defocus_mm=jnp.asarray(every_mm), rows=jnp.asarray(every))


def stated_equations(
    parameters: Float[Array, " parameters"], stated: Stated, layout: Layout
) -> Quadratic:
    """Of all statements, at these parameters."""

    def residual(parameters: Array) -> Array:
        part = {name: parameters[where] for name, where in layout.blocks.items()}
        off = stated.rows @ (part["defocus"] - stated.defocus_mm)
        cut = jnp.minimum(part["rim_radius"][::2] - 1, 0.0) / _CUT
        return jnp.concatenate([off, cut])

    left, slopes = residual(parameters), jax.jacfwd(residual)(parameters)
    return Quadratic(slopes.T @ slopes, slopes.T @ left, left @ left)
