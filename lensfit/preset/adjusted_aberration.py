"""The aberration function with its groups of terms scaled or set to a stated size.

The terms of `lensfit.optics.terms` are grouped by their pupil mode z^m: m = 1 is coma,
m = 0 from the fourth degree on spherical aberration (balanced with focus over the
widest aperture, as its modes are), the modes of the second degree are focus and
astigmatism, and the rest are "other". All coefficients of a group are multiplied by the
same factor, at all orders and colours, so that its shape over field and pupil stays.

Focus and astigmatism make two focal surfaces. In the wavefront of a point off the axis,

    E = (f P + a Re[conj(eta) z^2]) / sqrt(2)
      = ((f + a) x^2 + (f - a) y^2) / sqrt(2)      (x along the field direction),

a tangential fan is in focus where defocus cancels f + a, a sagittal one where it
cancels f - a. With f the medial surface and T, S the gains of the two departures from
it,

    f' = f(0) + F (f - f(0)) + (T - S) a / 2,      a' = (T + S) a / 2,

which stays a sum of terms: the radial polynomial of a, R_k^2, is a sum of R_0^0 ...
R_k^0. Astigmatism without field symmetry (decentred elements) has no radial direction,
and is multiplied by (T + S) / 2.

The size of a group is the rms spot radius that it makes in green at the place of the
field where that is largest (the amplitudes of its modes, squared and summed), with the
sign of its lowest mode there.
"""

from collections.abc import Callable, Iterable
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Complex, Float

from lensfit.optics.aberration import Aberration
from lensfit.optics.spectrum import Bands, chromatic_coordinate
from lensfit.optics.terms import Term, radial_polynomial
from lensfit.preset.knob_groups import AberrationKnobs

Terms = dict[Term, Float[np.ndarray, "3"]]
"""Coefficient of each term, um: in green, and its linear and quadratic change."""

FOCUS_ON_AXIS = Term(2, 0, 0, 0)
_COMA, _SPHERICAL = Term(3, 1, 1, 1), Term(4, 0, 0, 0)
_TREFOIL, _ASTIGMATISM = Term(3, 3, 3, 3), Term(2, 2, 2, 2)
_CURVATURE = Term(2, 0, 2, 0)
_RADII, _AZIMUTHS = 24, 8
_NOTHING_UM = 1e-9


class Scale(NamedTuple):
    """A gain, and what it multiplies in place of what was measured, if anything."""

    gain: float
    um: float | None

    @property
    def is_neutral(self) -> bool:
        """Whether it leaves the measured wavefront alone."""
        return self == Scale(1.0, None)


def scale_of(knobs: AberrationKnobs, name: str) -> Scale:
    """Of a family by the name of its knobs."""
    return Scale(getattr(knobs, f"{name}_gain"), getattr(knobs, f"{name}_um"))


def adjusted_aberration(
    aberration: Aberration, edge_mm: float, bands: Bands, knobs: AberrationKnobs
) -> Aberration:
    """The aberrations after the knobs are applied.

    Parameters
    ----------
    edge_mm : Edge of the field, from the principal point.
    """
    terms, edge = _terms_of(aberration), edge_mm / float(aberration.field_radius_mm)
    for name, is_in, seed in _TERM_GROUPS:
        family = {t: um for t, um in terms.items() if is_in(t)}
        terms |= scaled_terms(family, scale_of(knobs, name), {seed: _ONE}, edge)
    terms |= _adjusted_focal_surfaces(terms, edge, knobs)
    terms |= _adjusted_axial_colour(terms, bands, scale_of(knobs, "axial_colour"))
    by_colour = np.array([1.0, knobs.chromatic_gain, knobs.chromatic_gain])
    return _with_terms(aberration, {t: um * by_colour for t, um in terms.items()})


_ONE = np.array([1.0, 0.0, 0.0])
_TERM_GROUPS: tuple[tuple[str, Callable[[Term], bool], Term], ...] = (
    ("coma", lambda t: t.order_u == 1, _COMA),
    ("spherical", lambda t: t.order_u == 0 and t.degree > 2, _SPHERICAL),
    (
        "other_aberrations",
        lambda t: t.order_u > 2 or (t.order_u == 2 and t.degree > 2),
        _TREFOIL,
    ),
)


