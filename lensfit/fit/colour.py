"""Lateral colour from the same marks measured in every channel.

The chart cancels: red minus green of one dot does not depend on where the dot was
printed. What remains is linear in the coefficients of `lensfit.optics.lateral`, so it
is solved in closed form with robust weights. Wide apertures add the colour of coma to a
centroid, so the smallest aperture with enough marks is used; there, what
`wavefront.place` takes off is small, and so is its error.

Smooth errors that no residual shows are counted as `fit.uncertainty` does it: all terms
of the largest model are taken to be off together, by `SYSTEMATIC_PX` over the marks.

Colour need not be centred on the principal point: tilted elements move the one without
the other. Where the evidence asks for it the terms of such a lens are fitted too, since
a radial formula about the wrong point misses most where it matters, at the edge.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from lensfit.coords import mm_from_px
from lensfit.detect.observations import POINT, Observations
from lensfit.fit.take import Take
from lensfit.fit.views import variance_of
from lensfit.optics.lateral import ChannelShift, lopsided_basis

_FEWEST_MARKS = 40
_MOST_RADIAL_TERMS = 4
_CENTRED, _SHIFTED, _LOPSIDED = 0, 2, 6
"""Terms besides the radial ones: none, the shift, and strain and decentering too."""
_ROUNDS = 6
SYSTEMATIC_PX = 0.004
"""Root mean square of how far marks are moved. Of thirty random traced lenses the
median errors of red and blue along either axis were .003 and .005, those of the
deviations stated without it .001."""
_LEAST_BIC_GAIN = 6.0
_TINY = 1e-12


@dataclass(frozen=True, eq=False)
class ChannelColour:
    """Lateral displacement of one channel against green.

    Attributes
    ----------
    radial : c0, c1, ..., zero where they were left.
    shift_mm : Constant displacement.
    strain, decentering : As in `lensfit.optics.lateral`; empty when left.
    covariance : Of (shift x, shift y, strain, decentering, c0, c1, ...), in reference
        radii, also of what was left.
    valid_radius : Largest radius measured, in reference radii.
    """

    radial: tuple[float, ...]
    shift_mm: tuple[float, float]
    strain: tuple[float, ...]
    decentering: tuple[float, ...]
    covariance: Float[np.ndarray, "parameters parameters"]
    valid_radius: float

    def radial_px(
        self, radius: Float[np.ndarray, " radii"], px_per_radius: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Outward displacement at radii (in reference radii), and its sigma; px.

        The mean over azimuths, over which shift, strain and decentering cancel.
        """
        powers = radius[:, None] ** (2 * np.arange(len(self.radial)) + 1)
        value = powers @ np.asarray(self.radial) if self.radial else 0 * radius
        part = self.covariance[_LOPSIDED:, _LOPSIDED:]
        variance = np.einsum("ri,ij,rj->r", powers, part, powers)
        return value * px_per_radius, np.sqrt(np.maximum(variance, 0)) * px_per_radius

    def deviations(
        self, q: Float[np.ndarray, "points 2"]
    ) -> Float[np.ndarray, "points 2"]:
        """Standard deviation along x and y at radius vectors, in reference radii."""
        count = len(self.covariance)
        design = _displacements(q)[..., :count]
        variance = np.einsum("pia,ab,pib->pi", design, self.covariance, design)
        return np.sqrt(np.maximum(variance, 0.0))

    def optics(self) -> ChannelShift:
        """The same for computing."""
        strain, decentering = (
            np.array([*part, 0.0, 0.0][:2]) for part in (self.strain, self.decentering)
        )
        return ChannelShift(
            jnp.asarray(np.array(self.radial, float)),
            jnp.asarray(np.array(self.shift_mm)),
            jnp.asarray(self.valid_radius),
            jnp.asarray(strain),
            jnp.asarray(decentering),
        )

    def lopsided(self, radius: float) -> float:
        """Largest displacement by strain and decentering at a radius, reference radii.

        A decentering term moves by three times its coefficient along its own axis.
        """
        strain = np.linalg.norm(self.strain)
        decentering = np.linalg.norm(self.decentering)
        return float(strain * radius + 3 * decentering * radius**2)


