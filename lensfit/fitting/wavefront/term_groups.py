"""Term groups: parameters that enter the wavefront fit, or stay out, together.

A term group has a prior wide enough for any lens and a stage from which it is free.
Some are in every fit (defocus, third order, rims); the others are candidates.
"""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from lensfit.fitting.wavefront.dot_arrays import dot_aperture_variance_mm2
from lensfit.fitting.wavefront.dot_data import DotData
from lensfit.fitting.wavefront.parameters import Layout
from lensfit.optics.terms import Term, decentring_terms, two_mirror_terms

COARSE, MIDDLE, FINE, LAST = 1, 2, 3, 4
_ORDER_NAMES = {3: "third", 5: "fifth", 7: "seventh", 9: "ninth"}
_ORDER_STAGE = {3: COARSE, 5: MIDDLE, 7: FINE, 9: FINE}
_LOWEST = 3
_CYLINDER_KINDS = {2: "astigmatism", 3: "coma"}
_CYLINDER_UM = 30.0
_GAUGE = two_mirror_terms(1)
"""Constant astigmatism: it has the effect of all astigmatic offsets together."""
_OFFSET = 0.2
"""Prior deviation, per unit of defocus, of the astigmatic defocus offset."""
_THIRD_ORDER_UM = 100.0
_ASYMMETRIC_UM = 10.0
_COLOUR_UM = 15.0
_BAND_WIDTH = 0.25
"""Bands of cameras have standard deviations of some 20 to 32 nm."""
_FOCUS_CHANGE_UM = 2.0
"""Of third order, from the reference to the farthest photographed focus distance. A
lens that moves as a whole has none; where elements move against each other, photographs
show tens of micrometres whatever the prior. A chart at one distance barely tells a
field that curves with focus from a pupil that narrows towards the corner (fall-off
does: `stated`); a wide prior made blur of farther objects a tenth too wide."""
_PUPIL_COMA = 0.05
"""Shift of the stop per field radius; traced lenses have a few hundredths."""
SEIDEL = frozenset({"defocus", "third_order", "rims", "blades"})
"""The term groups of a lens of third order, grey, behind its rims and its iris."""
_SHOWN = 4.0
"""Least variance of a disc, over that of the dot aperture, that determines the stop's
radius."""
_FEWEST_FOR_ORDER = {5: 12, 7: 24, 9: 40}
"""Least number of dots for the terms of an order."""


@dataclass(frozen=True)
class TermGroup:
    """Parameters that enter together.

    Attributes
    ----------
    name : In reports.
    indices : In the parameter vector.
    deviation : Of the prior.
    stage : From which it is free: COARSE, MIDDLE, FINE or LAST.
    optional : Whether it may be left out.
    """

    name: str
    indices: tuple[int, ...]
    deviation: tuple[float, ...]
    stage: int
    optional: bool = True


def candidate_term_groups(
    dot_data: DotData,
    layout: Layout,
    defocus_mm: Float[np.ndarray, " groups"],
    allowed: Collection[str] | None = None,
) -> tuple[TermGroup, ...]:
    """All term groups that these photographs could determine, of those allowed by
    name."""
    blocks = layout.blocks
    groups = np.arange(len(dot_data.groups)) + blocks["defocus"].start
    spread = np.maximum(0.5 * np.abs(defocus_mm[: len(groups)]), 0.3)
    found = [TermGroup("defocus", _ints(groups), tuple(spread), COARSE, optional=False)]
    if layout.anamorphic:
        found += _cylinder_groups(dot_data, layout, spread)
    found += _order_groups(dot_data, layout)
    if dot_data.colour:
        found += colour_term_groups(layout)
        width = _range(blocks["band_width"])
        found.append(_term_group("band_width", width, _BAND_WIDTH, FINE))
    if layout.focus_terms and dot_data.shows_focusing:
        found += _focus_change_groups(layout)
    found += _pupil_groups(dot_data, layout, defocus_mm)
    asymmetric = [
        i
        for i, t in enumerate(layout.terms)
        if t in decentring_terms() and not (layout.anamorphic and t in _GAUGE)
    ]
    if len(dot_data.take) >= _FEWEST_FOR_ORDER[5]:
        found.append(
            _term_group("decentred_elements", asymmetric, _ASYMMETRIC_UM, FINE)
        )
    exit_pupil = _range(blocks["exit_pupil"])
    found.append(_term_group("exit_pupil", exit_pupil, 0.5, FINE))
    if allowed is None:
        return tuple(found)
    # The astigmatic defocus offset belongs to defocus.
    names = {*allowed, "astigmatic_offset"} if "defocus" in allowed else {*allowed}
    return tuple(f for f in found if f.name in names)


