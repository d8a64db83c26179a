"""The fit at one point, and the steps that follow: free parameters, solve, reweight.

Where a dot lies is not predicted by the model: after every solve the patches are moved
to where the dots were found. The order of the stages is that of `descent`.

Dots are sharded over the cores: each takes every so many-th.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy.ndimage import gaussian_filter

from lensfit.fitting.device_mesh import cores
from lensfit.fitting.levenberg import Prior, Quadratic, minimise
from lensfit.fitting.trial import Statistics
from lensfit.fitting.wavefront.dot_arrays import Dots, Pixels
from lensfit.fitting.wavefront.dot_data import WIDE_OPEN, Beam, DotData, widen_beam
from lensfit.fitting.wavefront.dot_weights import (
    MODEL_SHARE,
    initial_weights,
    robust_weights,
)
from lensfit.fitting.wavefront.normal import (
    DEFAULT_POINTS,
    FOLDS,
    Equations,
    Model,
    PerDot,
    Points,
    normal_equations,
)
from lensfit.fitting.wavefront.parameters import Layout
from lensfit.fitting.wavefront.stated import (
    Statements,
    stated_equations,
    statements_with_distances,
    statements_without_distances,
)
from lensfit.fitting.wavefront.waves import waves_after_smoothing
from lensfit.programs import kept_program


class DotSharding(NamedTuple):
    """How the dots of a pass are sharded over the cores.

    Attributes
    ----------
    rows : The dot at every place; unused places repeat a dot.
    places : The place of every dot.
    counts : Places in use of each core's share; they come first in it.
    """

    rows: Int[np.ndarray, " room"]
    places: Int[np.ndarray, " dots"]
    counts: Int[np.ndarray, " cores"]


def shard_dots(dots: int, room: int, shards: int) -> DotSharding:
    """Every dot in one of so many shards, as evenly as possible.

    Parameters
    ----------
    room : Places of all shards together, a multiple of `shards`.
    """
    space = room // shards
    dot = np.arange(dots)
    places = dot % shards * space + dot // shards
    rows = np.zeros(room, int)
    rows[places] = dot
    return DotSharding(rows, places, np.bincount(dot % shards, minlength=shards))


COARSE_SHARE = 0.05
_FEWEST_DOTS = 512
"""Arrays are filled up to this, or a power of two: one program for the coarse and the
fine stages of most shoots. Filled places cost memory, and no pass goes over them."""
_TOLERANCE = 2e-3
_DAMPING = 1e-3
_MOST_STEPS = 12
_BROAD_RAYS = 384
"""Of the image of a broad dot that is smoothed."""
_BROAD_DESIGN_RAYS = 192
"""Of its matrix, whose sums over rays are short (`polynomials`)."""


class Solution(NamedTuple):
    """Where the solve ended.

    Attributes
    ----------
    parameters : The solution; fixed ones at their prior mean.
    converged : False when the step limit came first.
    steps : Passes over the patches.
    equations, per_dot : At the last pass.
    """

    parameters: Float[Array, " parameters"]
    converged: Bool[Array, ""]
    steps: Int[Array, ""]
    equations: Equations
    per_dot: PerDot


@dataclass(frozen=True, eq=False)
class Stage:
    """The fit at one point.

    Attributes
    ----------
    dot_data, layout : What is fitted.
    parameters : Present values.
    mean, deviation : Of the prior; a deviation of zero fixes a parameter.
    corner_mm : Corner of every patch from where its chief ray is thought to land.
    weight : Of every cell.
    statements : Statements that are observations beside the dots.
    smoothing : Standard deviation, cells, by which photograph and model are smoothed.
    points : Rays through the pupil.
    ray_groups : Groups of rays that the Gauss-Newton matrix is made of.
    solution : Of the last solve.
    converged : Whether it met its tolerance; `recentre_patches` does not count as one.
    blades : Of the iris when stopped down.
    """

    dot_data: DotData
    layout: Layout
    parameters: Float[np.ndarray, " parameters"]
    mean: Float[np.ndarray, " parameters"]
    deviation: Float[np.ndarray, " parameters"]
    corner_mm: Float[np.ndarray, "dots 3 2"]
    weight: Float[np.ndarray, "dots 3 rows columns"]
    statements: Statements
    smoothing: float = 0.0
    points: Points = DEFAULT_POINTS
    ray_groups: int = 1
    solution: Solution | None = None
    converged: bool = False
    blades: int = 0

    @property
    def equations(self) -> Equations:
        """At the last pass."""
        assert self.solution is not None
        return self.solution.equations

    @property
    def precision(self) -> Float[np.ndarray, " parameters"]:
        """Of the priors; zero for fixed parameters."""
        return np.where(self.deviation > 0, self.deviation, np.inf) ** -2.0

    @property
    def slope(self) -> Float[np.ndarray, " parameters"]:
        """Half the gradient of what a solve minimises, at the last pass."""
        off = self.parameters - self.mean
        of_dots = np.asarray(self.equations.gradient).sum(0)
        return of_dots + self.stated_equations.gradient + self.precision * off

    def prior_matrix(
        self,
        free: Int[np.ndarray, " free"],
        deviation: Float[np.ndarray, " free"],
    ) -> Float[np.ndarray, "free free"]:
        """Half the second derivative of priors of these deviations and of what was
        stated, by some of the parameters."""
        statements = self.stated_equations.matrix[np.ix_(free, free)]
        return np.diag(deviation**-2.0) + statements

    def matrix_of_dots(
        self, free: Int[np.ndarray, " free"]
    ) -> Float[np.ndarray, "free free"]:
        """Half the second derivative of the dots' sum of squares at the last pass, by
        some of the parameters."""
        return np.asarray(self.equations.matrix).sum(0)[np.ix_(free, free)]

    @cached_property
    def stated_equations(self) -> Statistics:
        """Of what was stated, at the present values."""
        parameters = jnp.asarray(self.parameters)
        found = stated_equations(parameters, self.statements, self.layout)
        matrix, gradient = np.asarray(found.matrix), np.asarray(found.gradient)
        return Statistics(matrix, gradient, float(found.chi_squared), 0)

    @property
    def residual(self) -> Float[np.ndarray, "dots 3 rows columns"]:
        """Photograph minus model at the last pass."""
        assert self.solution is not None
        found = np.asarray(self.solution.per_dot.residual)
        return found.reshape(self.dot_data.light.shape)

    @property
    def nuisance(self) -> Float[np.ndarray, "dots 3 5"]:
        """Brightness, background, shift and size at the last pass."""
        assert self.solution is not None
        return np.asarray(self.solution.per_dot.nuisance)


def first_stage(dot_data: DotData, layout: Layout, parameters: np.ndarray) -> Stage:
    """Everything fixed, patches where the centroids were found."""
    return Stage(
        dot_data=dot_data,
        layout=layout,
        parameters=parameters,
        mean=parameters.copy(),
        deviation=np.zeros(layout.size),
        corner_mm=-dot_data.observed_mm,
        weight=initial_weights(dot_data, COARSE_SHARE),
        statements=statements_without_distances(dot_data, layout),
    )


def add_stated_distances(stage: Stage) -> Stage:
    """The same with stated distances as observations; these and fall-off are weighted
    by how well they agree with what was fitted."""
    statements = statements_with_distances(
        stage.dot_data, stage.layout, stage.parameters
    )
    return replace(stage, statements=statements)


def smooth_stage(stage: Stage, cells: float) -> Stage:
    """The same with photograph and model smoothed by a Gaussian; broad dots are drawn
    with only the waves that this leaves."""
    points = DEFAULT_POINTS
    if stage.dot_data.dots.broad is not None:
        points = points._replace(design=_BROAD_DESIGN_RAYS)
        if cells:
            waves = waves_after_smoothing(cells, stage.dot_data.light.shape[-1])
            points = points._replace(image=_BROAD_RAYS, waves=waves)
    return replace(stage, smoothing=cells, points=points)


def stage_on_dots(stage: Stage, dot_data: DotData) -> Stage:
    """The same on other dots, whose patches are where the centroids were found."""
    return replace(
        stage,
        dot_data=dot_data,
        corner_mm=-dot_data.observed_mm,
        weight=initial_weights(dot_data, COARSE_SHARE),
        solution=None,
        converged=False,
    )


def stage_with_beam(stage: Stage, beam: Beam) -> Stage:
    """The same with another beam. Where that is wider it is out of focus by as many
    times less, and draws the same dots."""
    factor = np.ones(stage.layout.size)
    for name in {"defocus", "astigmatic_offset"} & stage.layout.blocks.keys():
        factor[stage.layout.blocks[name]] = stage.dot_data.beam.ratio / beam.ratio
    return replace(
        stage,
        dot_data=widen_beam(stage.dot_data, beam),
        parameters=factor * stage.parameters,
        mean=factor * stage.mean,
    )


def model_of(stage: Stage, sharding: DotSharding) -> Model:
    """Arrays of a pass, every dot at its core's place, in single precision."""
    dot_data = stage.dot_data
    light = smooth_patches(dot_data.light, stage.smoothing)
    pixels = Pixels(light, stage.weight, stage.corner_mm, folds_of(dot_data))
    # A smoothed photograph has no detail that is sharper than the waves of rays.
    transfer = dot_data.transfer if stage.smoothing else dot_data.sharp_transfer

    def at_places(array: np.ndarray) -> jax.Array:
        rows = np.asarray(array)[sharding.rows]
        floating = np.issubdtype(rows.dtype, np.floating)
        return jnp.asarray(rows.astype(np.float32) if floating else rows)

    return Model(
        dots=jax.tree.map(at_places, with_iris(dot_data, stage.blades)),
        pixels=jax.tree.map(at_places, pixels),
        transfer=jax.tree.map(at_places, transfer),
        scale=dot_data.scale,
        wavelengths_nm=jnp.asarray(dot_data.wavelengths_nm),
        smoothing=jnp.asarray(stage.smoothing**2),
        count=jnp.asarray(sharding.counts),
        ray_groups=jnp.asarray(stage.ray_groups),
    )


