"""The detected point of a broad target, as the model predicts it: of a dot on its image
here, of a checker corner and of a line as `detected_edges` has them.

Detection (`detect.centroids`) subtracts the light around a dot, and takes the centroid
within an aperture about it: light that blur carries farther than that has no effect.
The depth of a dark dot is also clipped to a band about half-level, which keeps the rim
alone, so that the detected point is the middle of the rim rather than of the light.
Coma moves the two by different amounts, and only the first is photographed.

Each kind of target has a program of its own, so that a shoot compiles what its charts
show. Images here are of light, whether the dot is brighter or darker than what
surrounds it. Places are cells from the middle of the patch, right and down.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lensfit.detect.centroids import BAND_GAIN
from lensfit.detect.dot_images import CELLS
from lensfit.fitting.wavefront.detected_edges import (
    DetectedLine,
    detected_corner,
    detected_line,
)
from lensfit.fitting.wavefront.dot_arrays import (
    Broad,
    BroadKind,
    DetectionAperture,
    Dots,
)
from lensfit.fitting.wavefront.parameters import Layout, Scale
from lensfit.fitting.wavefront.patch_image import PatchImage, patch_image
from lensfit.fitting.wavefront.rays import spot_and_pullback
from lensfit.fitting.wavefront.shapes import Colour, colours_of
from lensfit.fitting.wavefront.waves import Transfer
from lensfit.psf.spot import Spot

_RAYS, _WAVES = 192, 20
"""Of an image, for a centroid bias within 1 %: apertures and rims need no detail."""
_ROUNDS = 2
"""Of moving the aperture to the detected point."""
_SOFT_CELLS = 0.5
_LEAST = 1e-6


class _Traced(NamedTuple):
    """One channel of a dot.

    Attributes
    ----------
    spot : From where the chief ray lands.
    pullback : From a derivative by the spot to one by the parameters.
    window_mm : Of `Broad.line_window_mm`.
    """

    spot: Spot
    pullback: Callable[[Spot], Array]
    window_mm: Float[Array, "3"]


def detected_point_offsets_mm(
    parameters: Float[Array, " parameters"],
    dot: Dots,
    transfer: Transfer,
    wavelengths_nm: Float[Array, "3 wavelengths"],
    layout: Layout,
    scale: Scale,
    kind: BroadKind,
) -> Float[Array, "3 2"]:
    """From where each channel's chief ray lands to its detected point.

    Parameters
    ----------
    dot, transfer : Of one broad dot of this kind.
    """

    def offset_mm(traced: _Traced) -> Array:
        if kind == "line":
            return _line_of(traced.spot, dot, traced.window_mm).offset_mm
        drawn = _image_about_chief_ray(traced.spot, dot, transfer)
        image = drawn.light.reshape(CELLS, CELLS)
        return _point_on_image_mm(image, dot, kind)

    return _map_over_channels(offset_mm, parameters, dot, wavelengths_nm, layout, scale)


def detected_point_offset_slopes_mm(
    parameters: Float[Array, " parameters"],
    dot: Dots,
    transfer: Transfer,
    wavelengths_nm: Float[Array, "3 wavelengths"],
    layout: Layout,
    scale: Scale,
    kind: BroadKind,
) -> Float[Array, "3 2 parameters"]:
    """d `detected_point_offsets_mm` / d parameter."""

    def slopes_mm(traced: _Traced) -> Array:
        if kind == "line":
            return _line_slopes_mm(traced, dot)
        return _drawn_slopes_mm(traced, dot, transfer, kind)

    return _map_over_channels(slopes_mm, parameters, dot, wavelengths_nm, layout, scale)


def line_light_shares(
    parameters: Float[Array, " parameters"],
    dot: Dots,
    transfer: Transfer,
    wavelengths_nm: Float[Array, "3 wavelengths"],
    layout: Layout,
    scale: Scale,
) -> Float[Array, "3 2"]:
    """Share of the light of lines of constant i and j that detection measures.

    Parameters
    ----------
    dot, transfer : Of one line sample.
    """
    del transfer  # Rays say it, no image.

    def share(traced: _Traced) -> Array:
        return _line_of(traced.spot, dot, traced.window_mm).light_share

    return _map_over_channels(share, parameters, dot, wavelengths_nm, layout, scale)


def _map_over_channels(
    function: Callable[[_Traced], Array],
    parameters: Array,
    dot: Dots,
    wavelengths_nm: Array,
    layout: Layout,
    scale: Scale,
) -> Float[Array, "3 *shape"]:
    """A function of the rays of each channel."""

    def channel(colour: Colour, window_mm: Array) -> Array:
        seen = spot_and_pullback(parameters, dot, colour, layout, scale, _RAYS)
        return function(_Traced(*seen, window_mm))

    windows_mm = _broad_of(dot).line_window_mm
    colours = colours_of(parameters, dot, wavelengths_nm, layout)
    return jax.vmap(channel)(colours, windows_mm)


def detected_dot_centre(
    image: Float[Array, "cells cells"], aperture: DetectionAperture
) -> Float[Array, "2"]:
    """Detected centre of a dot on an image of light, from the middle.

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