def terms_of_group(aberration: Aberration, name: str) -> Terms:
    """What the gain of this name multiplies; nothing where the lens has none of it."""
    found = _terms_of(aberration)
    own = {group: is_in for group, is_in, _ in _TERM_GROUPS} | {
        "field_curvature": lambda t: _is_focus(t) and t != FOCUS_ON_AXIS,
        "astigmatism_sagittal": _is_astigmatism,
        "astigmatism_tangential": _is_astigmatism,
        "axial_colour": _is_focus,
        "chromatic": lambda _: True,
    }
    column = slice(1, 3) if name in ("axial_colour", "chromatic") else slice(0, 3)
    return {t: um for t, um in found.items() if own[name](t) and np.any(um[column])}


def scaled_terms(family: Terms, scale: Scale, seed: Terms, edge: float) -> Terms:
    """A family at its gain; of one that has no size yet a stated one, the lowest term.

    Parameters
    ----------
    seed : The lowest term.
    edge : Edge of the field, in field radii.
    """
    if scale.is_neutral:
        return family
    factor = scale.gain
    if scale.um is not None:
        size = size_um(family, edge)
        if abs(size) < _NOTHING_UM:
            family = family | seed
            size = size_um(family, edge)
        factor *= scale.um / size
    return {t: um * factor for t, um in family.items()}


def size_um(family: Terms, edge: float) -> float:
    """The largest spot that a family makes over the field, with its sign."""
    if not family:
        return 0.0
    radius = np.linspace(0.0, edge, _RADII + 1)
    azimuth = np.arange(_AZIMUTHS) * (2 * np.pi / _AZIMUTHS)
    h = (radius[:, None] * np.exp(1j * azimuth)).ravel()
    modes: dict[tuple[int, int], Complex[np.ndarray, " points"]] = {}
    for term, um in family.items():
        mode = (term.degree, term.order_u)
        modes[mode] = modes.get(mode, 0j) + um[0] * _amplitude(h, term)
    size = np.sqrt(np.sum([np.abs(a) ** 2 for a in modes.values()], 0))
    largest = int(np.argmax(size - 1e-9 * size.max() * np.arange(size.size)))
    (_, order), lowest = min(modes.items())
    rotated = lowest[largest] * np.exp(-1j * order * np.angle(h[largest]))
    return float(size[largest] * (-1 if rotated.real < 0 else 1))


def _amplitude(h: np.ndarray, term: Term) -> np.ndarray:
    """Of Re and Im of a unit of a term's mode, as a complex number."""
    eta = (h if term.field_order >= 0 else h.conj()) ** abs(term.field_order)
    powers = radial_polynomial(term.field_degree, abs(term.field_order))
    eta = eta * np.polynomial.polynomial.polyval(np.abs(h) ** 2, powers)
    return eta if term.part == "re" else 1j * eta


def _adjusted_focal_surfaces(
    terms: Terms, edge: float, knobs: AberrationKnobs
) -> Terms:
    """Terms of focus and astigmatism, by the gains of the three surfaces."""
    curved = scale_of(knobs, "field_curvature")
    along, across = (
        scale_of(knobs, f"astigmatism_{name}") for name in ("tangential", "sagittal")
    )
    focus = {t: um for t, um in terms.items() if _is_focus(t)}
    astigmatism = {t: um for t, um in terms.items() if _is_astigmatism(t)}
    if not curved.is_neutral:
        off_axis = {t: um for t, um in focus.items() if t != FOCUS_ON_AXIS}
        off_axis[FOCUS_ON_AXIS] = -_focus_terms_on_axis(off_axis)
        seed = {_CURVATURE: _ONE, FOCUS_ON_AXIS: _ONE}
        _add(focus, scaled_terms(off_axis, curved, seed, edge))
        _add(focus, {t: -um for t, um in off_axis.items()})
    if along.is_neutral and across.is_neutral:
        return focus
    # What is left of a seed when only one surface is stated is that surface's alone.
    seed = {_ASTIGMATISM: _ONE}
    tangential = scaled_terms(astigmatism, along, seed, edge)
    negative = Scale(across.gain, None if across.um is None else -across.um)
    sagittal = scaled_terms(astigmatism, negative, seed, edge)
    half = {t: um / 2 for t, um in tangential.items()}
    other = {t: um / 2 for t, um in sagittal.items()}
    adjusted: Terms = {}
    _add(adjusted, half)
    _add(adjusted, other)
    medial = half
    _add(medial, {t: -um for t, um in other.items()})
    for term, um in medial.items():
        if _is_centred(term) and np.any(um):
            _add(focus, _as_focus(term, um))
    return focus | adjusted


