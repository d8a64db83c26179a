"""Strong and wild lenses for the optics tests, drawn from fixed seeds."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np

from lensfit.optics import field
from lensfit.optics.distortion import Distortion, no_distortion
from lensfit.optics.projection import BaseProjection

SENSOR_MM = (24.0, 18.0)
REFERENCE_MM = 15.0
NAMED = field.DECENTERING_TERMS + field.PRISM_TERMS + field.ANAMORPHIC_TERMS


def strong_lens(
    seed: int,
    base: BaseProjection = "rectilinear",
    degree: int = 5,
    squeeze: float = 1.0,
    focal_length_mm: float = 25.0,
) -> Distortion:
    """A lens far worse than any on sale, whose displacements stay below the guard."""
    rng = np.random.default_rng(seed)
    free = rng.normal(0, 0.002, (2, len(field.free_degrees(degree))))
    azimuth = rng.normal(0, 0.05)
    along = np.log(squeeze) * np.array([np.cos(2 * azimuth), np.sin(2 * azimuth)])
    return replace(
        no_distortion(focal_length_mm, REFERENCE_MM, base),
        principal_point_mm=jnp.asarray(rng.normal(0, 0.2, 2)),
        radial=jnp.asarray(rng.normal(0, [0.4, 0.2, 0.1, 0.05])),
        valid_radius=jnp.asarray(1.05),
        squeeze=jnp.asarray(along),
        named=jnp.asarray(rng.normal(0, 0.004, NAMED)),
        free=jnp.asarray(free),
        box=jnp.array([[-0.85, -0.65], [0.85, 0.65]]),
        degree=degree,
    )


def wild_lens(seed: int, size: float, degree: int = 4) -> Distortion:
    """Coefficients of the given size, which without the guard would fold."""
    rng = np.random.default_rng(seed)
    lens = strong_lens(seed, degree=degree)
    return replace(
        lens,
        named=jnp.asarray(rng.normal(0, size, NAMED)),
        free=jnp.asarray(rng.normal(0, size, lens.free.shape)),
    )


def frame_points_mm(overscan: float = 1.15, count: int = 13) -> jnp.ndarray:
    """A regular grid over the frame and its overscan, which includes the centre."""
    x = np.linspace(-0.5, 0.5, count) * SENSOR_MM[0] * overscan
    y = np.linspace(-0.5, 0.5, count) * SENSOR_MM[1] * overscan
    return jnp.asarray(np.stack(np.meshgrid(x, y), -1).reshape(-1, 2))