def _broad_of(dot: Dots) -> Broad:
    assert dot.broad is not None
    return dot.broad


def _line_of(spot: Spot, dot: Dots, window_mm: Array) -> DetectedLine:
    broad = _broad_of(dot)
    lines = dot.variance_mm2, broad.square_mm, broad.line_width, window_mm
    return detected_line(spot, *lines)


def _line_slopes_mm(traced: _Traced, dot: Dots) -> Float[Array, "2 parameters"]:
    found, to_spot = jax.vjp(
        lambda spot: _line_of(spot, dot, traced.window_mm).offset_mm, traced.spot
    )

    def along(axis: Array) -> Array:
        return traced.pullback(*to_spot(axis))

    return jax.vmap(along)(jnp.eye(2, dtype=found.dtype))


def _drawn_slopes_mm(
    traced: _Traced, dot: Dots, transfer: Transfer, kind: BroadKind
) -> Float[Array, "2 parameters"]:
    drawn = _image_about_chief_ray(traced.spot, dot, transfer)

    def point_mm(light: Float[Array, " cells2"]) -> Float[Array, "2"]:
        return _point_on_image_mm(light.reshape(CELLS, CELLS), dot, kind)

    found, to_light = jax.vjp(point_mm, drawn.light)

    def along(axis: Array) -> Array:
        return traced.pullback(drawn.spot_gradient(*to_light(axis)))

    return jax.vmap(along)(jnp.eye(2, dtype=found.dtype))


def _point_on_image_mm(
    image: Float[Array, "cells cells"], dot: Dots, kind: BroadKind
) -> Float[Array, "2"]:
    """The detected point of a disc or a corner, from the middle."""
    broad, cell_mm = _broad_of(dot), dot.cell_mm
    if kind == "disc":
        return detected_dot_centre(image, broad.aperture) * cell_mm
    places = _places(image.shape[0], image.dtype)
    side_cells = broad.square_mm / cell_mm[:, None]
    window = broad.window_cells, broad.window_squares
    return detected_corner(image, places, side_cells, *window) * cell_mm


def _image_about_chief_ray(spot: Spot, dot: Dots, transfer: Transfer) -> PatchImage:
    """The image on a patch whose middle is where the chief ray lands."""
    corner_mm = -dot.cell_mm * CELLS / 2
    at = corner_mm, dot.cell_mm, CELLS, dot.variance_mm2
    return patch_image(spot, transfer, *at, _WAVES)


def _places(cells: int, dtype) -> Float[Array, "cells cells 2"]:
    along = np.arange(cells) - (cells - 1) / 2
    x, y = np.meshgrid(along, along)
    return jnp.asarray(np.stack([x, y], -1).astype(dtype))


def _away(places: Array, aperture: DetectionAperture) -> Float[Array, "cells cells"]:
    """In apertures from the middle."""
    inverse = jnp.linalg.inv(aperture.to_edge)
    square = jnp.sum(jnp.einsum("ij,rcj->rci", inverse, places) ** 2, -1)
    return jnp.sqrt(square + _LEAST)


def _background(
    image: Array, places: Array, aperture: DetectionAperture, radius_cells: Array
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
    image: Array, places: Array, aperture: DetectionAperture
) -> Float[Array, "cells cells"]:
    """The rim: the image smoothed and clipped to a band about half the core's level."""
    along = places[0, :, 0]
    sigma = jnp.maximum(aperture.smoothing, _LEAST)
    blur = jnp.exp(-((along[:, None] - along[None]) ** 2) / (2 * sigma**2))
    blur = blur / jnp.sum(blur, 1, keepdims=True)
    smooth = blur @ image @ blur.T
    core = (_away(places, aperture) < aperture.core).astype(image.dtype)
    level = jnp.sum(core * smooth) / jnp.maximum(jnp.sum(core), _LEAST)
    band = BAND_GAIN * smooth / level + (1 - BAND_GAIN) / 2
    return jnp.clip(band, 0, 1)
