"""The first solve: third order on smoothed dots, from every start still possible.

The defocus common to all takes is poorly known before the fit, since a curved field or
spherical aberration moves the best focus. Once blur is larger than a dot, the solve
cannot cross from one such local minimum to another. The same holds for a field that is
curved to the other side, and for the side of focus where nobody stated it. All starts
run on a few dots, the promising ones on more (`multistart`).

Starts of curvature and astigmatism come from the widths of the dots, before rays are
traced. Out of focus by d a lens draws a disc of radius |d| tan a. Where the field is
curved and astigmatic, d along the radius of the field differs from d across it, and
both grow as the square of the field height h,

    d_along = d + o + a h^2,    d_across = d + o + b h^2,

d being that of the take and o common to all. Both widths of every dot follow from its
second moments. So the misfit of each pair (o, a) and (o, b) is computed over all dots
at once, and the solves that fit whole images start from the pairs with the smallest
misfit. From a flat field they may end with the astigmatism of the wrong side, which
fits each photograph alone.

Reference: W. T. Welford, Aberrations of Optical Systems (1986), on Coddington's
equations.
"""

import itertools
from collections.abc import Collection
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lensfit.fitting.wavefront.dot_arrays import are_corners, are_lines
from lensfit.fitting.wavefront.dot_data import (
    DotData,
    rows_spread_over_takes,
    select_dots,
)
from lensfit.fitting.wavefront.multistart import (
    Candidate,
    best_candidate,
    candidate_at,
    mirrored_candidate,
    open_candidates,
    rejected_candidates,
)
from lensfit.fitting.wavefront.parameters import Layout
from lensfit.fitting.wavefront.stages import (
    first_stage,
    recentre_patches,
    set_priors,
    smooth_stage,
    solve_stage,
    stage_on_dots,
)
from lensfit.fitting.wavefront.start_values import (
    IN_FOCUS_MM,
    FirstDefocus,
    defocus_size_of_variance_mm,
    first_defocus,
    first_parameters,
)
from lensfit.fitting.wavefront.term_groups import (
    COARSE,
    TermGroup,
    candidate_term_groups,
    deviation_of,
)
from lensfit.optics.terms import Term

_GREEN = 1
_FOOT = 0.1
"""Share of a dot's peak below which light is noise, or the tail of coma."""
_COMMON = np.linspace(-1.5, 1.5, 31)
_CURVED = np.linspace(-6.0, 6.0, 121)
"""Values tried, in units of the largest stated or measured defocus."""
_APART = 0.5
"""Two choices closer than this are the same."""
_CURVATURE, _ASTIGMATISM = Term(2, 0, 2, 0), Term(2, 2, 2, 2)
_SLOPE_MM_PER_UM = np.sqrt(2.0) * 1e-3
"""Of a mode of degree 2 at the rim, in terms of its coefficient."""


class Focus(NamedTuple):
    """Where a lens is sharp: defocus on the axis, and the change at the edge of the
    field along its radius and across."""

    axis_mm: Float[np.ndarray, " groups"]
    along_mm: float = 0.0
    across_mm: float = 0.0


def dot_widths_mm(dot_data: DotData) -> Float[np.ndarray, "dots 2"]:
    """Size of the defocus that gives dots their measured widths, along the radius of
    the field and across."""
    field_mm = np.asarray(dot_data.dots.field_mm)
    radius_mm = np.maximum(np.hypot(*field_mm.T), 1e-9)[:, None]
    along = field_mm / radius_mm
    ways = np.stack([along, along[:, ::-1] * [-1.0, 1.0]])
    variance = np.einsum("wdi,dij,wdj->wd", ways, _moments_mm2(dot_data), ways)
    return defocus_size_of_variance_mm(dot_data, variance).T


def likely_focus(
    dot_data: DotData,
    widths_mm: Float[np.ndarray, "dots 2"],
    stated_mm: Float[np.ndarray, " groups"],
    most: int,
) -> list[Focus]:
    """The choices with the smallest misfit to the widths of the dots, best first.

    Parameters
    ----------
    widths_mm : From `dot_widths_mm`.
    stated_mm : Defocus of every group without the common offset; NaN leaves its dots
        out.
    most : How many.
    """
    of_dot_mm = stated_mm[dot_data.dots.group]
    seen = np.isfinite(of_dot_mm) & np.isfinite(widths_mm).all(-1)
    if not seen.any():
        return []
    height = np.hypot(*np.asarray(dot_data.dots.field_mm).T)
    square = (height / float(dot_data.scale.field_radius_mm))[seen] ** 2
    unit_mm = float(np.nanmax(np.abs(stated_mm)))
    unit_mm = max(unit_mm, float(np.median(widths_mm[seen])))
    common_mm, curved_mm = unit_mm * _COMMON, unit_mm * _CURVED
    axis_mm = of_dot_mm[seen] + common_mm[:, None]
    modelled = np.abs(axis_mm[:, None] + curved_mm[:, None] * square)
    misfit = [np.abs(modelled - w).mean(-1) for w in widths_mm[seen].T]
    total = misfit[0][:, :, None] + misfit[1][:, None]
    places = np.stack(
        np.meshgrid(common_mm, curved_mm, curved_mm, indexing="ij"), -1
    ).reshape(-1, 3)
    best = _distinct(places, total.reshape(-1), _APART * unit_mm, most)
    return [Focus(stated_mm + o, float(a), float(b)) for o, a, b in best]


