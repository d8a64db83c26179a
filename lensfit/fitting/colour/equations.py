"""Linear equations of lateral colour, for one state and for all states of a lens.

    measured displacement = terms of the state + common errors + noise

The common errors are those of the wavefront whose centroid biases were subtracted from
the detections. They are the same at every focus distance, so that a chart photographed
at f/8 in one state determines the chromatic coma that biases centroids at f/2.8 in all
states. Each has a prior of its standard deviation (random effects), and is solved for
together with the coefficients of all states.

The shape of spots that are about a pixel wide tells little of how coma changes with
wavelength, while the same error moves their centroids by tenths of a pixel, as the
square of the aperture. What the wavefront's terms of colour move is therefore found
here too. How large these errors are is not known beforehand: as a share of what any
lens has it is the one most likely from this lens' own photographs (restricted maximum
likelihood), with third order alone, since higher orders can stand for whatever is left.
Photographs at one stop alone do not tell, and get the share that is usual.

Systematic errors that residuals do not show are added as in `fitting.systematic`, over
all terms of the largest model. They are taken to be as large as those that do show:
every photograph has smooth errors of its own, by which it differs from the others
beyond its noise (`systematic_px`).

Reference: C. R. Henderson, Biometrics 31 (1975) 423, on fixed and random effects
together; H. D. Patterson and R. Thompson, Biometrika 58 (1971) 545, on the likelihood;
on the scatter of groups as a component of variance, Henderson, Biometrics 9 (1953) 226.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from lensfit.fitting.colour.coloured_detections import (
    ColouredDetections,
    with_as_many_columns,
)
from lensfit.fitting.systematic import covariance_of_equations, systematic_covariance
from lensfit.optics.lateral import displacement_basis

CENTRED, SHIFTED, LOPSIDED = 0, 2, 6
"""Terms besides the radial ones: none, the shift, and strain and decentering too."""
MOST_RADIAL_TERMS = 4
TERMS = LOPSIDED + MOST_RADIAL_TERMS
_USUAL_SYSTEMATIC_PX, _USUAL_COUNT = 0.003, 4.0
"""Root mean square of how far systematic errors move detections where photographs do
not tell, as in thirty random traced lenses, and how many independent differences
between photographs this is worth."""
_ALIKE_PX = 0.001
"""Of errors that all photographs share, so that none tells: of traced lenses those of
blue exceed what their photographs differ by. A constant learnt from examples; colour of
higher order in the wavefront would do without."""
_SHARES = np.geomspace(1e-3, 1.0, 31)
_USUAL_SHARE, _LOG_SHARE_DEVIATION = 0.02, 1.5
"""Of traced lenses: shares of .01 to .16 were found. A constant learnt from examples,
which counts where photographs do not tell; coma of colour that is computed from glass
and powers would do without."""
_THIRD = 3
_ROUNDS = 6
_TINY = 1e-12
_LEAST_APART = 0.05
"""Share of a solution that the other photographs have, at least, for one photograph to
differ from it."""
_FLOOR_PX = 2e-3
_LEAST_SCALE_PX = 1e-3
_FIRST_SCALE_PX = 0.01
_CAUCHY_SCALE = 3.0
_MEDIAN_LENGTH = 1.1774
"""Of a residual of two dimensions, in standard deviations."""


class Equations(NamedTuple):
    """What the coefficients of all terms should make, in reference radii.

    Attributes
    ----------
    design : Displacement per unit of every term.
    target : The measured one.
    variance : Of every detection.
    pulls : What the target moves by, together.
    by_colour : What it moves by, by the wavefront's terms of colour.
    third_order : Which of these are of third order or lower.
    take : Which photograph each detection is on.
    px : Width of a pixel.
    """

    design: Float[np.ndarray, "equations terms"]
    target: Float[np.ndarray, " equations"]
    variance: Float[np.ndarray, " detections"]
    pulls: Float[np.ndarray, "equations moves"]
    by_colour: Float[np.ndarray, "equations terms_of_colour"]
    third_order: Bool[np.ndarray, " terms_of_colour"]
    take: Int[np.ndarray, " detections"]
    px: float


class NormalEquations(NamedTuple):
    """Of the coefficients of all states, one after the other, and of the moves.

    Attributes
    ----------
    matrix, vector, square : Of the weighted sum of squares.
    weight : Of every detection, for each state.
    states : How many.
    rows : How many equations were measured.
    share : Of what any lens has, as large as errors by colour are.
    """

    matrix: Float[np.ndarray, "unknowns unknowns"]
    vector: Float[np.ndarray, " unknowns"]
    square: float
    weight: list[Float[np.ndarray, " detections"]]
    states: int
    rows: int
    share: float

    def solution(self, besides: int, terms: int, level: float) -> "Solution":
        """With some of the terms in every state; the others are zero.

        Parameters
        ----------
        besides, terms : How many lopsided and how many radial ones.
        level : Variance of the equations, which that of the moves is not scaled by.
        """
        free = np.append(
            self._free_coefficients(besides, terms), np.ones(len(self._moves), bool)
        )
        square, prior = np.ix_(free, free), np.diag(self.precision[free])
        beta, covariance = np.zeros(len(free)), np.zeros((len(free),) * 2)
        beta[free] = np.linalg.solve(self.matrix[square], self.vector[free])
        measured = (self.matrix[square] - prior) / level + prior
        covariance[square] = np.linalg.inv(measured)
        return Solution(beta, covariance)

    def chi2(
        self, besides: int, terms: int, moves: Float[np.ndarray, " moves"]
    ) -> float:
        """Weighted sum of squares with some of the terms, the moves held."""
        used, held = (
            np.flatnonzero(self._free_coefficients(besides, terms)),
            self._moves,
        )
        left = self.vector - self.matrix[:, held] @ moves
        beta = np.linalg.solve(self.matrix[np.ix_(used, used)], left[used])
        of_moves = moves @ (self.vector[held] + left[held] + moves)
        return self.square - float(of_moves) - float(left[used] @ beta)

    @property
    def precision(self) -> Float[np.ndarray, " unknowns"]:
        """Of the priors, which the matrix contains."""
        return _precision_of_priors(self.states, len(self._moves))

    @property
    def _moves(self) -> Int[np.ndarray, " moves"]:
        return np.arange(self.states * TERMS, len(self.vector))

    def _free_coefficients(self, besides: int, terms: int) -> np.ndarray:
        """Which coefficients of all states are free."""
        used = np.zeros(TERMS, bool)
        used[:besides] = True
        used[LOPSIDED : LOPSIDED + terms] = True
        return np.tile(used, self.states)


class Solution(NamedTuple):
    """Unknowns as in `NormalEquations`, and their covariance."""

    beta: Float[np.ndarray, " unknowns"]
    covariance: Float[np.ndarray, "unknowns unknowns"]


def equations_of(
    detections: ColouredDetections, reference_radius_mm: float
) -> Equations:
    """Of all terms, two a detection."""
    q = detections.place_mm / reference_radius_mm
    normal = detections.normal
    target = _targets(detections.moved_mm / reference_radius_mm, normal)

    def columns(moves_mm: Float[np.ndarray, "detections moves 2"]) -> np.ndarray:
        moves = moves_mm / reference_radius_mm
        found = [_targets(moves[:, k], normal) for k in range(moves.shape[1])]
        return np.array(found).reshape(len(found), len(target)).T

    return Equations(
        design=_design(q, normal),
        target=target,
        variance=detections.variance_mm2 / reference_radius_mm**2,
        pulls=columns(detections.shared_mm),
        by_colour=columns(detections.by_colour_mm),
        third_order=np.array(detections.colour_orders, int) <= _THIRD,
        take=detections.take,
        px=float(detections.pixel_mm.mean()) / reference_radius_mm,
    )


def normal_equations(states: Sequence[Equations]) -> NormalEquations:
    """Of all states together, with robust weights at the solution of all terms, and the
    most likely size of errors by colour."""
    states = _with_as_many_moves(states)
    weight = [1 / (one.variance + (_FIRST_SCALE_PX * one.px) ** 2) for one in states]
    for _ in range(_ROUNDS):
        share = _most_likely_share(_weighted_equations(states, weight, 1.0), states)
        left = _left_of(states, _weighted_equations(states, weight, share))
        weight = [_robust(*part) for part in zip(states, left, strict=True)]
    return _weighted_equations(states, weight, share)


def systematic_px(states: Sequence[Equations], equations: NormalEquations) -> float:
    """Rms of how far systematic errors move detections: the smooth errors by which
    photographs differ, weighed against those of usual lenses, and those they share.

    The same terms, fitted to what is left of each photograph alone, explain more
    than noise would where photographs differ.
    """
    states = _with_as_many_moves(states)
    left = _left_of(states, equations)
    parts = [
        _own_errors_of(*of_state, take)
        for of_state in zip(states, equations.weight, left, strict=True)
        for take in np.unique(of_state[0].take)
    ]
    usual = _USUAL_SYSTEMATIC_PX**2
    weights = np.array([1 / part.variance(usual) for part in parts if part.count])
    found = np.array([part.square_px2 for part in parts if part.count])
    # As many independent squares have the same scatter as the weighted mean.
    count = 2 * usual**2 * weights.sum()
    measured = max(2 * usual**2 * float(weights @ found), 0.0)
    found_px2 = (_USUAL_COUNT * usual + measured) / (_USUAL_COUNT + count)
    return math.sqrt(found_px2 + _ALIKE_PX**2)


class _OwnErrors(NamedTuple):
    """Smooth errors of one photograph beside those of all.

    Attributes
    ----------
    square_px2 : Mean square; below zero where noise explains more than there is.
    noise_px2 : What noise alone would add to it.
    count : Number of the terms; 0 where there are too few detections.
    """

    square_px2: float
    noise_px2: float
    count: int

    def variance(self, square_px2: float) -> float:
        """Of the mean square, if that is its true value."""
        return 2 * (self.noise_px2 + square_px2) ** 2 / self.count


def _own_errors_of(
    equations: Equations,
    weight: Float[np.ndarray, " detections"],
    left: Float[np.ndarray, " equations"],
    take: int,
) -> _OwnErrors:
    """Those of a photograph.

    Parameters
    ----------
    left : What the terms and moves of all photographs leave.
    """
    mine = equations.take == take
    apart = 1 - float(weight[mine].sum() / weight.sum())
    rows = np.repeat(mine, 2)
    design, w = equations.design[rows], np.repeat(weight[mine], 2)
    matrix, pull = (design.T * w) @ design, design.T @ (w * left[rows])
    measured = int((design != 0).any(1).sum())
    if measured <= 2 * TERMS or apart < _LEAST_APART:
        return _OwnErrors(0.0, 0.0, 0)
    explained = float(pull @ covariance_of_equations(matrix) @ pull)
    level = (float(w @ left[rows] ** 2) - explained) / (measured - TERMS)
    per_px2 = float(weight[mine].sum()) * equations.px**2
    noise_px2 = level * TERMS / per_px2
    # Its share in the solution takes as much of its errors as of its noise.
    return _OwnErrors(explained / per_px2 / apart - noise_px2, noise_px2, TERMS)


def _left_of(
    states: Sequence[Equations], equations: NormalEquations
) -> list[Float[np.ndarray, " equations"]]:
    """What all terms and moves leave of every state."""
    beta = np.linalg.solve(equations.matrix, equations.vector)
    moves = beta[len(states) * TERMS :]
    return [
        one.target
        - one.design @ beta[k * TERMS : (k + 1) * TERMS]
        - _moves_of(one, equations.share) @ moves
        for k, one in enumerate(states)
    ]


def _with_as_many_moves(states: Sequence[Equations]) -> list[Equations]:
    """Moves that a state lacks are zero there."""
    pulls = with_as_many_columns([one.pulls for one in states])
    by_colour = with_as_many_columns([one.by_colour for one in states])
    third_order = max((one.third_order for one in states), key=len)
    return [
        one._replace(pulls=pulls[k], by_colour=by_colour[k], third_order=third_order)
        for k, one in enumerate(states)
    ]


def _most_likely_share(whole: NormalEquations, states: Sequence[Equations]) -> float:
    """Size of errors by colour as a share of what any lens has.

    Parameters
    ----------
    whole : With errors as large as any lens has them.
    """
    third_order = states[0].third_order
    if not third_order.any():
        return _USUAL_SHARE
    others = len(whole.vector) - len(third_order)
    used = np.append(np.arange(others), others + np.flatnonzero(third_order))
    matrix, vector = whole.matrix[np.ix_(used, used)], whole.vector[used]
    own = np.diag(whole.precision[used])
    best = whole.square - vector @ np.linalg.solve(matrix, vector)
    level = max(best / whole.rows, 1.0)
    costs = []
    for share in _SHARES:
        scale = np.where(np.arange(len(used)) < others, 1.0, share)
        scaled = (matrix - own) * np.outer(scale, scale) / level + own
        explained = scale * vector / level
        explained = explained @ np.linalg.solve(scaled, explained)
        unusual = (np.log(share / _USUAL_SHARE) / _LOG_SHARE_DEVIATION) ** 2
        costs.append(np.linalg.slogdet(scaled)[1] - explained + unusual)
    return float(_SHARES[int(np.argmin(costs))])


def systematic_of(
    equations: Equations, weight: Float[np.ndarray, " detections"], effect_px: float
) -> Float[np.ndarray, "terms terms"]:
    """Covariance of all terms, which together move detections by `effect_px` rms."""
    a = equations.design
    explained = (effect_px * equations.px) ** 2 * float(weight.sum())
    matrix = (a.T * np.repeat(weight, 2)) @ a
    return systematic_covariance(matrix, np.full(len(matrix), _TINY), explained)


def _weighted_equations(
    states: Sequence[Equations], weight: list[np.ndarray], share: float
) -> NormalEquations:
    """Coefficients of a state meet those of others only through the moves.

    Parameters
    ----------
    share : Of what any lens has, as large as errors by colour are.
    """
    count = len(states) * TERMS
    moves = states[0].pulls.shape[1] + states[0].by_colour.shape[1]
    matrix = np.diag(_precision_of_priors(len(states), moves))
    vector, square, rows = np.zeros(count + moves), 0.0, 0
    for k, (one, of_detections) in enumerate(zip(states, weight, strict=True)):
        own = np.concatenate([one.design, _moves_of(one, share)], 1)
        w = np.repeat(of_detections, 2)
        where = np.r_[k * TERMS : (k + 1) * TERMS, count : count + moves].astype(int)
        matrix[np.ix_(where, where)] += (own.T * w) @ own
        vector[where] += own.T @ (w * one.target)
        square += float(w @ one.target**2)
        rows += int((one.design != 0).any(1).sum())
    return NormalEquations(matrix, vector, square, weight, len(states), rows, share)


def _precision_of_priors(states: int, moves: int) -> Float[np.ndarray, " unknowns"]:
    """Coefficients have next to none; the unit of a move is its standard deviation."""
    return np.repeat([_TINY, 1.0], [states * TERMS, moves])


def _robust(
    equations: Equations, left: Float[np.ndarray, " equations"]
) -> Float[np.ndarray, " detections"]:
    """Weights by the residuals of the detections; every photograph has its own scale,
    the blurred and the sharp."""
    variance, take, px = equations.variance, equations.take, equations.px
    length = np.linalg.norm(left.reshape(-1, 2), axis=-1)
    scale = np.zeros(len(length))
    for k in np.unique(take):
        mine = take == k
        scale[mine] = np.median(length[mine]) / _MEDIAN_LENGTH
    scale = np.maximum(scale, _LEAST_SCALE_PX * px)
    cauchy = 1 / (1 + (length / (_CAUCHY_SCALE * scale)) ** 2)
    return cauchy / (np.maximum(variance, scale**2) + (_FLOOR_PX * px) ** 2)


def _moves_of(one: Equations, share: float) -> Float[np.ndarray, "equations moves"]:
    """Of all common errors, each by one standard deviation."""
    return np.concatenate([one.pulls, share * one.by_colour], 1)


def _design(q: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Displacement per unit of every term: shift, strain, decentering, radial terms.

    Two rows a detection; of a line sample the first is along its normal, the second
    empty.
    """
    design = np.moveaxis(np.asarray(_displacements(jnp.asarray(q))), 1, 2)
    lines = np.isfinite(normal[:, :1])
    flat = np.einsum("mi,mij->mj", np.nan_to_num(normal), design)[:, None]
    design = np.where(lines[..., None], np.concatenate([flat, 0 * flat], 1), design)
    return design.reshape(2 * len(q), -1)


@jax.jit
def _displacements(q: Float[Array, "points 2"]) -> Float[Array, "points terms 2"]:
    """Per unit of every term, wherever detections were seen."""
    valid_radius = jnp.max(jnp.linalg.norm(q, axis=-1))
    of_all = jax.vmap(displacement_basis, (0, None, None))
    return of_all(q, valid_radius, MOST_RADIAL_TERMS)


def _targets(moved: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Measured displacements, in the rows of `_design`."""
    lines = np.isfinite(normal[:, :1])
    across = np.sum(np.nan_to_num(normal) * moved, -1, keepdims=True)
    return np.where(lines, np.concatenate([across, 0 * across], 1), moved).ravel()
