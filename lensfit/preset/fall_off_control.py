"""Fall-off over the radius as control values of `lensfit.optics.falloff`, and the loss
that the shape of a pupil makes.

Control values are found by least squares over steps that are never negative, so that
they never fall.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lensfit.optics.bernstein import bernstein
from lensfit.optics.pupil import Pupil, relative_illumination

RADII = 48
_AZIMUTHS = 8


def squared_radii() -> Float[np.ndarray, " radii"]:
    """Where losses are stated: shares of the largest squared radius, the last one 1."""
    return (np.arange(RADII) + 1) / RADII


def pupil_loss(
    pupil: Pupil,
    stop_radius: Float[Array, ""],
    field_radius_mm: float,
    largest_mm: float,
) -> Float[np.ndarray, " radii"]:
    """-ln of the relative illumination at `squared_radii`, mean of all azimuths.

    Parameters
    ----------
    field_radius_mm : Unit of the pupil's field point.
    largest_mm : The largest radius.
    """
    azimuth = (np.arange(_AZIMUTHS) + 0.5) * (2 * np.pi / _AZIMUTHS)
    outward = np.stack([np.cos(azimuth), np.sin(azimuth)], -1)
    points_mm = np.sqrt(squared_radii())[:, None, None] * outward * largest_mm
    return np.asarray(
        _mean_loss(jnp.asarray(points_mm) / field_radius_mm, stop_radius, pupil)
    )


def loss_of(control: Float[np.ndarray, " terms"]) -> Float[np.ndarray, " radii"]:
    """-ln of the illumination at `squared_radii`."""
    return _basis(len(control)) @ control


def control_of(
    loss: Float[np.ndarray, " radii"], terms: int
) -> Float[np.ndarray, " terms"]:
    """The control values whose loss is nearest."""
    from scipy.optimize import nnls

    basis = _basis(terms)
    steps, _ = nnls(np.cumsum(basis[:, ::-1], axis=1)[:, ::-1], loss)
    return np.cumsum(steps)


@jax.jit
def _mean_loss(
    h: Float[Array, "radii azimuths 2"], stop_radius: Float[Array, ""], pupil: Pupil
) -> Float[Array, " radii"]:
    over = jax.vmap(jax.vmap(relative_illumination, (0, None, None)), (0, None, None))
    return -jnp.mean(jnp.log(over(h, stop_radius, pupil)), -1)


def _basis(terms: int) -> Float[np.ndarray, "radii terms"]:
    return bernstein(squared_radii(), terms)