def set_focus(
    parameters: Float[np.ndarray, " parameters"],
    layout: Layout,
    focus: Focus,
    reference_sine: float,
) -> Float[np.ndarray, " parameters"]:
    """The same lens focused so; curvature is a mode whose mean over the field is 0."""
    found = parameters.copy()
    um_per_mm = reference_sine / _SLOPE_MM_PER_UM
    curvature_um = um_per_mm * (focus.along_mm + focus.across_mm) / 4
    astigmatism_um = um_per_mm * (focus.along_mm - focus.across_mm) / 2
    coefficients = found[layout.blocks["coefficients"]]
    coefficients[layout.terms.index(_CURVATURE)] = curvature_um
    coefficients[layout.terms.index(_ASTIGMATISM)] = astigmatism_um
    mean_mm = curvature_um / um_per_mm
    found[layout.blocks["defocus"]][: len(focus.axis_mm)] = focus.axis_mm + mean_mm
    return found


def _distinct(
    places: Float[np.ndarray, "places 3"],
    misfit: Float[np.ndarray, " places"],
    apart_mm: float,
    most: int,
) -> list[np.ndarray]:
    """The best places, each far from those before."""
    found: list[np.ndarray] = []
    left = misfit.copy()
    while len(found) < most:
        one = places[int(np.argmin(left))]
        found.append(one)
        left[np.abs(places - one).max(-1) < apart_mm] = np.inf
    return found


def _moments_mm2(dot_data: DotData) -> Float[np.ndarray, "dots 2 2"]:
    """Second moments of the green light of every dot, of the blur of a corner's edges
    or of the light across a line, cells taken off."""
    light = np.where(dot_data.valid, dot_data.light, 0.0)[:, _GREEN]
    light = light - np.median(light, (-2, -1), keepdims=True)
    peak = light.max((-2, -1), keepdims=True)
    light = np.where(light > _FOOT * peak, light, 0.0)
    cell_mm = np.asarray(dot_data.dots.cell_mm)
    steps = np.arange(light.shape[-1])
    with np.errstate(divide="ignore", invalid="ignore"):
        light = light / light.sum((-2, -1), keepdims=True)
    places = np.stack([light.sum(-2), light.sum(-1)], 1)
    mean = places @ steps
    away = steps - mean[..., None]
    mixed = np.einsum("drc,dr,dc->d", light, away[:, 1], away[:, 0])
    xx, yy = ((places * away**2).sum(-1) - 1 / 12).T
    square = np.stack([np.stack([xx, mixed], -1), np.stack([mixed, yy], -1)], -1)
    square_mm2 = square * cell_mm[:, :, None] * cell_mm[:, None]
    # Edges that cross determine the width of their blur, but not its direction.
    broad = dot_data.dots.broad
    if broad is not None:
        edges = are_corners(broad) | are_lines(broad)
        even_mm2 = dot_data.diameter_mm[edges] ** 2 / 16
        square_mm2[edges] = even_mm2[:, None, None] * np.eye(2)
    return square_mm2


_SMOOTHING = 3.0
_MOST_SIGNS = 3
_HOPELESS_START, _HOPELESS = 3.0, 1.5
"""Largest cost over the best one's: after one short solve on few dots, where some
starts have not converged yet; and at the end."""
_FEW_DOTS = 4
"""Of each take, for the many starts of known sign. With unknown signs so few dots would
decide between a lens and its mirror image by their positions."""
_FINALISTS = 4
"""How many are solved with all dots; the next stage, as cheap, may use them all."""


class _StartOffsets(NamedTuple):
    """How many starts there are for each choice of signs.

    Attributes
    ----------
    offsets_from_measured, offsets_from_stated : Defocus common to all takes, in units
        of the largest measured one: added to the measured defocus of each take, and to
        the stated one.
    curved : Number of curved fields (`likely_focus`).
    """

    offsets_from_measured: tuple[float, ...]
    offsets_from_stated: tuple[float, ...]
    curved: int


_START_OFFSETS = (
    _StartOffsets(
        (0.0, -0.5, 0.5, -1.0, 1.0), (0.0, -0.5, 0.5, -1.0, 1.0, -2.0, 2.0), 4
    ),
    _StartOffsets((0.0,), (0.0, -1.0, 1.0), 2),
    _StartOffsets((0.0,), (), 1),
)
"""By the number of unknown signs: none, one, more. Each doubles the starts."""


