"""Where green rays of every dot land according to the fit, for drawing photographs.

Of all dots, also of those that the fit was not made from. Rays lie on spokes and rings
of the pupil, few enough to be quick; between them landing points are smooth and can be
interpolated (`RINGS` are Gauss's nodes in the square of the reach).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from lensfit.batches import in_batches
from lensfit.fitting.wavefront.dot_arrays import Dots, Numbers
from lensfit.fitting.wavefront.dot_data import DotData
from lensfit.fitting.wavefront.light_centroid import polar_landings
from lensfit.fitting.wavefront.normal import as_float32
from lensfit.fitting.wavefront.parameters import Layout, Scale
from lensfit.fitting.wavefront.shapes import colours_of
from lensfit.fitting.wavefront.stages import Stage, with_iris
from lensfit.programs import kept_program

RINGS, SPOKES = 6, 36
_GREEN = 1
_BATCH = 512


class Landings(NamedTuple):
    """Rays of dots on the sensor.

    Attributes
    ----------
    from_chief_mm : From where the dot's chief ray lands, x right, y down.
    weight : Light of each spoke; all spokes of a dot sum to 1.
    """

    from_chief_mm: Float[Numbers, "dots wavelengths spokes rings 2"]
    weight: Float[Numbers, "dots spokes"]


def green_landings(stage: Stage, dot_data: DotData) -> Landings:
    """Green rays of all dots of `dot_data` at the parameters of the fit."""
    parameters = as_float32(jnp.asarray(stage.parameters))
    wavelengths_nm = as_float32(jnp.asarray(dot_data.wavelengths_nm))
    scale = jax.tree.map(as_float32, dot_data.scale)
    return in_batches(
        lambda dots: _landings(
            parameters,
            jax.tree.map(as_float32, dots),
            wavelengths_nm,
            stage.layout,
            scale,
        ),
        with_iris(dot_data, stage.blades),
        _BATCH,
    )


@kept_program(static_argnames=("layout",))
def _landings(
    parameters: Array, dots: Dots, wavelengths_nm: Array, layout: Layout, scale: Scale
) -> Landings:
    def one(dot: Dots) -> Landings:
        colours = colours_of(parameters, dot, wavelengths_nm, layout)
        colour = jax.tree.map(lambda of_channels: of_channels[_GREEN], colours)
        landing, weight = polar_landings(
            parameters, dot, colour, layout, scale, (RINGS, SPOKES)
        )
        shape = len(colour.chromatic), SPOKES, RINGS
        by_spoke = jnp.sum(weight.reshape(*shape), (0, 2))
        return Landings(landing.reshape(*shape, 2), by_spoke)

    return jax.lax.map(one, dots)
