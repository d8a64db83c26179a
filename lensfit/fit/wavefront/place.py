"""Where chief rays land: every dot's place by the fitted shape of its image.

A centroid is not where the chief ray lands: coma and clipping drag it, differently at
every f-number, focus and colour. With the wavefront known the whole image of a dot says
where its chief ray is, channel by channel, and geometry and lateral colour can be
fitted to that.
"""

from dataclasses import replace
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lensfit.fit.take import Take
from lensfit.fit.wavefront.dots import Dots, Pixels
from lensfit.fit.wavefront.gather import Gathered, chosen
from lensfit.fit.wavefront.normal import Model, as_float32
from lensfit.fit.wavefront.parameters import Layout
from lensfit.fit.wavefront.patch import placed_in
from lensfit.fit.wavefront.rays import Colour, spot_of
from lensfit.fit.wavefront.stages import Stage, filled, first_stage, model_of
from lensfit.fit.wavefront.weigh import MODEL_SHARE, first_weights

_BATCH = 512
_ROUNDS = 2
_POINTS = 256


class Places(NamedTuple):
    """Of every dot and channel.

    Attributes
    ----------
    shift_mm : Where the chief ray lands, from where the patch was thought to be.
    covariance_mm2 : Of the shift.
    """

    shift_mm: Float[Array, "dots 3 2"]
    covariance_mm2: Float[Array, "dots 3 2 2"]


def placed(stage: Stage, gathered: Gathered) -> list[Take]:
    """The takes with marks where the chief rays land, in the order of `gathered.shown`.

    Marks without a cutout stay where they are.
    """
    rows = np.arange(len(gathered.take))
    position = np.empty((len(rows), 3, 2))
    covariance = np.empty((len(rows), 3, 2, 2))
    for first in range(0, len(rows), _BATCH):
        some = rows[first : first + _BATCH]
        position[some], covariance[some] = _of_batch(stage, chosen(gathered, some))
    return [
        _moved(shown.take, shown.cutouts, position[mine], covariance[mine])
        for shown, mine in (
            (s, gathered.take == k) for k, s in enumerate(gathered.shown)
        )
    ]


def _of_batch(stage: Stage, some: Gathered) -> tuple[np.ndarray, np.ndarray]:
    """Positions from the corner of each cutout (mm), and their covariances."""
    batch = first_stage(some, stage.layout, stage.parameters)
    weight = first_weights(some, MODEL_SHARE)
    batch = replace(batch, weight=weight, blades=stage.blades)
    found = None
    for _ in range(_ROUNDS):
        model = filled(model_of(batch), _BATCH)
        found = jax.tree.map(
            lambda a: np.asarray(a)[: len(some.take)],
            _place(jnp.asarray(batch.parameters), model, batch.layout),
        )
        limit = some.dots.cell_mm[:, None]
        batch = replace(
            batch, corner_mm=batch.corner_mm - np.clip(found.shift_mm, -limit, limit)
        )
    assert found is not None
    return -batch.corner_mm, found.covariance_mm2


@partial(jax.jit, static_argnames=("layout",))
def _place(parameters: Array, model: Model, layout: Layout) -> Places:
    single = jax.tree.map(as_float32, model)
    numbers = parameters.astype(jnp.float32)

    def of_dot(row: tuple[Dots, Pixels]) -> Places:
        dot, pixels = row

        def channel(chromatic, lateral, light, weight, corner):
            colour = Colour(chromatic, lateral)
            spot = spot_of(numbers, dot, colour, layout, single.scale, _POINTS)
            return placed_in(spot, light, weight, corner, dot.cell_mm, dot.variance_mm2)

        return Places(
            *jax.vmap(channel)(
                single.chromatic,
                dot.lateral_mm,
                pixels.light,
                pixels.weight,
                pixels.corner_mm,
            )
        )

    return jax.lax.map(of_dot, (single.dots, single.pixels))


def _moved(take: Take, cutouts, position_mm, covariance_mm2) -> Take:
    """The take with its marks at the chief rays; marks that failed stay."""
    observations = take.observations
    pixel_mm = np.asarray(take.sensor_size_mm) / np.asarray(observations.image_size_px)
    at_px = position_mm / pixel_mm + cutouts.corner_px[:, None]
    spread_px2 = covariance_mm2 / np.outer(pixel_mm, pixel_mm)
    good = np.isfinite(at_px).all((1, 2))
    rows, at_px, spread_px2 = cutouts.marks[good], at_px[good], spread_px2[good]
    points = observations.points_px.copy()
    points[rows] = at_px[:, 1]
    covariance = observations.covariance_px2.copy()
    covariance[rows] = spread_px2[:, 1]
    channels = observations.channel_points_px.copy()
    own = observations.channel_covariance_px2.copy()
    if cutouts.channels == 3:
        channels[:, rows] = at_px.transpose(1, 0, 2)
        own[:, rows] = spread_px2.transpose(1, 0, 2, 3)
    return replace(
        take,
        chief_rays=True,
        observations=replace(
            observations,
            points_px=points,
            covariance_px2=covariance,
            channel_points_px=channels,
            channel_covariance_px2=own,
        ),
    )