class _Marks(NamedTuple):
    """Marks seen in one channel and in green.

    Attributes
    ----------
    place_mm : From the principal point.
    moved_mm : From where green is.
    normal : Of lines; NaN for points.
    variance_mm2 : Of the displacement; of a line, along its normal.
    pixel_mm : Width of a pixel.
    shared_mm : How displacements move together.
    """

    place_mm: Float[np.ndarray, "marks 2"]
    moved_mm: Float[np.ndarray, "marks 2"]
    normal: Float[np.ndarray, "marks 2"]
    variance_mm2: Float[np.ndarray, " marks"]
    pixel_mm: Float[np.ndarray, " marks"]
    shared_mm: Float[np.ndarray, "marks moves 2"]


class _Equations(NamedTuple):
    """What the coefficients of all terms should make, in reference radii.

    Attributes
    ----------
    design : Displacement per unit of every term.
    target : The measured one.
    variance : Of every mark.
    pulls : What the target moves by, together.
    px : Width of a pixel.
    """

    design: Float[np.ndarray, "equations terms"]
    target: Float[np.ndarray, " equations"]
    variance: Float[np.ndarray, " marks"]
    pulls: Float[np.ndarray, "equations moves"]
    px: float


class _Solution(NamedTuple):
    """Coefficients, their covariance, and the squared residual and weight of every
    mark."""

    beta: Float[np.ndarray, " terms"]
    covariance: Float[np.ndarray, "terms terms"]
    squared: Float[np.ndarray, " marks"]
    weight: Float[np.ndarray, " marks"]


def fit_colour(
    takes: tuple[Take, ...],
    principal_point_mm: Float[np.ndarray, "2"],
    reference_radius_mm: float,
) -> dict[str, ChannelColour]:
    """Red and blue against green; empty when the photographs have no colour.

    Clipped marks are used where there are too few others. What is cut off a lopsided
    spot moves its centroid by tenths of a pixel, but much alike in all channels.
    """
    for left_out in (_touched_or_clipped, _touched):
        found = _of_marks(takes, left_out, principal_point_mm, reference_radius_mm)
        if found:
            return found
    return {}


_LeftOut = Callable[[Observations], Bool[np.ndarray, " marks"]]
"""Which marks a fit does without."""


def _touched_or_clipped(o: Observations) -> Bool[np.ndarray, " marks"]:
    return o.overlapping | o.saturated


def _touched(o: Observations) -> Bool[np.ndarray, " marks"]:
    return o.overlapping


def _of_marks(
    takes: tuple[Take, ...],
    left_out: _LeftOut,
    principal_point_mm: Float[np.ndarray, "2"],
    reference_radius_mm: float,
) -> dict[str, ChannelColour]:
    """Of all marks but some; empty when there are too few."""
    found = {}
    chosen = _chosen(takes, left_out)
    for channel, index in (("r", 0), ("b", 2)):
        every = [_marks_of(t, index, left_out, principal_point_mm) for t in chosen]
        seen = [marks for marks in every if len(marks.place_mm)]
        if not seen or sum(len(marks.place_mm) for marks in seen) < _FEWEST_MARKS:
            return {}
        found[channel] = _fit(_joined(seen), reference_radius_mm)
    return found


def _chosen(takes: tuple[Take, ...], left_out: _LeftOut) -> list[Take]:
    """The takes at the smallest aperture that has enough marks in colour."""
    coloured = [t for t in takes if np.isfinite(t.observations.channel_points_px).any()]
    for number in sorted({t.f_number or 0.0 for t in coloured}, reverse=True):
        chosen = [t for t in coloured if (t.f_number or 0.0) == number]
        if sum(_usable(t.observations, left_out) for t in chosen) >= _FEWEST_MARKS:
            return chosen
    return coloured


def _usable(o: Observations, left_out: _LeftOut) -> int:
    """How many marks are seen in all three channels."""
    seen = np.isfinite(o.channel_points_px).all((0, 2))
    return int((seen & ~left_out(o)).sum())


