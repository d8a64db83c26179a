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

How light falls off over the frame is a third: the area of the opening in direction
cosines is the relative illumination, whatever the lens (`optics.pupil`). Without it the
width of the beam off the axis is known no better than the defocus there, and a field
that curves while focusing draws the same dots as a pupil that narrows. So it counts
where several focus distances were photographed. A chart's own lighting is the same at
every f-number.

That there is a photograph is a fourth: light came through to the corner of the frame,
so that stop and rims leave an opening there.

All are residuals in units of their own standard deviations. Distances and fall-off that
contradict the dots are mistaken, not inaccurate: they lose weight as
1 / (1 + (r / 3)^2), r rms.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from lensfit.fitting.levenberg import Quadratic
from lensfit.fitting.wavefront.dot_arrays import Dots
from lensfit.fitting.wavefront.dot_data import (
    WIDE_OPEN,
    Beam,
    DotData,
    PhotographedFallOff,
)
from lensfit.fitting.wavefront.parameters import (
    Layout,
    Scale,
    aberration_of,
    fitted_stop_radius,
    pupil_of,
)
from lensfit.fitting.wavefront.start_values import (
    defocus_deviation_mm,
    stated_defocus_mm,
)
from lensfit.optics.aberration import landing_and_jacobian_mm, local_wavefront
from lensfit.optics.paraxial import rim_sine
from lensfit.optics.pupil import relative_illumination, width_along_field
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
_FALL_OFFS, _FALL_OFF_POINTS = 3, 5
"""F-numbers whose fall-off counts, and radii for each."""
_LIGHTING, _LAMBERTIAN = 0.05, 0.1
"""Standard deviations of a chart's light at the frame's corner against that in the
middle; and of n where its radiance goes as cos^2n: lamps differ, no panel is ideal."""
_OUTLINE = 0.01
"""Of the area of an opening, as a share: its boundaries are no discs."""
_GREEN = 1
_DARK = 1e-3
"""No opening is taken for darker: what has closed has no logarithm."""


class FallOffStatement(NamedTuple):
    """Measured fall-off at some field heights and f-numbers.

    Attributes
    ----------
    height : In field radii.
    stated_radius, stop : Radius of the stop as its f-number says, in radii of the
        widest; and its place among the f-numbers of dots.
    loss : -ln of the relative illumination.
    rows : Of the differences from it, so that they are independent and of unit
        deviation; zero where nothing was measured.
    """

    height: Float[Array, " points"]
    stated_radius: Float[Array, " points"]
    stop: Int[Array, " points"]
    loss: Float[Array, " points"]
    rows: Float[Array, "points points"]


class Statements(NamedTuple):
    """Statements, ready for a solve.

    Attributes
    ----------
    defocus_mm : Of every group.
    rows : Of the differences from it, so that they are independent and of unit
        deviation; zero where nothing was stated.
    stop_radii : Of the widest and the narrowest stop, in radii of the widest.
    fall_off : Over the frame.
    """

    defocus_mm: Float[Array, " groups"]
    rows: Float[Array, "groups groups"]
    stop_radii: Float[Array, "2"]
    fall_off: FallOffStatement


def statements_without_distances(dot_data: DotData, layout: Layout) -> Statements:
    """The f-number, and the fall-off that was measured."""
    nothing = jnp.zeros((layout.groups, layout.groups))
    radii = jnp.asarray([1.0, float(np.min(dot_data.dots.stop_radius))])
    fall_off = _fall_off_statement(dot_data)
    return Statements(jnp.zeros(layout.groups), nothing, radii, fall_off)


def _fall_off_statement(dot_data: DotData) -> FallOffStatement:
    room = _FALL_OFFS * _FALL_OFF_POINTS
    height, radius, loss, light = np.ones((4, room))
    stop, (covariance, rows) = np.zeros(room, int), np.zeros((2, room, room))
    widest = dot_data.f_numbers[0]
    shown = dot_data.fall_offs if dot_data.shows_focusing else ()
    # Of a wider stop than any dots were photographed at nothing is modelled.
    known = [one for one in shown if one.f_number * WIDE_OPEN > widest]
    # The widest shows what rims cut, the narrowest what they do not.
    known = [*known[:1], *known[1:][-(_FALL_OFFS - 1) :]]
    for k, one in enumerate(known):
        here = slice(k * _FALL_OFF_POINTS, (k + 1) * _FALL_OFF_POINTS)
        height[here], light[here], terms = _samples_of(one, dot_data)
        loss[here] = terms @ one.fit.control[_GREEN]
        covariance[here, here] = terms @ one.fit.covariance[_GREEN] @ terms.T
        radius[here] = widest / one.f_number
        if one.f_number in dot_data.f_numbers:
            stop[here] = dot_data.f_numbers.index(one.f_number)
    used = slice(0, len(known) * _FALL_OFF_POINTS)
    covariance += np.outer(light, light) + _OUTLINE**2 * np.eye(room)
    rows[used, used] = np.linalg.inv(np.linalg.cholesky(covariance[used, used]))
    return FallOffStatement(*map(jnp.asarray, (height, radius, stop, loss, rows)))