def _is_focus(term: Term) -> bool:
    return (term.degree, term.order_u) == (2, 0)


def _is_astigmatism(term: Term) -> bool:
    return (term.degree, term.order_u) == (2, 2)


def _is_centred(term: Term) -> bool:
    return term.part == "re" and term.field_order == term.order_u


def _as_focus(term: Term, um: np.ndarray) -> Terms:
    """Terms of focus that vary over the field as one of astigmatism does."""
    degrees = range(0, term.field_degree + 1, 2)
    columns = np.zeros((len(degrees),) * 2)
    for column, degree in enumerate(degrees):
        columns[: column + 1, column] = radial_polynomial(degree, 0)
    wanted = np.append(0.0, radial_polynomial(term.field_degree, 2))
    shares = np.linalg.solve(columns, wanted)
    return {Term(2, 0, d, 0): c * um for d, c in zip(degrees, shares, strict=True)}


def _focus_terms_on_axis(focus: Terms) -> np.ndarray:
    """What terms of focus are worth on the axis, in the same three numbers."""
    own = [
        um * radial_polynomial(t.field_degree, 0)[0]
        for t, um in focus.items()
        if t.field_order == 0 and t.part == "re"
    ]
    return np.sum([np.zeros(3), *own], 0)


def _adjusted_axial_colour(terms: Terms, bands: Bands, scale: Scale) -> Terms:
    """Terms of focus, by what they change with colour."""
    if scale.is_neutral:
        return {}
    focus = {t: um for t, um in terms.items() if _is_focus(t)}
    factor = scale.gain
    if scale.um is not None:
        w = np.asarray(jnp.mean(chromatic_coordinate(bands.wavelengths_nm), 1))
        w = w[[2, 0]]
        size = np.stack([w, w * w], 1) @ _focus_terms_on_axis(focus)[1:]
        if np.abs(size).max() < _NOTHING_UM:
            _add(focus, {FOCUS_ON_AXIS: np.array([0.0, 1.0, 0.0])})
            size = w
        factor *= scale.um / size[np.argmax(np.abs(size))]
    return {t: um * [1.0, factor, factor] for t, um in focus.items()}


def _add(terms: Terms, more: Terms) -> None:
    for term, um in more.items():
        terms[term] = terms.get(term, np.zeros(3)) + um


def _terms_of(aberration: Aberration) -> Terms:
    terms: Terms = {}
    plain = _floats(aberration.coefficients_um)
    for term, um in zip(aberration.terms, plain, strict=True):
        _add(terms, {term: np.array([um, 0.0, 0.0])})
    by_colour = _floats(aberration.colour_um).T
    for term, um in zip(aberration.colour_terms, by_colour, strict=True):
        _add(terms, {term: np.array([0.0, *um])})
    return terms


def _with_terms(aberration: Aberration, terms: Terms) -> Aberration:
    """The same terms first, so that one program serves while none is new."""

    def listed(known: Iterable[Term], column: slice) -> tuple[Term, ...]:
        used = [t for t, um in terms.items() if np.any(um[column])]
        return tuple(dict.fromkeys((*known, *used)))

    plain = listed(aberration.terms, slice(0, 1))
    coloured = listed(aberration.colour_terms, slice(1, 3))
    colour = np.array([terms[t][1:] for t in coloured], float).reshape(-1, 2)
    return Aberration(
        coefficients_um=jnp.asarray(np.array([terms[t][0] for t in plain], float)),
        colour_um=jnp.asarray(np.ascontiguousarray(colour.T)),
        field_radius_mm=aberration.field_radius_mm,
        reference_sine=aberration.reference_sine,
        exit_pupil_distance_mm=aberration.exit_pupil_distance_mm,
        chief_bend=aberration.chief_bend,
        terms=plain,
        colour_terms=coloured,
    )


def _floats(values) -> np.ndarray:
    return np.asarray(values, float)