def _marks_of(
    take: Take, index: int, left_out: _LeftOut, centre_mm: Float[np.ndarray, "2"]
) -> _Marks:
    """Of the channel `index` in one take."""
    o = take.observations
    places = o.channel_points_px
    keep = np.isfinite(places[index]).all(-1) & np.isfinite(places[1]).all(-1)
    keep &= ~left_out(o)
    mm_per_px = take.sensor_size_mm[0] / o.image_size_px[0]
    moved = (places[index] - places[1])[keep] * mm_per_px
    covariance = (o.channel_covariance_px2[index] + o.channel_covariance_px2[1])[keep]
    normal = np.where((o.family != POINT)[:, None], o.normal, np.nan)[keep]
    green = mm_from_px(places[1][keep], o.image_size_px, take.sensor_size_mm)
    shared = np.zeros((len(moved), 0, 2))
    if take.shared_moves_mm is not None:
        by_channel = take.shared_moves_mm[:, :, keep]
        shared = (by_channel[:, index] - by_channel[:, 1]).swapaxes(0, 1)
    return _Marks(
        place_mm=green - centre_mm,
        moved_mm=moved,
        normal=normal,
        variance_mm2=variance_of(covariance, normal) * mm_per_px**2,
        pixel_mm=np.full(len(moved), mm_per_px),
        shared_mm=shared,
    )


def _joined(seen: list[_Marks]) -> _Marks:
    """Of all takes; shared moves that a take lacks are zero there."""
    most = max(marks.shared_mm.shape[1] for marks in seen)
    alike = [
        marks._replace(
            shared_mm=np.pad(
                marks.shared_mm,
                [(0, 0), (0, most - marks.shared_mm.shape[1]), (0, 0)],
            )
        )
        for marks in seen
    ]
    return _Marks(*(np.concatenate(parts) for parts in zip(*alike, strict=True)))


def _fit(marks: _Marks, reference_radius_mm: float) -> ChannelColour:
    """Smallest model that BIC prefers.

    Squared residuals are cut at four times the spread of the largest model, so that
    a few bad marks decide nothing.
    """
    models = [
        (besides, terms)
        for besides in (_CENTRED, _SHIFTED, _LOPSIDED)
        for terms in range(_MOST_RADIAL_TERMS + 1)
    ]
    equations = _equations_of(marks, reference_radius_mm)
    solved = [_solve(equations, *model) for model in models]
    limit = 16 * np.median(solved[-1].squared) / np.log(4)
    count = _rows_in(marks.normal)
    best = None
    for (besides, terms), solution in zip(models, solved, strict=True):
        squared = np.minimum(solution.squared, limit)
        level = np.mean(squared) + (1e-3 * equations.px) ** 2
        bic = count * np.log(level) + (besides + terms) * np.log(count)
        if best is None or bic < best[0] - _LEAST_BIC_GAIN:
            best = (bic, solution, besides)
    assert best is not None
    _, (beta, covariance, *_), besides = best
    covariance = covariance + _systematic(equations, solved[-1].weight)
    lopsided = tuple(beta[_SHIFTED:_LOPSIDED].tolist()) if besides == _LOPSIDED else ()
    radius = np.hypot(*(marks.place_mm / reference_radius_mm).T)
    return ChannelColour(
        radial=tuple(beta[_LOPSIDED:].tolist()),
        shift_mm=tuple((beta[:_SHIFTED] * reference_radius_mm).tolist()),
        strain=lopsided[:2],
        decentering=lopsided[2:],
        covariance=covariance,
        valid_radius=float(radius.max()),
    )


def _equations_of(marks: _Marks, reference_radius_mm: float) -> _Equations:
    q = marks.place_mm / reference_radius_mm
    normal, shared = marks.normal, marks.shared_mm / reference_radius_mm
    target = _targets(marks.moved_mm / reference_radius_mm, normal)
    pulls = [_targets(shared[:, k], normal) for k in range(shared.shape[1])]
    return _Equations(
        design=_design(q, normal),
        target=target,
        variance=marks.variance_mm2 / reference_radius_mm**2,
        pulls=np.array(pulls).reshape(len(pulls), len(target)).T,
        px=float(marks.pixel_mm.mean()) / reference_radius_mm,
    )


