"""Few shapes in which all parameters move the rays of one dot.

At one field point many terms of the wavefront are one and the same mode of the pupil,
and only one of all defocus values counts. So images need to be differentiated by fewer
shapes than there are parameters:

- the amplitude of every mode (Re or Im member, `optics.terms`), and its linear and
  quadratic change with the chromatic coordinate where colour has that mode;
- the dot's own defocus; behind cylinders also the astigmatic defocus offset of x;
- where the exit pupil is, and the chief ray's bend;
- the width of the bands of wavelengths;
- the parameters of the pupil, each its own shape (`rays`).

`shape_jacobian` is the derivative of the shapes by the parameters. Arrays have rays on
their last axis, the order in which memory is read.
"""

from functools import lru_cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from lensfit.fitting.wavefront.dot_arrays import Dots
from lensfit.fitting.wavefront.parameters import Layout, Scale, aberration_of
from lensfit.optics.aberration import chief_sine, tangents
from lensfit.optics.depth import cylinder_mm
from lensfit.optics.spectrum import chromatic_coordinate
from lensfit.optics.terms import Mode, Term, mode_gradients, modes_of, term_amplitudes

_MM_PER_UM = 1e-3


class Colour(NamedTuple):
    """The wavelengths of one channel, of equal weight.

    Attributes
    ----------
    chromatic : Chromatic coordinates (`optics.spectrum`).
    lateral_mm : Displacement of each wavelength's chief ray about their mean.
    chromatic_slope, lateral_slope_mm : Their derivatives by `band_width`.
    """

    chromatic: Float[Array, " wavelengths"]
    lateral_mm: Float[Array, "wavelengths 2"]
    chromatic_slope: Float[Array, " wavelengths"]
    lateral_slope_mm: Float[Array, "wavelengths 2"]


def colours_of(
    parameters: Float[Array, " parameters"],
    dot: Dots,
    wavelengths_nm: Float[Array, "3 wavelengths"],
    layout: Layout,
) -> Colour:
    """Of all channels, stacked: bands as wide as the parameters have them.

    Parameters
    ----------
    wavelengths_nm : Of bands of usual width.
    """
    middle_nm = jnp.mean(wavelengths_nm, 1, keepdims=True)

    def widened(more: Array) -> tuple[Array, Array]:
        width = 1 + more
        nm = middle_nm + width * (wavelengths_nm - middle_nm)
        return chromatic_coordinate(nm), width * dot.lateral_mm

    (more,) = parameters[layout.blocks["band_width"]]
    return Colour(*widened(more), *jax.jacfwd(widened)(more))


def field_point(dot: Dots, scale: Scale) -> Float[Array, "2"]:
    """In field radii of the dot's state."""
    return dot.field_mm / (scale.field_radius_mm * dot.principal_distance_ratio)


def mode_shapes_mm(
    u: Float[Array, "wavelengths points 2"], layout: Layout
) -> Float[Array, "members 2 wavelengths points"]:
    """d landing / d amplitude (um) of every member of the modes, x and y."""
    of_modes = mode_gradients(jnp.moveaxis(u, -1, 0), _modes(layout))
    of_members = of_modes.reshape(-1, *of_modes.shape[2:])
    return of_members[_members(layout)] * _MM_PER_UM


def chromatic_shapes(
    by_mode: Float[Array, "members *some wavelengths points"],
    chromatic: Float[Array, " wavelengths"],
    layout: Layout,
) -> Float[Array, "shapes *some wavelengths points"]:
    """Derivatives by the modes, and by their linear and quadratic changes with
    colour."""
    changing = by_mode[_chromatic_members(layout)]
    weight = chromatic.reshape(*[1] * (by_mode.ndim - 2), -1, 1)
    return jnp.concatenate([by_mode, changing * weight, changing * weight**2])


def chromatic_slopes_mm(
    by_mode: Float[Array, "members *some wavelengths points"],
    parameters: Float[Array, " parameters"],
    dot: Dots,
    colour: Colour,
    layout: Layout,
    scale: Scale,
) -> Float[Array, "*some wavelengths points"]:
    """d landing / d chromatic coordinate, from those by the modes."""
    half = len(layout.colour_terms)
    coefficients = parameters[layout.blocks["colour"]].reshape(2, half)
    of_terms = _amplitudes(field_point(dot, scale), layout.colour_terms, layout)
    linear, quadratic = (of_terms @ coefficients.T)[_chromatic_members(layout)].T
    slope = linear[:, None] + 2 * jnp.outer(quadratic, colour.chromatic)
    return jnp.einsum("m...wk,mw->...wk", by_mode[_chromatic_members(layout)], slope)


def band_width_shape_mm(
    by_mode: Float[Array, "members 2 wavelengths points"],
    parameters: Float[Array, " parameters"],
    dot: Dots,
    colour: Colour,
    layout: Layout,
    scale: Scale,
) -> Float[Array, "1 2 wavelengths points"]:
    """d landing / d width of the bands: wavelengths move apart."""
    by_coordinate = chromatic_slopes_mm(by_mode, parameters, dot, colour, layout, scale)
    moved = jnp.einsum("w,iwk->iwk", colour.chromatic_slope, by_coordinate)
    return (moved + colour.lateral_slope_mm.T[..., None])[None]


