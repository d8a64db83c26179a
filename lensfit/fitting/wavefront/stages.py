"""The fit at one point, and how it goes on from there: freed, solved, weighed anew.

Where a dot lies is not asked of the model: after every solve patches are moved to where
the dots turned out to be. Which stages there are says `descent`.

Dots are sharded over the cores: each takes every so many-th.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import gaussian_filter

from lensfit.fitting.cores import cores
from lensfit.fitting.levenberg import Prior
from lensfit.fitting.trial import Statistics
from lensfit.fitting.wavefront.dot_weights import (
    MODEL_SHARE,
    first_weights,
    weights_after,
)
from lensfit.fitting.wavefront.dots import Dots, Pixels
from lensfit.fitting.wavefront.gather import WIDE_OPEN, Gathered
from lensfit.fitting.wavefront.normal import (
    DEFAULT_POINTS,
    FOLDS,
    Equations,
    Model,
    Points,
)
from lensfit.fitting.wavefront.parameters import Layout
from lensfit.fitting.wavefront.solve import Solution, solve
from lensfit.fitting.wavefront.stated import (
    Stated,
    stated_equations,
    stated_opening,
    stated_opening_and_focus,
)
from lensfit.fitting.wavefront.waves import waves_left


class Deal(NamedTuple):
    """Which dot lies where in the arrays of a pass.

    Attributes
    ----------
    rows : Of every place the dot; places that are left over repeat a dot.
    places : Of every dot the place where it is in use.
    counts : Places in use of each core's share; they come first in it.
    """

    rows: Int[np.ndarray, " room"]
    places: Int[np.ndarray, " dots"]
    counts: Int[np.ndarray, " cores"]


def dealt(dots: int, room: int, hands: int) -> Deal:
    """Every dot to one of so many hands, as evenly as can be.

    Parameters
    ----------
    room : Places of all hands together, a multiple of `hands`.
    """
    space = room // hands
    dot = np.arange(dots)
    places = dot % hands * space + dot // hands
    rows = np.zeros(room, int)
    rows[places] = dot
    return Deal(rows, places, np.bincount(dot % hands, minlength=hands))


COARSE_SHARE = 0.05
_FEWEST_DOTS = 256
"""Arrays are filled up to this, or a power of two: one program for most shoots."""
_TOLERANCE = 2e-3
_DAMPING = 1e-3
_MOST_STEPS = 12
_BROAD_RAYS = 384
"""Of the image of a broad dot that is smoothed."""


@dataclass(frozen=True, eq=False)
class Stage:
    """The fit at one point.

    Attributes
    ----------
    gathered, layout : What is fitted.
    parameters : Present values.
    mean, deviation : Of the prior; a deviation of zero fixes a parameter.
    corner_mm : Corner of every patch from where its chief ray is thought to land.
    weight : Of every cell.
    stated : What counts beside the dots.
    smoothing : Standard deviation, cells, by which photograph and model are smoothed.
    points : Rays through the opening.
    solution : Of the last solve.
    converged : Whether it met its tolerance; `settled` does not count as one.
    blades : Of the iris when stopped down.
    """

    gathered: Gathered
    layout: Layout
    parameters: Float[np.ndarray, " parameters"]
    mean: Float[np.ndarray, " parameters"]
    deviation: Float[np.ndarray, " parameters"]
    corner_mm: Float[np.ndarray, "dots 3 2"]
    weight: Float[np.ndarray, "dots 3 rows columns"]
    stated: Stated
    smoothing: float = 0.0
    points: Points = DEFAULT_POINTS
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
        stated = self.stated_equations.matrix[np.ix_(free, free)]
        return np.diag(deviation**-2.0) + stated

    @cached_property
    def stated_equations(self) -> Statistics:
        """Of what was stated, at the present values."""
        parameters = jnp.asarray(self.parameters)
        found = stated_equations(parameters, self.stated, self.layout)
        matrix, gradient = np.asarray(found.matrix), np.asarray(found.gradient)
        return Statistics(matrix, gradient, float(found.chi_squared), 0)

    @property
    def residual(self) -> Float[np.ndarray, "dots 3 rows columns"]:
        """Photograph minus model at the last pass."""
        assert self.solution is not None
        found = np.asarray(self.solution.per_dot.residual)
        return found.reshape(self.gathered.light.shape)

    @property
    def nuisance(self) -> Float[np.ndarray, "dots 3 5"]:
        """Brightness, background, shift and size at the last pass."""
        assert self.solution is not None
        return np.asarray(self.solution.per_dot.nuisance)


def first_stage(gathered: Gathered, layout: Layout, parameters: np.ndarray) -> Stage:
    """Everything fixed, patches where the centroids were found."""
    return Stage(
        gathered=gathered,
        layout=layout,
        parameters=parameters,
        mean=parameters.copy(),
        deviation=np.zeros(layout.size),
        corner_mm=-gathered.observed_mm,
        weight=first_weights(gathered, COARSE_SHARE),
        stated=stated_opening(layout),
    )


def focus_stated(stage: Stage) -> Stage:
    """The same with stated distances as evidence, as far as they suit its defocus."""
    defocus_mm = stage.parameters[stage.layout.blocks["defocus"]]
    stated = stated_opening_and_focus(stage.gathered, stage.layout, defocus_mm)
    return replace(stage, stated=stated)


def smoothed_by(stage: Stage, cells: float) -> Stage:
    """The same with photograph and model smoothed by a Gaussian; of broad dots no more
    is drawn than that leaves."""
    points = DEFAULT_POINTS
    if stage.gathered.dots.broad is not None and cells:
        waves = waves_left(cells, stage.gathered.light.shape[-1])
        points = Points(image=_BROAD_RAYS, waves=waves)
    return replace(stage, smoothing=cells, points=points)


def on_dots(stage: Stage, gathered: Gathered) -> Stage:
    """The same on other dots, whose patches are where the centroids were found."""
    return replace(
        stage,
        gathered=gathered,
        corner_mm=-gathered.observed_mm,
        weight=first_weights(gathered, COARSE_SHARE),
        solution=None,
        converged=False,
    )


def model_of(stage: Stage, deal: Deal) -> Model:
    """Arrays of a pass, every dot at its core's place, in single precision."""
    gathered = stage.gathered
    light = smoothed(gathered.light, stage.smoothing)
    pixels = Pixels(light, stage.weight, stage.corner_mm, folds_of(gathered))

    def at_places(array: np.ndarray) -> jax.Array:
        rows = np.asarray(array)[deal.rows]
        floating = np.issubdtype(rows.dtype, np.floating)
        return jnp.asarray(rows.astype(np.float32) if floating else rows)

    return Model(
        dots=jax.tree.map(at_places, with_iris(gathered, stage.blades)),
        pixels=jax.tree.map(at_places, pixels),
        transfer=jax.tree.map(at_places, gathered.transfer),
        scale=gathered.scale,
        chromatic=jnp.asarray(gathered.chromatic),
        smoothing=jnp.asarray(stage.smoothing**2),
        count=jnp.asarray(deal.counts),
    )