def _systematic(
    equations: _Equations, weight: Float[np.ndarray, " marks"]
) -> Float[np.ndarray, "terms terms"]:
    """Covariance of all terms that together move the marks by `SYSTEMATIC_PX`."""
    a = equations.design
    explained = (SYSTEMATIC_PX * equations.px) ** 2 * float(weight.sum())
    matrix = (a.T * np.repeat(weight, 2)) @ a
    return np.linalg.inv(matrix + _TINY * np.eye(len(matrix))) * explained / len(matrix)


def _rows_in(normal: np.ndarray) -> int:
    """Equations: two for a point, one for a sample of a line."""
    return int(np.where(np.isfinite(normal[:, 0]), 1, 2).sum())


def _design(q: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Displacement per unit of every term: shift, strain, decentering, radial terms.

    Two rows a mark; of a line sample the first is along its normal, the second empty.
    """
    design = _displacements(q)
    lines = np.isfinite(normal[:, :1])
    flat = np.einsum("mi,mij->mj", np.nan_to_num(normal), design)[:, None]
    design = np.where(lines[..., None], np.concatenate([flat, 0 * flat], 1), design)
    return design.reshape(2 * len(q), -1)


def _targets(moved: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Measured displacements, in the rows of `_design`."""
    lines = np.isfinite(normal[:, :1])
    across = np.sum(np.nan_to_num(normal) * moved, -1, keepdims=True)
    return np.where(lines, np.concatenate([across, 0 * across], 1), moved).ravel()


def _displacements(q: np.ndarray) -> np.ndarray:
    """Of every term at radius vectors, (points, 2, terms)."""
    r2 = np.sum(q**2, -1)
    columns = [np.tile(e, (len(q), 1)) for e in np.eye(2)]
    columns += list(np.moveaxis(np.asarray(_lopsided_bases(jnp.asarray(q))), 1, 0))
    columns += [q * (r2**k)[:, None] for k in range(_MOST_RADIAL_TERMS)]
    return np.stack(columns, -1)


_lopsided_bases = jax.jit(jax.vmap(lopsided_basis))


def _solve(equations: _Equations, besides: int, terms: int) -> _Solution:
    """Robust linear least squares for some of the terms; the others are zero.

    Parameters
    ----------
    besides, terms : How many lopsided and how many radial ones.
    """
    design, target, variance, pulls, px = equations
    used = np.zeros(design.shape[1], bool)
    used[:besides] = True
    used[_LOPSIDED : _LOPSIDED + terms] = True
    a = design[:, used]
    tiny = _TINY * np.eye(a.shape[1])
    count = int((design != 0).any(1).sum())
    weight = 1 / np.repeat(variance + (0.01 * px) ** 2, 2)
    solution = np.zeros(used.sum())
    for _ in range(_ROUNDS):
        solution = np.linalg.solve((a.T * weight) @ a + tiny, a.T @ (weight * target))
        e = np.linalg.norm((target - a @ solution).reshape(-1, 2), axis=-1)
        scale = max(np.median(e) / 1.1774, 1e-3 * px)
        extra = np.repeat(np.maximum(scale**2 - variance, 0), 2)
        cauchy = np.repeat(1 / (1 + (e / (3 * scale)) ** 2), 2)
        weight = cauchy / (np.repeat(variance, 2) + extra + (2e-3 * px) ** 2)
    residual = target - a @ solution
    chi2 = float(weight @ residual**2)
    covariance = np.zeros((len(used),) * 2)
    inverse = np.linalg.inv((a.T * weight) @ a + tiny)
    follows = inverse @ (a.T @ (weight[:, None] * pulls))
    covariance[np.ix_(used, used)] = (
        inverse * max(chi2 / count, 1.0) + follows @ follows.T
    )
    beta = np.zeros(len(used))
    beta[used] = solution
    squared = np.sum(residual.reshape(-1, 2) ** 2, -1)
    return _Solution(beta, covariance, squared, weight[::2])
