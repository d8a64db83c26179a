"""Fit a model with given terms, robustly: solve, weigh, solve again.

What the model leaves besides detection noise is estimated for every photograph from
the median residual and added to the noise, so that weights stay fair while the model
is still coarse. Marks far off their prediction lose weight (Cauchy), and the few that
stay beyond reach are not used at all.
"""

from dataclasses import dataclass, field, replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from lensfit.fit import normal, solve
from lensfit.fit.bias import centroid_shift_mm
from lensfit.fit.geometry import Frame, View
from lensfit.fit.parameters import POSE_PARAMETERS, Layout, Prior
from lensfit.fit.views import Stack, whitening_of

CAUCHY_SCALE = 3.0
REJECT_BEYOND = 7.0
TOLERANCE = 1e-3
_MOST_STEPS = 12
_MEDIAN_OF_CHI2 = {1: 0.6745, 2: 1.1774}
"""Median length of a whitened residual of one and of two dimensions."""


_residuals = jax.jit(normal.residuals, static_argnames=("layout",))


@dataclass(frozen=True, eq=False)
class Adjustment:
    """A fitted model and how the marks were weighed.

    Attributes
    ----------
    parameters : All of them.
    layout, frame, prior : What they mean, and which were free.
    stack : The photographs.
    shift_mm : Predicted centroid minus image of the centre, for every mark.
    model_variance_mm2 : What the model leaves, per photograph.
    weight : Of every mark, 0 to 1.
    converged : Whether the last solve met its tolerance.
    steps : Steps of all solves.
    """

    parameters: Float[np.ndarray, " parameters"]
    layout: Layout
    frame: Frame
    prior: Prior
    stack: Stack
    radius_mm: Float[np.ndarray, " views"]
    shift_mm: Float[np.ndarray, "views marks 2"]
    model_variance_mm2: Float[np.ndarray, " views"]
    weight: Float[np.ndarray, "views marks"]
    converged: bool = False
    steps: int = 0
    seconds: dict[str, float] = field(default_factory=dict)

    @property
    def used(self) -> Bool[np.ndarray, "views marks"]:
        """Marks that take part."""
        return self.stack.present & (self.weight > 0)

    def views(self, weight: Float[np.ndarray, "views marks"] | None = None) -> View:
        """The stacked views, weighed (by default with the current weights)."""
        weight = self.weight if weight is None else weight
        whitening = whitening_of(self.stack, self.model_variance_mm2)
        whitening = whitening * np.sqrt(weight)[..., None, None]
        return self.stack.view._replace(
            observed_mm=jnp.asarray(
                np.asarray(self.stack.view.observed_mm) - self.shift_mm
            ),
            whitening=jnp.asarray(whitening),
        )

    def residual_mm(self) -> Float[np.ndarray, "views marks 2"]:
        """Predicted minus observed; of a line sample, across the line."""
        plain = self.views()._replace(
            whitening=jnp.broadcast_to(jnp.eye(2), (*self.weight.shape, 2, 2))
        )
        residual = np.asarray(
            _residuals(jnp.asarray(self.parameters), plain, self.layout, self.frame)
        )
        n = self.stack.normal
        across = np.sum(np.nan_to_num(n) * residual, -1, keepdims=True) * n
        residual = np.where(np.isfinite(n), across, residual)
        return np.where(self.stack.present[..., None], residual, 0.0)


def fixed_prior(layout: Layout, views: int) -> Prior:
    """Everything at zero, nothing free."""
    return Prior(np.zeros(layout.size(views)), np.zeros(layout.size(views)))


def problem_of(
    adjustment: Adjustment,
    weight: Float[np.ndarray, "views marks"] | None = None,
) -> solve.Problem:
    """The least-squares problem at the current weights."""
    prior = adjustment.prior
    deviation = np.where(prior.free, prior.standard_deviation, 1.0)
    return solve.Problem(
        views=adjustment.views(weight),
        frame=adjustment.frame,
        prior_mean=jnp.asarray(prior.mean),
        prior_precision=jnp.asarray(np.where(prior.free, deviation**-2.0, 0.0)),
        free=jnp.asarray(prior.free.astype(float)),
    )


def adjust(adjustment: Adjustment, rounds: int = 2) -> Adjustment:
    """Solve, weigh the marks anew, and repeat."""
    for _ in range(rounds):
        found = solve.solve(
            jnp.asarray(adjustment.parameters),
            problem_of(adjustment),
            adjustment.layout,
            TOLERANCE,
            _MOST_STEPS,
        )
        adjustment = replace(
            adjustment,
            parameters=np.asarray(found.parameters),
            converged=bool(found.converged),
            steps=adjustment.steps + int(found.steps),
        )
        adjustment = weigh(adjustment)
    return adjustment


def weigh(adjustment: Adjustment) -> Adjustment:
    """Model variance, robust weights and centroid shifts at the current parameters."""
    shift = centroid_shift_mm(
        jnp.asarray(adjustment.parameters),
        adjustment.stack.view,
        jnp.asarray(adjustment.radius_mm),
        adjustment.layout,
        adjustment.frame,
    )
    adjustment = replace(adjustment, shift_mm=np.asarray(shift))
    variance = _model_variance(adjustment)
    adjustment = replace(adjustment, model_variance_mm2=variance)
    distance = _whitened_length(adjustment)
    weight = 1 / (1 + (distance / CAUCHY_SCALE) ** 2)
    weight = np.where(distance > REJECT_BEYOND, 0.0, weight)
    return replace(adjustment, weight=np.where(adjustment.stack.present, weight, 0.0))


def _whitened_length(adjustment: Adjustment) -> Float[np.ndarray, "views marks"]:
    whitening = whitening_of(adjustment.stack, adjustment.model_variance_mm2)
    residual = np.einsum("vmij,vmj->vmi", whitening, adjustment.residual_mm())
    return np.linalg.norm(residual, axis=-1)


def _model_variance(adjustment: Adjustment) -> Float[np.ndarray, " views"]:
    """Per photograph: squared robust residual beyond what detection noise explains."""
    stack, residual = adjustment.stack, adjustment.residual_mm()
    length = np.linalg.norm(residual, axis=-1)
    noise = np.trace(stack.covariance_mm2, axis1=-2, axis2=-1) / 2
    variance = np.zeros(len(length))
    for k in range(len(length)):
        here = stack.present[k]
        dimensions = 1 if np.isfinite(stack.normal[k][here]).any() else 2
        scale = np.median(length[k][here]) / _MEDIAN_OF_CHI2[dimensions]
        floor = (2e-3 * stack.mm_per_px[k]) ** 2
        variance[k] = max(scale**2 - np.median(noise[k][here]), floor)
    return variance


def release(
    prior: Prior, where: slice | np.ndarray, standard_deviation: float
) -> Prior:
    """The same prior with some parameters free."""
    deviation = prior.standard_deviation.copy()
    deviation[where] = standard_deviation
    return Prior(prior.mean, deviation)


def with_poses_free(prior: Prior, layout: Layout) -> Prior:
    """The same prior with every pose free, and bends as they were."""
    deviation = prior.standard_deviation.copy()
    local = deviation[layout.shared :].reshape(-1, layout.local)
    local[:, :POSE_PARAMETERS] = 3.0
    return Prior(prior.mean, deviation)
