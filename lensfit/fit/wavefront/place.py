"""Where chief rays land: every dot's centroid, less what blur does to it.

A centroid is not where the chief ray lands: coma and clipping drag it, differently at
every f-number, focus and colour. With the wavefront known the distance between the two
is known, and geometry and lateral colour can be fitted to chief rays.

(The place at which the modelled image suits the photograph best is the same in theory;
in practice it carries the noise of the rays that the image is made of.)
"""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lensfit.batches import in_batches
from lensfit.fit.take import Take
from lensfit.fit.wavefront.dots import Dots
from lensfit.fit.wavefront.gather import Gathered
from lensfit.fit.wavefront.parameters import Layout, Scale
from lensfit.fit.wavefront.rays import centroids_mm
from lensfit.fit.wavefront.shown import Shown
from lensfit.fit.wavefront.stages import Stage, with_iris

_BATCH = 512
_UNSURE = 0.05
"""Share of a drag that the model may get wrong: a photograph in which blur drags little
tells where chief rays land, and one in which it drags much follows."""


def placed(stage: Stage, gathered: Gathered) -> list[Take]:
    """The takes with marks where the chief rays land, in the order of `gathered.shown`.

    Marks whose size is unknown stay where they are.
    """
    dragged = _dragged_mm(stage, gathered)
    return [
        _moved(shown, dragged[gathered.take == k])
        for k, shown in enumerate(gathered.shown)
    ]


def _dragged_mm(stage: Stage, gathered: Gathered) -> Float[np.ndarray, "dots 3 2"]:
    """Centroid of every dot and channel from where its chief ray lands."""
    return in_batches(
        lambda dots: _centroids(
            jnp.asarray(stage.parameters),
            jax.tree.map(jnp.asarray, dots),
            jnp.asarray(gathered.chromatic),
            stage.layout,
            gathered.scale,
        ),
        with_iris(gathered, stage.blades),
        _BATCH,
    )


@partial(jax.jit, static_argnames=("layout",))
def _centroids(
    parameters: Array, dots: Dots, chromatic: Array, layout: Layout, scale: Scale
) -> Array:
    return jax.lax.map(
        lambda dot: centroids_mm(parameters, dot, chromatic, layout, scale), dots
    )


def _moved(shown: Shown, dragged_mm: Float[np.ndarray, "dots 3 2"]) -> Take:
    """The take with its marks at the chief rays."""
    take, rows = shown.take, shown.cutouts.marks
    observations = take.observations
    pixel_mm = np.asarray(take.sensor_size_mm) / np.asarray(observations.image_size_px)
    dragged = dragged_mm / pixel_mm
    points = observations.points_px.copy()
    points[rows] -= dragged[:, 1]
    channels = observations.channel_points_px.copy()
    channels[:, rows] -= dragged.transpose(1, 0, 2)
    unsure = _UNSURE**2 * np.einsum("kci,kcj->ckij", dragged, dragged)
    covariance = observations.covariance_px2.copy()
    covariance[rows] += unsure[1]
    of_channels = observations.channel_covariance_px2.copy()
    of_channels[:, rows] += unsure
    corrected = replace(
        observations,
        points_px=points,
        channel_points_px=channels,
        covariance_px2=covariance,
        channel_covariance_px2=of_channels,
    )
    return replace(take, chief_rays=True, observations=corrected)