def with_iris(dot_data: DotData, blades: int) -> Dots:
    """The dots' constants, with blades where the iris is stopped down."""
    stopped = dot_data.dots.stop_radius < 1 / WIDE_OPEN
    return dot_data.dots._replace(blades=blades * stopped.astype(float))


def folds_of(dot_data: DotData) -> np.ndarray:
    """Two folds for each take: every other dot of it."""
    fold = np.empty(len(dot_data.take), int)
    for k in range(len(dot_data.photographs)):
        mine = np.flatnonzero(dot_data.take == k)
        fold[mine] = 2 * (k % (FOLDS // 2)) + np.arange(len(mine)) % 2
    return fold


def smooth_patches(light: np.ndarray, cells: float) -> np.ndarray:
    """Every patch smoothed by a Gaussian."""
    if not cells:
        return light
    return gaussian_filter(light, (0, 0, cells, cells), mode="nearest")


def set_priors(stage: Stage, deviation: Float[np.ndarray, " parameters"]) -> Stage:
    """The same with other priors; parameters that become fixed keep their values."""
    mean = np.where(deviation > 0, stage.mean, stage.parameters)
    return replace(stage, mean=mean, deviation=deviation)


def solve_stage(
    stage: Stage, most_steps: int = _MOST_STEPS, tolerance: float = _TOLERANCE
) -> Stage:
    """The stage after a solve, patches moved to where the dots are."""
    free = stage.deviation > 0
    prior = Prior(
        jnp.asarray(stage.mean),
        jnp.asarray(stage.precision),
        jnp.asarray(free.astype(float)),
    )
    count = len(stage.dot_data.take)
    room = max(_FEWEST_DOTS, 1 << (count - 1).bit_length())
    sharding = shard_dots(count, room, cores().size)
    found = _solve(
        jnp.asarray(stage.parameters),
        model_of(stage, sharding),
        prior,
        stage.statements,
        stage.layout,
        stage.points,
        tolerance,
        most_steps,
        _DAMPING,
    )
    found = jax.tree.map(np.asarray, found)
    in_order = jax.tree.map(lambda part: part[sharding.places], found.per_dot)
    found = found._replace(per_dot=in_order)
    after = replace(
        stage,
        parameters=found.parameters,
        solution=found,
        converged=bool(found.converged),
    )
    return replace(after, corner_mm=_shifted_corners_mm(after))


@kept_program(static_argnames=("layout", "points"))
def _solve(
    start: Float[Array, " parameters"],
    model: Model,
    prior: Prior,
    statements: Statements,
    layout: Layout,
    points: Points,
    tolerance: float,
    most_steps: int,
    first_damping: float,
) -> Solution:
    """Minimise over dots, statements and priors from `start`, by `levenberg.minimise`.

    One program per layout and number of points; a single step only evaluates.
    """

    def equations(parameters: Array) -> tuple[Quadratic, tuple[Equations, PerDot]]:
        found, per_dot = normal_equations(parameters, model, layout, points)
        of_dots = Quadratic(*(jnp.sum(part, 0) for part in found))
        of_stated = stated_equations(parameters, statements, layout)
        return jax.tree.map(jnp.add, of_dots, of_stated), (found, per_dot)

    found = minimise(equations, start, prior, tolerance, most_steps, first_damping)
    return Solution(found.parameters, found.converged, found.steps, *found.extra)


def recentre_patches(stage: Stage, rounds: int = 2) -> Stage:
    """Patches moved to where the dots are, nothing else."""
    converged = stage.converged
    for _ in range(rounds):
        stage = solve_stage(stage, 1)
    return replace(stage, converged=converged)


def _shifted_corners_mm(stage: Stage) -> np.ndarray:
    """Corners after the shifts of the last pass, by no more than a cell."""
    shift = stage.nuisance[..., 2:4]
    limit = stage.dot_data.dots.cell_mm[:, None]
    shift = np.where(np.isfinite(shift), np.clip(shift, -limit, limit), 0.0)
    return stage.corner_mm - shift


def update_robust_weights(stage: Stage, share: float = MODEL_SHARE) -> Stage:
    """The same with robust weights from the residuals of the last solve."""
    weight = robust_weights(
        stage.dot_data, stage.residual, stage.nuisance[..., 1], share
    )
    return replace(stage, weight=weight)


def chi_squared(stage: Stage) -> float:
    """Of the last pass, without priors."""
    return float(np.sum(stage.equations.chi_squared))


def best_of(stages: list[Stage]) -> Stage:
    """The stage that explains the photographs best."""
    return min(stages, key=lambda s: np.nan_to_num(chi_squared(s), nan=np.inf))
