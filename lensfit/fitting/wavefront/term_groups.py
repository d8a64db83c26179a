"""Families of parameters that enter the wavefront fit, or stay out, together.

A family has a prior wide enough for any lens and a stage from which it is free. Some
are always there (defocus, third order, rims); the others are tried.
"""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from lensfit.fitting.wavefront.dots import hole_variance_mm2
from lensfit.fitting.wavefront.gather import Gathered
from lensfit.fitting.wavefront.parameters import Layout
from lensfit.optics.terms import Term, decentring_terms, two_mirror_terms

COARSE, MIDDLE, FINE, LAST = 1, 2, 3, 4
_ORDER_NAMES = {3: "third", 5: "fifth", 7: "seventh", 9: "ninth"}
_ORDER_STAGE = {3: COARSE, 5: MIDDLE, 7: FINE, 9: FINE}
_LOWEST = 3
_CYLINDER_KINDS = {2: "astigmatism", 3: "coma"}
_CYLINDER_UM = 30.0
_GAUGE = two_mirror_terms(1)
"""Constant astigmatism: all `beyond` values of an anamorphic lens over again."""
_BEYOND = 0.2
"""How unsure it is, per unit of defocus, that both sections are sharp together."""
_THIRD_ORDER_UM = 100.0
_ASYMMETRIC_UM = 10.0
_COLOUR_UM = 15.0
_PUPIL_COMA = 0.05
"""Shift of the stop per field radius; traced lenses have a few hundredths."""
SEIDEL = frozenset({"defocus", "third_order", "rims", "blades"})
"""The families of a lens of third order, grey, behind its rims and its iris."""
_SHOWN = 4.0
"""Of the variance of a dot's hole, that of a disc which shows the stop's radius."""
_FEWEST_FOR_ORDER = {5: 12, 7: 24, 9: 40}
"""Dots; fewer cannot carry that many terms."""


@dataclass(frozen=True)
class Family:
    """Parameters that enter together.

    Attributes
    ----------
    name : In reports.
    indices : In the parameter vector.
    deviation : Of the prior.
    stage : From which it is free: COARSE, MIDDLE, FINE or LAST.
    tried : Whether it may be left out.
    """

    name: str
    indices: tuple[int, ...]
    deviation: tuple[float, ...]
    stage: int
    tried: bool = True


def families_of(
    gathered: Gathered,
    layout: Layout,
    defocus_mm: Float[np.ndarray, " groups"],
    allowed: Collection[str] | None = None,
) -> tuple[Family, ...]:
    """All families that these photographs could show; only those allowed, by name."""
    blocks = layout.blocks
    groups = np.arange(len(gathered.groups)) + blocks["defocus"].start
    spread = np.maximum(0.5 * np.abs(defocus_mm[: len(groups)]), 0.3)
    found = [Family("defocus", _ints(groups), tuple(spread), COARSE, tried=False)]
    if layout.anamorphic:
        found += _of_cylinders(gathered, layout, spread)
    found += _orders(gathered, layout)
    if gathered.colour:
        found += _colours(layout)
    found += _opening(gathered, layout, defocus_mm)
    asymmetric = [
        i
        for i, t in enumerate(layout.terms)
        if t in decentring_terms() and not (layout.anamorphic and t in _GAUGE)
    ]
    if len(gathered.take) >= _FEWEST_FOR_ORDER[5]:
        found.append(_family("decentred_elements", asymmetric, _ASYMMETRIC_UM, FINE))
    exit_pupil = _range(blocks["exit_pupil"])
    found.append(_family("exit_pupil", exit_pupil, 0.5, FINE))
    if allowed is None:
        return tuple(found)
    # The focus of the other section belongs to the first one's.
    names = {*allowed, "beyond"} if "defocus" in allowed else {*allowed}
    return tuple(f for f in found if f.name in names)


def deviation_of(
    families: tuple[Family, ...], layout: Layout, stage: int
) -> Float[np.ndarray, " parameters"]:
    """Prior deviations of the families that are free at a stage; 0 elsewhere."""
    deviation = np.zeros(layout.size)
    for family in families:
        if family.stage <= stage:
            deviation[list(family.indices)] = family.deviation
    return deviation


def indices_of(families: tuple[Family, ...]) -> Int[np.ndarray, " parameters"]:
    """All their parameters."""
    return np.array([i for family in families for i in family.indices], int)


def _orders(gathered: Gathered, layout: Layout) -> list[Family]:
    found = []
    for order, name in _ORDER_NAMES.items():
        which = [i for i, t in enumerate(layout.terms) if t.order == order and _even(t)]
        enough = len(gathered.take) >= _FEWEST_FOR_ORDER.get(order, 0)
        if which and enough:
            deviation = _THIRD_ORDER_UM / (1 + (order - 3) / 2) ** 1.5
            tried = order > 3
            stage = _ORDER_STAGE[order]
            found.append(_family(f"{name}_order", which, deviation, stage, tried=tried))
    return found