def _samples_of(
    one: PhotographedFallOff, dot_data: DotData
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Heights in field radii, deviation of the chart's light there, and what every
    control value adds to the loss."""
    c_mm, scale = one.principal_distance_mm, dot_data.scale
    per_height_mm = float(scale.field_radius_mm) * c_mm
    per_height_mm /= float(scale.principal_distance_mm)
    largest_mm = min(one.fit.valid_radius_mm, _CORNER * per_height_mm)
    squared = (np.arange(_FALL_OFF_POINTS) + 1) / _FALL_OFF_POINTS
    radius_mm = np.sqrt(squared) * largest_mm
    height = radius_mm / per_height_mm
    oblique = np.log1p((radius_mm / c_mm) ** 2)
    light = np.hypot(_LIGHTING * height**2, _LAMBERTIAN * oblique)
    return height, light, one.fit.terms_at(radius_mm)


@kept_program(static_argnames=("layout",))
def _fall_off_residual(
    pupil_parameters: Array, statement: FallOffStatement, layout: Layout
) -> Array:
    """Light that the opening loses at every height, modelled minus photographed, in
    standard deviations."""
    pupil = pupil_of(pupil_parameters, layout, jnp.zeros(()))
    radius = fitted_stop_radius(
        pupil_parameters, layout, statement.stated_radius, statement.stop
    )

    def loss(height: Array, radius: Array) -> Array:
        here = jnp.stack([height, jnp.zeros_like(height)])
        lit = relative_illumination(here, radius, pupil)
        return -jnp.log(jnp.maximum(lit, _DARK))

    found = jax.vmap(loss)(statement.height, radius)
    return statement.rows @ (found - statement.loss)


def statements_with_distances(
    dot_data: DotData, layout: Layout, parameters: Float[np.ndarray, " parameters"]
) -> Statements:
    """Distances too; these and fall-off weighted by how well they agree with what was
    fitted to dots."""
    found = statements_without_distances(dot_data, layout)
    found = found._replace(
        fall_off=_weighted_fall_off(found.fall_off, parameters, layout)
    )
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
    off = rows @ (parameters[layout.blocks["defocus"]][known] - known_mm)
    every = np.zeros((layout.groups, layout.groups))
    every[np.ix_(known, known)] = np.sqrt(_cauchy_weight(np.mean(off**2))) * rows
    every_mm = np.zeros(layout.groups)
    every_mm[known] = known_mm
    return found._replace(defocus_mm=jnp.asarray(every_mm), rows=jnp.asarray(every))


def _weighted_fall_off(
    statement: FallOffStatement,
    parameters: Float[np.ndarray, " parameters"],
    layout: Layout,
) -> FallOffStatement:
    of_pupil = jnp.asarray(parameters)[layout.pupil_parameters]
    off = np.asarray(_fall_off_residual(of_pupil, statement, layout))
    stated = max(int(np.count_nonzero(np.diag(statement.rows))), 1)
    weight = _cauchy_weight(np.sum(off**2) / stated)
    return statement._replace(rows=np.sqrt(weight) * statement.rows)


def _cauchy_weight(mean_square: float) -> float:
    return 1 / (1 + mean_square / _CAUCHY_SCALE**2)


@kept_program(static_argnames=("layout",))
def stated_equations(
    parameters: Float[Array, " parameters"], statements: Statements, layout: Layout
) -> Quadratic:
    """Of all statements, at these parameters."""

    def of_defocus(defocus_mm: Array) -> Array:
        return statements.rows @ (defocus_mm - statements.defocus_mm)

    def of_pupil(pupil_parameters: Array) -> Array:
        pupil = pupil_of(pupil_parameters, layout, jnp.zeros(()))
        cut = jnp.minimum(pupil.rim_radius[:, 0] - 1, 0.0) / _CUT
        corner = jnp.array([_CORNER, 0.0])
        radii = statements.stop_radii
        left = jax.vmap(width_along_field, (None, 0, None))(corner, radii, pupil)
        closed = jnp.minimum(left / radii - _LEAST_OPENING, 0.0) / _CUT
        lit = _fall_off_residual(pupil_parameters, statements.fall_off, layout)
        return jnp.concatenate([cut, closed, lit])

    def equations(residual: Callable[[Array], Array], where: slice) -> Quadratic:
        off, own = residual(parameters[where]), jax.jacfwd(residual)(parameters[where])
        slopes = jnp.zeros((len(off), layout.size)).at[:, where].set(own)
        return Quadratic(slopes.T @ slopes, slopes.T @ off, off @ off)

    return jax.tree.map(
        jnp.add,
        equations(of_defocus, layout.blocks["defocus"]),
        equations(of_pupil, layout.pupil_parameters),
    )


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