def with_iris(gathered: Gathered, blades: int) -> Dots:
    """The dots' constants, with blades where the iris is stopped down."""
    stopped = gathered.dots.stop_radius < 1 / WIDE_OPEN
    return gathered.dots._replace(blades=blades * stopped.astype(float))


def folds_of(gathered: Gathered) -> np.ndarray:
    """Two folds for each take: every other dot of it."""
    fold = np.empty(len(gathered.take), int)
    for k in range(len(gathered.shown)):
        mine = np.flatnonzero(gathered.take == k)
        fold[mine] = 2 * (k % (FOLDS // 2)) + np.arange(len(mine)) % 2
    return fold


def smoothed(light: np.ndarray, cells: float) -> np.ndarray:
    """Every patch smoothed by a Gaussian."""
    if not cells:
        return light
    return gaussian_filter(light, (0, 0, cells, cells), mode="nearest")


def freed(stage: Stage, deviation: Float[np.ndarray, " parameters"]) -> Stage:
    """The same with other priors; parameters that become fixed stay where they are."""
    mean = np.where(deviation > 0, stage.mean, stage.parameters)
    return replace(stage, mean=mean, deviation=deviation)


def solved(
    stage: Stage, most_steps: int = _MOST_STEPS, tolerance: float = _TOLERANCE
) -> Stage:
    """After a solve, patches moved to where the dots are."""
    free = stage.deviation > 0
    prior = Prior(
        jnp.asarray(stage.mean),
        jnp.asarray(stage.precision),
        jnp.asarray(free.astype(float)),
    )
    count = len(stage.gathered.take)
    room = max(_FEWEST_DOTS, 1 << (count - 1).bit_length())
    deal = dealt(count, room, cores().size)
    found = solve(
        jnp.asarray(stage.parameters),
        model_of(stage, deal),
        prior,
        stage.stated,
        stage.layout,
        stage.points,
        tolerance,
        most_steps,
        _DAMPING,
    )
    found = jax.tree.map(np.asarray, found)
    in_order = jax.tree.map(lambda part: part[deal.places], found.per_dot)
    found = found._replace(per_dot=in_order)
    after = replace(
        stage,
        parameters=found.parameters,
        solution=found,
        converged=bool(found.converged),
    )
    return replace(after, corner_mm=_moved(after))


def settled(stage: Stage, rounds: int = 2) -> Stage:
    """Patches moved to where the dots are, nothing else."""
    converged = stage.converged
    for _ in range(rounds):
        stage = solved(stage, 1)
    return replace(stage, converged=converged)


def _moved(stage: Stage) -> np.ndarray:
    """Corners after the shifts of the last pass, by no more than a cell."""
    shift = stage.nuisance[..., 2:4]
    limit = stage.gathered.dots.cell_mm[:, None]
    shift = np.where(np.isfinite(shift), np.clip(shift, -limit, limit), 0.0)
    return stage.corner_mm - shift


def reweighed(stage: Stage, share: float = MODEL_SHARE) -> Stage:
    """Weights from what the last solve left."""
    weight = weights_after(
        stage.gathered, stage.residual, stage.nuisance[..., 1], share
    )
    return replace(stage, weight=weight)


def chi_squared(stage: Stage) -> float:
    """Of the last pass, without priors."""
    return float(np.sum(stage.equations.chi_squared))


def best_of(stages: list[Stage]) -> Stage:
    """The one that explains the photographs best."""
    return min(stages, key=lambda s: np.nan_to_num(chi_squared(s), nan=np.inf))