def deviation_of(
    term_groups: tuple[TermGroup, ...], layout: Layout, stage: int
) -> Float[np.ndarray, " parameters"]:
    """Prior deviations of the term groups that are free at a stage; 0 elsewhere."""
    deviation = np.zeros(layout.size)
    for term_group in term_groups:
        if term_group.stage <= stage:
            deviation[list(term_group.indices)] = term_group.deviation
    return deviation


def indices_of(term_groups: tuple[TermGroup, ...]) -> Int[np.ndarray, " parameters"]:
    """All their parameters."""
    return np.array([i for term_group in term_groups for i in term_group.indices], int)


def terms_that_change_with_focus(terms: tuple[Term, ...]) -> tuple[Term, ...]:
    """Third order of a centred lens, then what cylinders add to it."""
    lowest = [t for t in terms if t.order == _LOWEST]
    return (*filter(_even, lowest), *filter(_is_of_cylinders, lowest))


def _focus_change_groups(layout: Layout) -> list[TermGroup]:
    first = layout.blocks["focus_change"].start
    centred = [first + k for k, t in enumerate(layout.focus_terms) if _even(t)]
    rest = [k for k in _range(layout.blocks["focus_change"]) if k not in centred]
    found = [_term_group("change_with_focus", centred, _FOCUS_CHANGE_UM, FINE)]
    if rest:
        name = "cylinders_change_with_focus"
        found.append(_term_group(name, rest, _FOCUS_CHANGE_UM, FINE))
    return found


def _order_groups(dot_data: DotData, layout: Layout) -> list[TermGroup]:
    found = []
    for order, name in _ORDER_NAMES.items():
        which = [i for i, t in enumerate(layout.terms) if t.order == order and _even(t)]
        enough = len(dot_data.take) >= _FEWEST_FOR_ORDER.get(order, 0)
        if which and enough:
            deviation = _THIRD_ORDER_UM / (1 + (order - 3) / 2) ** 1.5
            optional = order > 3
            stage = _ORDER_STAGE[order]
            found.append(
                _term_group(f"{name}_order", which, deviation, stage, optional=optional)
            )
    return found


def _cylinder_groups(
    dot_data: DotData, layout: Layout, spread: Float[np.ndarray, " groups"]
) -> list[TermGroup]:
    """Further term groups of an anamorphic lens."""
    name = "astigmatic_offset"
    offsets = _ints(np.arange(len(spread)) + layout.blocks[name].start)
    found = [TermGroup(name, offsets, tuple(_OFFSET * spread), COARSE, False)]
    kinds: dict[str, list[int]] = {}
    for i, term in enumerate(layout.terms):
        if _is_of_cylinders(term):
            kinds.setdefault(_cylinder_name(term), []).append(i)
    for name, which in kinds.items():
        order = layout.terms[which[0]].order
        if len(dot_data.take) >= _FEWEST_FOR_ORDER.get(order, 0):
            deviation = _CYLINDER_UM / (1 + (order - 3) / 2) ** 1.5
            found.append(_term_group(name, which, deviation, _ORDER_STAGE[order]))
    return found


def _cylinder_name(term: Term) -> str:
    """Third order is one term group; the fifth has too many terms for one."""
    if term.order == _LOWEST:
        return "cylinders_third_order"
    return f"cylinders_fifth_{_CYLINDER_KINDS.get(term.degree, 'spherical')}"