class CoarseFit(NamedTuple):
    """Result of the first solve.

    Attributes
    ----------
    candidates : Local minima that the photographs do not exclude, ranked by
        statements.
    rejected : The other candidates where they were rejected, lowest cost first.
    side_stated : Whether statements determine the side of focus: those of every take;
        a statement that the chart was in focus does not.
    term_groups : Term groups that are free in this stage and the next.
    """

    candidates: list[Candidate]
    rejected: list[Candidate]
    side_stated: bool
    term_groups: tuple[TermGroup, ...]


def coarse_fit(
    dot_data: DotData,
    layout: Layout,
    allowed: Collection[str] | None = None,
) -> CoarseFit:
    """Third order, from the starts that fit the photographs best."""
    first = first_defocus(dot_data)
    term_groups = candidate_term_groups(dot_data, layout, first.value_mm, allowed)
    deviation = deviation_of(term_groups, layout, COARSE)
    perfect = first_parameters(dot_data, layout, first.value_mm)
    all_stated = bool(first.side_stated.all())
    side_stated = all_stated and bool(np.any(np.abs(first.value_mm) > IN_FOCUS_MM))
    some = dot_data
    if all_stated:
        some = select_dots(dot_data, rows_spread_over_takes(dot_data, _FEW_DOTS))
    tries = []
    sine = float(dot_data.scale.reference_sine)
    for focus in _start_foci(dot_data, first, curved=not layout.anamorphic):
        lens = set_focus(perfect, layout, focus, sine)
        # Parameters that are not free here keep the values of a perfect lens.
        parameters = np.where(deviation > 0, lens, perfect)
        stage = smooth_stage(first_stage(some, layout, parameters), _SMOOTHING)
        # Most starts fail: recentring their patches once is enough.
        tries.append(
            candidate_at(solve_stage(recentre_patches(set_priors(stage, deviation), 1)))
        )
    candidates, rejected = _finalists(tries, dot_data, side_stated)
    return CoarseFit(candidates, rejected, side_stated, term_groups)


def solve_on_all_dots(one: Candidate, dot_data: DotData) -> Candidate:
    """The candidate of some dots, solved with all."""
    return candidate_at(
        solve_stage(recentre_patches(stage_on_dots(one.stage, dot_data)))
    )


def _finalists(
    tries: list[Candidate], dot_data: DotData, side_stated: bool
) -> tuple[list[Candidate], list[Candidate]]:
    """Promising candidates, on all dots; and the rejected ones."""
    both_sides = not side_stated
    begun = open_candidates(tries, _HOPELESS_START, _FINALISTS, both_sides=both_sides)
    ended = [solve_on_all_dots(one, dot_data) for one in begun]
    if both_sides:
        ended.append(mirrored_candidate(best_candidate(ended)))
    kept = open_candidates(ended, _HOPELESS, _FINALISTS, both_sides=both_sides)
    return kept, [*rejected_candidates(ended, kept), *rejected_candidates(tries, begun)]


def _start_foci(dot_data: DotData, first: FirstDefocus, *, curved: bool) -> list[Focus]:
    """Starts at the measured defocus; and at the stated one, since aberrations widen
    dots, with all takes shifted by the same amount, or with curved fields: those
    last."""
    patterns = _sign_patterns(first)
    open_signs = (len(patterns) - 1).bit_length()
    tries = _START_OFFSETS[min(open_signs, len(_START_OFFSETS) - 1)]
    unit_mm = float(np.max(first.size_mm))
    as_stated_mm = np.where(first.side_stated, first.stated_mm, first.value_mm)
    begun = (
        (first.value_mm, tries.offsets_from_measured),
        (as_stated_mm, tries.offsets_from_stated),
    )
    flat = [
        Focus(defocus_mm * signs + offset * unit_mm)
        for signs in patterns
        for defocus_mm, offsets in begun
        for offset in offsets
    ]
    if not curved:
        return flat
    widths_mm = dot_widths_mm(dot_data)
    bent = [
        focus
        for signs in patterns
        for focus in likely_focus(
            dot_data, widths_mm, as_stated_mm * signs, tries.curved
        )
    ]
    return flat + bent


def _sign_patterns(first: FirstDefocus) -> list[Float[np.ndarray, " groups"]]:
    """Signs to try: every combination for the few largest defocus values that nobody
    stated; others stay as they are."""
    unknown = np.flatnonzero(~first.side_stated)
    unknown = unknown[np.argsort(-np.abs(first.value_mm[unknown]))][:_MOST_SIGNS]
    tries = []
    for flips in itertools.product((1.0, -1.0), repeat=len(unknown)):
        signs = np.ones(len(first.value_mm))
        signs[unknown] = flips
        tries.append(signs)
    return tries
