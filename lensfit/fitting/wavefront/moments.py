"""Curvature and astigmatism from the widths of the dots, before rays are traced.

Out of focus by d a lens draws a disc of radius |d| tan a. Where the field is curved and
astigmatic, d along the radius of the field differs from d across it, and both grow as
the square of the field height h,

    d_along = d + o + a h^2,    d_across = d + o + b h^2,

d being that of the take and o common to all. Both widths of every dot follow from its
second moments. So the misfit of each pair (o, a) and (o, b) is computed over all dots
at once, and the solves that fit whole images start from the pairs with the smallest
misfit. From a flat field they may end with the astigmatism of the wrong side, which
fits each photograph alone.

Reference: W. T. Welford, Aberrations of Optical Systems (1986), on Coddington's
equations.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lensfit.fitting.wavefront.dot_arrays import are_corners, are_lines
from lensfit.fitting.wavefront.dot_data import DotData
from lensfit.fitting.wavefront.parameters import Layout
from lensfit.fitting.wavefront.start_values import defocus_size_of_variance_mm
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