def _is_of_cylinders(term: Term) -> bool:
    return term in two_mirror_terms(term.order) and term not in _GAUGE


def _even(term: Term) -> bool:
    """Whether a centred lens has it."""
    return term.part == "re" and term.field_order == term.order_u


def colour_term_groups(layout: Layout) -> list[TermGroup]:
    """How aberrations change with wavelength, in the first and second power of the
    chromatic coordinate."""
    start = layout.blocks["colour"].start
    count = len(layout.colour_terms)

    def of_order(order: int, power: int = 1) -> list[int]:
        """Where coefficients of a power of the chromatic coordinate lie."""
        first = start + (power - 1) * count
        orders = enumerate(t.order for t in layout.colour_terms)
        return [first + i for i, one in orders if one == order]

    return [
        _term_group("axial_colour", of_order(1), _COLOUR_UM, COARSE),
        _term_group("colour_of_third_order", of_order(3), _COLOUR_UM, MIDDLE),
        _term_group("colour_of_fifth_order", of_order(5), _COLOUR_UM / 2, FINE),
        _term_group("axial_colour_curved", of_order(1, 2), _COLOUR_UM, MIDDLE),
        _term_group("colour_of_third_order_curved", of_order(3, 2), _COLOUR_UM, FINE),
    ]


def determined_stops(
    dot_data: DotData, defocus_mm: Float[np.ndarray, " groups"]
) -> Bool[np.ndarray, " stops"]:
    """Which f-numbers besides the widest were photographed so far out of focus that
    dots determine the stop's radius.

    The variance of a disc is a quarter of its radius squared. Where it is not much more
    than the dot aperture's, a small error of the dot aperture or of the pixel causes a
    large one of the stop, and the f-number is the better estimate.
    """
    dots = dot_data.dots
    tangent = float(dot_data.scale.reference_sine) * np.asarray(dots.stop_radius)
    disc_mm2 = (defocus_mm[np.asarray(dots.group)] * tangent) ** 2 / 4
    shows = disc_mm2 > _SHOWN * dot_aperture_variance_mm2(dots)
    stops = range(1, len(dot_data.f_numbers))
    return np.array([bool(shows[dots.stop == k].any()) for k in stops], bool)


def _pupil_groups(
    dot_data: DotData, layout: Layout, defocus_mm: Float[np.ndarray, " groups"]
) -> list[TermGroup]:
    blocks = layout.blocks
    rims = _range(blocks["rim_shift"]) + _range(blocks["rim_radius"])
    wide = (*[0.5] * (2 * layout.rims), *[0.3] * (2 * layout.rims))
    found = [TermGroup("rims", tuple(rims), wide, COARSE, optional=False)]
    # Freed far from the solution, pupil coma would take the place of a rim.
    coma = _range(blocks["stop_shift"])
    found.append(_term_group("pupil_coma", coma, _PUPIL_COMA, LAST, optional=False))
    found.append(_term_group("pupil_stretch", _range(blocks["stretch"]), 0.2, FINE))
    squeeze, rotation, curvature = _range(blocks["iris"])
    found.append(_term_group("pupil_squeeze", [squeeze], 0.05, FINE))
    stops = len(dot_data.f_numbers) - 1
    if stops:
        determined = np.flatnonzero(determined_stops(dot_data, defocus_mm))
        ratios = [blocks["stop_ratio"].start + int(k) for k in determined]
        if ratios:
            width = dot_data.widths.f_number
            found.append(_term_group("stop_ratios", ratios, width, FINE))
        blades = TermGroup(
            "blades", (rotation, curvature), (3.0, 1.0), FINE, optional=False
        )
        found.append(blades)
    return found


def _term_group(
    name: str,
    indices: list[int],
    deviation: float,
    stage: int,
    *,
    optional: bool = True,
) -> TermGroup:
    return TermGroup(name, _ints(indices), (deviation,) * len(indices), stage, optional)


def _ints(indices) -> tuple[int, ...]:
    return tuple(int(i) for i in indices)


def _range(where: slice) -> list[int]:
    return list(range(where.start, where.stop))
