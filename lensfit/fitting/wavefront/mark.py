"""Where detection finds a broad mark, on the image that the model draws: of a dot here,
of a checker corner by `corner_mark`.

Detection (`detect.centroids`) takes the light around a dot off, and looks through an
aperture about it: what blur carries farther than that moves no mark. A dark dot's depth
it clips besides to a band about half-level, which keeps the rim alone, so that a mark
is the middle of the rim rather than of the light. Coma moves the two by different
amounts, and only the first is photographed.

Images here are of light, whichever is darker. Places are cells from the middle of the
patch, right and down.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lensfit.detect.centroids import BAND_GAIN
from lensfit.detect.cutouts import CELLS
from lensfit.fitting.wavefront.corner_mark import corner_of
from lensfit.fitting.wavefront.dots import Aperture, Dots
from lensfit.fitting.wavefront.parameters import Layout, Scale
from lensfit.fitting.wavefront.patch import pulled
from lensfit.fitting.wavefront.rays import spot_seen
from lensfit.fitting.wavefront.shapes import Colour
from lensfit.fitting.wavefront.waves import Transfer, basis_of
from lensfit.kernel.pixels import image_of

_RAYS, _WAVES = 192, 20
"""Of an image, for a centroid bias within 1 %: apertures and rims need no detail."""
_ROUNDS = 2
"""Of putting the aperture where the mark was found."""
_SOFT_CELLS = 0.5
_LEAST = 1e-6


class _Drawn(NamedTuple):
    """One channel of a dot, on a patch whose middle is where the chief ray lands.

    Attributes
    ----------
    pulled_back : From a derivative by the light of cells to one by the parameters.
    """

    image: Float[Array, "cells cells"]
    pulled_back: Callable[[Array], Array]


def mark_offsets_mm(
    parameters: Float[Array, " parameters"],
    dot: Dots,
    transfer: Transfer,
    chromatic: Float[Array, "3 wavelengths"],
    layout: Layout,
    scale: Scale,
) -> Float[Array, "3 2"]:
    """From where each channel's chief ray lands to its mark.

    Parameters
    ----------
    dot, transfer : Of one broad dot.
    """

    def channel(chromatic: Array, lateral_mm: Array) -> Array:
        colour = Colour(chromatic, lateral_mm)
        drawn = _drawn(parameters, dot, transfer, colour, layout, scale)
        return _mark_mm(drawn.image, dot)

    return jax.vmap(channel)(chromatic, dot.lateral_mm)


def mark_offset_slopes_mm(
    parameters: Float[Array, " parameters"],
    dot: Dots,
    transfer: Transfer,
    chromatic: Float[Array, "3 wavelengths"],
    layout: Layout,
    scale: Scale,
) -> Float[Array, "3 2 parameters"]:
    """d `mark_offsets_mm` / d parameter."""

    def channel(chromatic: Array, lateral_mm: Array) -> Array:
        colour = Colour(chromatic, lateral_mm)
        drawn = _drawn(parameters, dot, transfer, colour, layout, scale)
        _, to_image = jax.vjp(lambda image: _mark_mm(image, dot), drawn.image)

        def along(axis: Array) -> Array:
            (by_image,) = to_image(axis)
            return drawn.pulled_back(by_image)

        return jax.vmap(along)(jnp.eye(2, dtype=drawn.image.dtype))

    return jax.vmap(channel)(chromatic, dot.lateral_mm)


def mark_of(
    image: Float[Array, "cells cells"], aperture: Aperture
) -> Float[Array, "2"]:
    """Place of the mark on an image of light about the middle.

    Parameters
    ----------
    aperture : Of one dot.
    """
    places = _places(image.shape[0], image.dtype)
    radius_cells = jnp.sqrt(jnp.abs(jnp.linalg.det(aperture.to_edge)))
    image = image - _background(image, places, aperture, radius_cells)
    dark = aperture.smoothing > 0
    image = jnp.where(dark, _rim_alone(image, places, aperture), image)
    centre = jnp.zeros(2, image.dtype)
    for _ in range(_ROUNDS):
        away = _away(places - centre[None, None], aperture)
        light = image * jnp.clip((1 - away) * radius_cells + _SOFT_CELLS, 0, 1)
        centre = jnp.einsum("rc,rci->i", light, places) / jnp.sum(light)
    return centre


def _mark_mm(image: Float[Array, "cells cells"], dot: Dots) -> Float[Array, "2"]:
    broad, cell_mm = dot.broad, dot.cell_mm
    assert broad is not None

    def corner(image: Array) -> Array:
        places = _places(image.shape[0], image.dtype)
        side_cells = broad.square_mm / cell_mm[:, None]
        return corner_of(image, places, side_cells, broad.window_cells)

    def disc(image: Array) -> Array:
        return mark_of(image, broad.aperture)

    return jax.lax.cond(broad.window_cells > 0, corner, disc, image) * cell_mm


def _drawn(
    parameters: Array,
    dot: Dots,
    transfer: Transfer,
    colour: Colour,
    layout: Layout,
    scale: Scale,
) -> _Drawn:
    spot, led_back = spot_seen(parameters, dot, colour, layout, scale, _RAYS)
    corner_mm = -dot.cell_mm * CELLS / 2
    basis = basis_of(corner_mm, dot.cell_mm, CELLS, transfer, _WAVES)
    profile = basis.profile(spot, dot.variance_mm2)

    def pulled_back(by_image: Array) -> Array:
        return led_back(pulled(spot, profile, basis.traced_back(by_image)))

    return _Drawn(basis.seen(image_of(spot, profile)), pulled_back)


def _places(cells: int, dtype) -> Float[Array, "cells cells 2"]:
    along = np.arange(cells) - (cells - 1) / 2
    x, y = np.meshgrid(along, along)
    return jnp.asarray(np.stack([x, y], -1).astype(dtype))


def _away(places: Array, aperture: Aperture) -> Float[Array, "cells cells"]:
    """In apertures from the middle."""
    inverse = jnp.linalg.inv(aperture.to_edge)
    square = jnp.sum(jnp.einsum("ij,rcj->rci", inverse, places) ** 2, -1)
    return jnp.sqrt(square + _LEAST)


def _background(
    image: Array, places: Array, aperture: Aperture, radius_cells: Array
) -> Float[Array, "cells cells"]:
    """A plane through the ring around the aperture."""
    away = _away(places, aperture)
    ring = (away > 1 + _SOFT_CELLS / radius_cells) & (away < aperture.ring)
    w = ring.astype(image.dtype).reshape(-1)
    design = jnp.concatenate([jnp.ones_like(image)[..., None], places], -1)
    design = design.reshape(-1, 3)
    inner = design.T @ (w[:, None] * design) + _LEAST * jnp.eye(3, dtype=w.dtype)
    plane = jnp.linalg.solve(inner, design.T @ (w * image.reshape(-1)))
    return (design @ plane).reshape(image.shape)


def _rim_alone(
    image: Array, places: Array, aperture: Aperture
) -> Float[Array, "cells cells"]:
    """Smoothed, and clipped to a band about half the level of the core."""
    along = places[0, :, 0]
    sigma = jnp.maximum(aperture.smoothing, _LEAST)
    blur = jnp.exp(-((along[:, None] - along[None]) ** 2) / (2 * sigma**2))
    blur = blur / jnp.sum(blur, 1, keepdims=True)
    smooth = blur @ image @ blur.T
    core = (_away(places, aperture) < aperture.core).astype(image.dtype)
    level = jnp.sum(core * smooth) / jnp.maximum(jnp.sum(core), _LEAST)
    band = BAND_GAIN * smooth / level + (1 - BAND_GAIN) / 2
    return jnp.clip(band, 0, 1)