def _of_cylinders(
    gathered: Gathered, layout: Layout, spread: Float[np.ndarray, " groups"]
) -> list[Family]:
    """What an anamorphic lens has besides."""
    beyond = np.arange(len(spread)) + layout.blocks["beyond"].start
    found = [Family("beyond", _ints(beyond), tuple(_BEYOND * spread), COARSE, False)]
    kinds: dict[str, list[int]] = {}
    for i, term in enumerate(layout.terms):
        if term in two_mirror_terms(term.order) and term not in _GAUGE:
            kinds.setdefault(_cylinder_name(term), []).append(i)
    for name, which in kinds.items():
        order = layout.terms[which[0]].order
        if len(gathered.take) >= _FEWEST_FOR_ORDER.get(order, 0):
            deviation = _CYLINDER_UM / (1 + (order - 3) / 2) ** 1.5
            found.append(_family(name, which, deviation, _ORDER_STAGE[order]))
    return found


def _cylinder_name(term: Term) -> str:
    """Third order is one family; of the fifth there are too many to enter together."""
    if term.order == _LOWEST:
        return "cylinders_third_order"
    return f"cylinders_fifth_{_CYLINDER_KINDS.get(term.degree, 'spherical')}"


def _even(term: Term) -> bool:
    """Whether a centred lens has it."""
    return term.part == "re" and term.field_order == term.order_u


def _colours(layout: Layout) -> list[Family]:
    start = layout.blocks["colour"].start
    count = len(layout.colour_terms)

    def of_order(order: int, power: int = 1) -> list[int]:
        """Where coefficients of a power of the chromatic coordinate lie."""
        first = start + (power - 1) * count
        orders = enumerate(t.order for t in layout.colour_terms)
        return [first + i for i, one in orders if one == order]

    return [
        _family("axial_colour", of_order(1), _COLOUR_UM, COARSE),
        _family("colour_of_third_order", of_order(3), _COLOUR_UM, MIDDLE),
        _family("colour_of_fifth_order", of_order(5), _COLOUR_UM / 2, FINE),
        _family("axial_colour_curved", of_order(1, 2), _COLOUR_UM, MIDDLE),
        _family("colour_of_third_order_curved", of_order(3, 2), _COLOUR_UM, FINE),
    ]


def stops_shown(
    gathered: Gathered, defocus_mm: Float[np.ndarray, " groups"]
) -> Bool[np.ndarray, " stops"]:
    """Which f-numbers besides the widest were photographed so far out of focus that
    dots show the stop's radius.

    The variance of a disc is a quarter of its radius squared. Where it is not much more
    than the hole's, a small error of the hole or of the pixel counts for a large one of
    the stop, whose f-number says more than its dots do.
    """
    dots = gathered.dots
    tangent = float(gathered.scale.reference_sine) * np.asarray(dots.stop_radius)
    disc_mm2 = (defocus_mm[np.asarray(dots.group)] * tangent) ** 2 / 4
    shows = disc_mm2 > _SHOWN * hole_variance_mm2(dots)
    stops = range(1, len(gathered.f_numbers))
    return np.array([bool(shows[dots.stop == k].any()) for k in stops], bool)


def _opening(
    gathered: Gathered, layout: Layout, defocus_mm: Float[np.ndarray, " groups"]
) -> list[Family]:
    blocks = layout.blocks
    rims = _range(blocks["rim_shift"]) + _range(blocks["rim_radius"])
    wide = (*[0.5] * (2 * layout.rims), *[0.3] * (2 * layout.rims))
    found = [Family("rims", tuple(rims), wide, COARSE, tried=False)]
    # Freed far from the solution, pupil coma would stand for a rim, and stay there.
    coma = _range(blocks["stop_shift"])
    found.append(_family("pupil_coma", coma, _PUPIL_COMA, LAST, tried=False))
    found.append(_family("pupil_stretch", _range(blocks["stretch"]), 0.2, FINE))
    squeeze, rotation, curvature = _range(blocks["iris"])
    found.append(_family("pupil_squeeze", [squeeze], 0.05, FINE))
    stops = len(gathered.f_numbers) - 1
    if stops:
        shown = np.flatnonzero(stops_shown(gathered, defocus_mm))
        ratios = [blocks["stop_ratio"].start + int(k) for k in shown]
        if ratios:
            width = gathered.widths.f_number
            found.append(_family("stop_ratios", ratios, width, FINE))
        blades = Family("blades", (rotation, curvature), (3.0, 1.0), FINE, tried=False)
        found.append(blades)
    return found


def _family(
    name: str, indices: list[int], deviation: float, stage: int, *, tried: bool = True
) -> Family:
    return Family(name, _ints(indices), (deviation,) * len(indices), stage, tried)


def _ints(indices) -> tuple[int, ...]:
    return tuple(int(i) for i in indices)


def _range(where: slice) -> list[int]:
    return list(range(where.start, where.stop))
