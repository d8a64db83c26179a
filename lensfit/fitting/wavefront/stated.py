"""Statements about a shoot as observations of the wavefront beside its dots.

The width of a disc does not determine whether a wide pupil or a large defocus made it
so: with a pupil smaller by a tenth, a lens that is out of focus by a tenth more draws
the same dots. Two statements separate the two:

- the widest f-number gives the width of the beam on the axis. That is the unit of the
  pupil, so no clipping aperture cuts that beam; an error of the f-number first goes
  into defocus, from which stated distances take it back (`stated_beam`);
- focus and chart distances give how far the photographs of a shoot lie apart along the
  axis. Each has an error of its own, and all have one in proportion, as the square of
  the focal length and the f-number do; a lens whose field curves, or whose focus scale
  is off, shifts all by a common unknown amount.

That there is a photograph is a third: light came through to the corner of the frame, so
that stop and rims leave an opening there.

All are residuals in units of their own standard deviations. Distances that contradict
the dots are mistaken, not inaccurate: they lose weight as 1 / (1 + (r / 3)^2), r rms.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lensfit.fitting.levenberg import Quadratic
from lensfit.fitting.wavefront.dots import Dots
from lensfit.fitting.wavefront.gather import Beam, DotData
from lensfit.fitting.wavefront.parameters import (
    Layout,
    Scale,
    aberration_of,
    pupil_of,
)
from lensfit.fitting.wavefront.start import defocus_deviation_mm, stated_defocus_mm
from lensfit.optics.aberration import landing_and_jacobian_mm, local_wavefront
from lensfit.optics.paraxial import rim_sine
from lensfit.optics.pupil import width_along_field
from lensfit.programs import kept_program

_TOGETHER = 0.5
"""Standard deviation of the common shift, in units of the largest defocus."""
_CAUCHY_SCALE = 3.0
_FIRST_ORDER = 0.02
"""Of first-order defocus between two focus distances of a lens whose elements move
against each other, as a share: .003 to .04 for published lenses and zooms."""
_RAYS = 8
_CUT = 0.01
"""Share of the pupil's radius that a rim may cut on the axis: small, but with a slope
that a solve can follow."""
_CORNER, _LEAST_OPENING = 1.1, 0.1
"""Field radii to a frame's furthest corner, of a lens shifted against it and at its
shortest; the opening there in the radii of a stop: a twentieth of its width."""


class Statements(NamedTuple):
    """Statements, ready for a solve.

    Attributes
    ----------
    defocus_mm : Of every group.
    rows : Of the differences from it, so that they are independent and of unit
        deviation; zero where nothing was stated.
    stop_radii : Of the widest and the narrowest stop, in radii of the widest.
    """

    defocus_mm: Float[Array, " groups"]
    rows: Float[Array, "groups groups"]
    stop_radii: Float[Array, "2"]


def f_number_statement(dot_data: DotData, layout: Layout) -> Statements:
    """The f-number alone."""
    nothing = jnp.zeros((layout.groups, layout.groups))
    radii = jnp.asarray([1.0, float(np.min(dot_data.dots.stop_radius))])
    return Statements(jnp.zeros(layout.groups), nothing, radii)


def f_number_and_focus_statements(
    dot_data: DotData, layout: Layout, defocus_mm: Float[np.ndarray, " groups"]
) -> Statements:
    """The f-number, and distances weighted by how well they agree with a defocus that
    was fitted to dots."""
    found = f_number_statement(dot_data, layout)
    stated_mm = stated_defocus_mm(dot_data)
    known = np.flatnonzero(np.isfinite(stated_mm))
    if not len(known):
        return found
    known_mm, widths = stated_mm[known], dot_data.widths
    in_proportion = np.hypot(2 * widths.focal_length, widths.f_number)
    covariance = (
        np.diag(defocus_deviation_mm(dot_data)[known] ** 2)
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
    parameters: Float[Array, " parameters"], statements: Statements, layout: Layout
) -> Quadratic:
    """Of all statements, at these parameters."""

    def residual(parameters: Array) -> Array:
        part = {name: parameters[where] for name, where in layout.blocks.items()}
        off = statements.rows @ (part["defocus"] - statements.defocus_mm)
        cut = jnp.minimum(part["rim_radius"][::2] - 1, 0.0) / _CUT
        pupil = pupil_of(parameters[layout.pupil_parameters], layout, jnp.zeros(()))
        corner = jnp.array([_CORNER, 0.0])
        radii = statements.stop_radii
        left = jax.vmap(width_along_field, (None, 0, None))(corner, radii, pupil)
        closed = jnp.minimum(left / radii - _LEAST_OPENING, 0.0) / _CUT
        return jnp.concatenate([off, cut, closed])

    left, slopes = residual(parameters), jax.jacfwd(residual)(parameters)
    return Quadratic(slopes.T @ slopes, slopes.T @ left, left @ left)


def stated_beam(
    parameters: Float[np.ndarray, " parameters"], dot_data: DotData, layout: Layout
) -> Beam:
    """How wide the beam through a stop is, of f-numbers and distances together.

    Stated distances give defocus without the f-number, so defocus that was fitted with
    the beam of the f-number is as much larger as the beam is wider. The estimate lies
    between that and 1, by the widths of both. How a beam changes while a lens is
    focused, by elements in front of the stop or behind it, is not known: half of what
    moving the whole lens does counts as a width too. Distances that contradict the
    f-number lose weight.

    Parameters
    ----------
    parameters : Fitted with the beam that the f-number says.
    """
    at_mm = jnp.asarray(dot_data.reference_distance_mm)
    bellows = 0.5 / rim_sine(dot_data.first_order, jnp.ones(()), at_mm)
    of_beam = float(np.hypot(dot_data.widths.f_number, np.log(float(bellows)) / 2))
    stated_mm, width_mm = stated_defocus_mm(dot_data), defocus_deviation_mm(dot_data)
    known = np.isfinite(stated_mm)
    if known.sum() < 2:
        return Beam(1.0, of_beam)
    group = np.asarray(dot_data.dots.group)
    one_of_each = [int(np.argmax(group == k)) for k in np.flatnonzero(known)]
    dots = jax.tree.map(lambda a: jnp.asarray(a[one_of_each]), dot_data.dots)
    numbers = jnp.asarray(parameters)
    found = _defocus_when_sharpest_mm(numbers, dots, dot_data.scale, layout)
    x, y, width_mm = stated_mm[known], np.asarray(found), width_mm[known]
    weight = 1 / (width_mm**2 + (_FIRST_ORDER * np.abs(x).max()) ** 2)
    x = x - np.average(x, weights=weight)  # the shift that all have in common
    information = float(np.sum(weight * x * x))
    slope = float(np.sum(weight * x * y)) / information if information else 0.0
    if slope <= 0:
        return Beam(1.0, of_beam)
    of_defocus = np.hypot(information**-0.5 / slope, _FIRST_ORDER)
    off = np.log(slope) / np.hypot(of_beam, of_defocus)
    of_defocus *= np.hypot(1.0, off / _CAUCHY_SCALE)
    gain = of_beam**2 / (of_beam**2 + of_defocus**2)
    return Beam(float(np.exp(gain * np.log(slope))), float(gain**0.5 * of_defocus))


@kept_program(static_argnames=("layout",))
def _defocus_when_sharpest_mm(
    parameters: Float[Array, " parameters"], groups: Dots, scale: Scale, layout: Layout
) -> Float[Array, " groups"]:
    """By how much every group's axial image along y misses its sharpest plane, but for
    a shift that all have in common: as first-order defocus of an object there.

    That plane is where rays spread least, and where a photographer focuses. Rays that
    miss it land in proportion to their tangents, those of an object at another distance
    to their sines (`optics.depth`): of a fast lens a tenth less at the rim.

    Parameters
    ----------
    groups : A dot of each.
    """
    square, weight = np.polynomial.legendre.leggauss(_RAYS)
    reach = np.sqrt((square + 1) / 2)
    reach, weight = np.append(reach, -reach), np.append(weight, weight)

    def of_group(defocus_mm: Array, ratio: Array, focus: Array) -> Array:
        aberration = aberration_of(parameters, layout, scale, ratio, focus)
        local = local_wavefront(jnp.zeros(2), jnp.zeros(()), aberration)

        def landed_mm(reach: Array) -> tuple[Array, Array]:
            u = jnp.stack([jnp.zeros(()), reach])

            def at(defocus_mm: Array) -> Array:
                return landing_and_jacobian_mm(u, defocus_mm, local)[0][1]

            return jax.jvp(at, (defocus_mm,), (jnp.ones(()),))

        landing_mm, per_mm = jax.vmap(landed_mm)(jnp.asarray(reach))
        sine = reach * aberration.reference_sine
        return jnp.sum(weight * per_mm * landing_mm) / jnp.sum(weight * per_mm * sine)

    defocus_mm = parameters[layout.blocks["defocus"]][groups.group]
    ratio = groups.principal_distance_ratio
    return jax.vmap(of_group)(defocus_mm, ratio, groups.focus)