def state_shapes_mm(
    u: Float[Array, "wavelengths points 2"],
    parameters: Float[Array, " parameters"],
    dot: Dots,
    layout: Layout,
    scale: Scale,
) -> Float[Array, "states 2 wavelengths points"]:
    """d landing / d the dot's own defocus, its astigmatic offset, and the exit
    pupil."""
    defocus = parameters[layout.blocks["defocus"]][dot.group]
    p_x, p_y = u[..., 0] * scale.reference_sine, u[..., 1] * scale.reference_sine
    where = layout.blocks["exit_pupil"]

    def chief(exit_pupil: Array) -> Array:
        changed = parameters.at[where].set(exit_pupil)
        aberration = aberration_of(changed, layout, scale, dot.principal_distance_ratio)
        return chief_sine(dot.field_mm, aberration)

    def by_defocus(chief_x: Array, chief_y: Array) -> Array:
        there, here = tangents(p_x + chief_x, p_y + chief_y), tangents(chief_x, chief_y)
        return jnp.stack([a - b for a, b in zip(there, here, strict=True)])

    at = tuple(chief(parameters[where]))
    turned = jax.jacfwd(chief)(parameters[where])
    by_exit_pupil = [
        defocus * jax.jvp(by_defocus, at, tuple(towards))[1] for towards in turned.T
    ]
    own = by_defocus(*at)
    if dot.sections is None:
        return jnp.stack([own, *by_exit_pupil])
    none, one = jnp.zeros((), own.dtype), jnp.ones((), own.dtype)
    (a, b), (c, d) = cylinder_mm(none, one, dot.sections)
    offset = jnp.stack([a * p_x + b * p_y, c * p_x + d * p_y])
    own = own + dot.sections.per_defocus * offset
    return jnp.stack([own, offset, *by_exit_pupil])


def shape_jacobian(
    dot: Dots, layout: Layout, scale: Scale
) -> Float[Array, "shapes parameters"]:
    """d shape / d parameter, at the place of a dot."""
    h = field_point(dot, scale)
    blocks = layout.blocks
    of_terms = _amplitudes(h, layout.terms, layout)
    of_colours = _amplitudes(h, layout.colour_terms, layout)[_chromatic_members(layout)]
    half = len(layout.colour_terms)
    linear, quadratic = blocks["colour"].start, blocks["colour"].start + half
    mine = jax.nn.one_hot(dot.group, layout.groups, dtype=h.dtype)[None]
    placed = [
        (blocks["coefficients"].start, of_terms),
        (linear, of_colours),
        (quadratic, of_colours),
        (blocks["defocus"].start, mine),
    ]
    if layout.anamorphic:
        placed.append((blocks["astigmatic_offset"].start, mine))
    rest = layout.size - blocks["exit_pupil"].start
    placed.append((blocks["exit_pupil"].start, jnp.eye(rest, dtype=h.dtype)))

    def padded(start: int, part: Array) -> Array:
        return jnp.pad(part, ((0, 0), (start, layout.size - start - part.shape[1])))

    of_coefficients, *others = (padded(*one) for one in placed)
    # A coefficient's change with focus has the coefficient's own shapes.
    of_change = dot.focus * of_terms[:, layout.focus_rows]
    of_coefficients += padded(blocks["focus_change"].start, of_change)
    return jnp.concatenate([of_coefficients, *others])


def _amplitudes(
    h: Array, terms: tuple[Term, ...], layout: Layout
) -> Float[Array, "members terms"]:
    """Of every member of the modes, for a unit of each term."""
    row, pair = term_amplitudes(h, terms)
    modes = _modes(layout)
    at = np.array([modes.index(mode) for mode in modes_of(terms)], int)[row]
    column = np.arange(len(terms))
    of_modes = jnp.zeros((len(modes), 2, len(terms)), h.dtype)
    of_modes = of_modes.at[at, :, column].set(pair)
    return of_modes.reshape(2 * len(modes), len(terms))[_members(layout)]


def _modes(layout: Layout) -> tuple[Mode, ...]:
    return modes_of(layout.terms + layout.colour_terms)


@lru_cache(maxsize=8)
def _members(layout: Layout) -> Int[np.ndarray, " members"]:
    """Which of all Re and Im members of the modes there are: Im z^0 is none."""
    is_one = [(True, mode.order > 0) for mode in _modes(layout)]
    return np.flatnonzero(np.array(is_one))


@lru_cache(maxsize=8)
def _chromatic_members(layout: Layout) -> Int[np.ndarray, " coloured"]:
    """Which of the members change with colour."""
    chromatic_shapes = set(modes_of(layout.colour_terms))
    modes = _modes(layout)
    return np.flatnonzero([modes[k // 2] in chromatic_shapes for k in _members(layout)])
