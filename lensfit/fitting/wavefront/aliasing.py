"""Errors of centroid and brightness that a colour mosaic causes (aliasing).

Photosites of red and blue lie two pixels apart, those of green on every other corner of
a chessboard. A spot one or two pixels wide falls on one of them or between them.
Whatever interpolates, its centroid is wrong by tenths of a pixel and its brightness by
half. Both errors are computed from sums over the modelled image of the dot, once over
all pixels and once over those that measured the channel. The wavefront needs to be only
nearly right, since an error of its own moves both sums alike.

The modelled images have the sharp edges of the dot apertures, which the fit takes for
Gaussians behind a mosaic (`known_dots`): at the finest detail, which is what aliases, a
Gaussian of 1.5 pixels has three times as much as a disc.
"""

from dataclasses import replace
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from scipy.spatial import KDTree
from scipy.special import j1

from lensfit.batches import in_batches
from lensfit.detect.dot_images import DotImages
from lensfit.fitting.wavefront.dot_arrays import Dots
from lensfit.fitting.wavefront.dot_data import DotData, select_dots
from lensfit.fitting.wavefront.dot_patches import DotPhotograph
from lensfit.fitting.wavefront.dot_weights import MODEL_SHARE, initial_weights
from lensfit.fitting.wavefront.normal import as_float32
from lensfit.fitting.wavefront.parameters import Layout, Scale
from lensfit.fitting.wavefront.rays import spot_and_pullback
from lensfit.fitting.wavefront.shapes import Colour, colours_of
from lensfit.fitting.wavefront.stages import (
    Stage,
    first_stage,
    recentre_patches,
    with_iris,
)
from lensfit.fitting.wavefront.waves import Transfer, basis_of
from lensfit.mosaic import photosites_at
from lensfit.psf.spot import diffraction_variance_mm2, image_of

_BATCH = 512


def model_images(
    stage: Stage, dot_data: DotData, place_mm: Float[np.ndarray, "dots 3 2"]
) -> Float[np.ndarray, "dots 3 rows columns"]:
    """Light of every cell.

    Parameters
    ----------
    stage : Where the fit ended.
    dot_data : The dots, which need not be those of the fit.
    place_mm : Of each channel's chief ray, from the corner of the cells.
    """
    dots, cells = with_iris(dot_data, stage.blades), dot_data.light.shape[-1]
    image = in_batches(
        lambda part: _images(
            as_float32(jnp.asarray(stage.parameters)),
            jax.tree.map(as_float32, part),
            as_float32(jnp.asarray(dot_data.wavelengths_nm)),
            stage.layout,
            jax.tree.map(as_float32, dot_data.scale),
            (stage.points.image, cells),
        ),
        (dots, dot_data.transfer, -place_mm),
        _BATCH,
    ).astype(float)
    # Behind cylinders a dot aperture is no disc; a broad dot is drawn with its rims.
    if dots.sections is not None or dots.broad is not None:
        return image
    f_number = jnp.asarray(dot_data.f_numbers)[dots.stop]
    variance_mm2 = dots.variance_mm2.mean(-1)
    variance_mm2 = variance_mm2 - np.asarray(diffraction_variance_mm2(f_number))
    radius = 2 * np.sqrt(np.maximum(variance_mm2, 0.0)) / dots.cell_mm[:, 0]
    return sharp_edged_images(image, radius)


@partial(jax.jit, static_argnames=("layout", "points_and_cells"))
def _images(
    parameters: Array,
    part: tuple[Dots, Transfer | None, Array],
    wavelengths_nm: Array,
    layout: Layout,
    scale: Scale,
    points_and_cells: tuple[int, int],
) -> Array:
    """Dots of all channels on their cells, each of a brightness of 1; dot apertures
    that are not broad as Gaussians."""
    points, cells = points_and_cells

    def of_dot(one: tuple[Dots, Transfer | None, Array]) -> Array:
        dot, transfer, corners_mm = one

        def channel(colour: Colour, corner_mm: Array) -> Array:
            spot, _ = spot_and_pullback(parameters, dot, colour, layout, scale, points)
            basis = basis_of(corner_mm, dot.cell_mm, cells, transfer)
            profile = basis.profile(spot, dot.variance_mm2)
            return basis.cell_light(image_of(spot, profile))

        colours = colours_of(parameters, dot, wavelengths_nm, layout)
        return jax.vmap(channel)(colours, corners_mm)

    return jax.lax.map(of_dot, part)


def sharp_edged_images(
    image: Float[np.ndarray, "dots 3 rows columns"], radius: Float[np.ndarray, " dots"]
) -> Float[np.ndarray, "dots 3 rows columns"]:
    """Images of Gaussian dot apertures as those of discs of the same second moments.

    Parameters
    ----------
    radius : Of the discs, in cells.
    """
    size = image.shape[-1]
    wave = 2 * np.pi * np.hypot(np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size))
    x = np.maximum(radius[:, None, None, None] * wave, 1e-9)
    ratio = 2 * j1(x) / x * np.exp(x**2 / 8)
    return np.fft.irfft2(np.fft.rfft2(image) * ratio, s=(size, size))


_ROUNDS = 4
_NEIGHBOURS = 24
_FARTHEST_CELLS = 1.0
"""Largest error of a centroid; beyond it the model is not of this spot."""
_DIMMEST = 0.1


class Aliasing(NamedTuple):
    """Errors of all dots; zero for those that were photographed without a mosaic, or
    are so wide that each of their cells holds photosites of every colour.

    Attributes
    ----------
    centroid_error_mm : Error of the centroid of each channel.
    green_alone : Whether the dot's brightness is taken from green alone. Photosites of
        red and of blue lie so far apart that they miss or catch half of such a dot, and
        the correction is known to a tenth; a lens darkens red and blue as it does
        green, to one or two per cent.
    brightness_ratio : Measured brightness of green over the true one.
    """

    centroid_error_mm: Float[np.ndarray, "dots 3 2"]
    green_alone: Bool[np.ndarray, " dots"]
    brightness_ratio: Float[np.ndarray, " dots"]


def aliasing_of(stage: Stage, dot_data: DotData) -> Aliasing:
    """Aliasing of every dot, from its fitted image placed where it fits best."""
    measured = {
        k: _measured_cells(s.dot_images)
        for k, s in enumerate(dot_data.photographs)
        if _is_one_photosite_per_cell(s)
    }
    green_alone = np.isin(dot_data.take, list(measured))
    rows = np.flatnonzero(green_alone)
    found = Aliasing(
        np.zeros_like(dot_data.observed_mm), green_alone, np.ones(len(green_alone))
    )
    if len(rows):
        these = select_dots(dot_data, rows)
        image = model_images(stage, these, _places_mm(stage, these))
        centroid_error, brightness_ratio = centroid_and_brightness_errors(
            image, np.concatenate(list(measured.values()))
        )
        found.centroid_error_mm[rows] = centroid_error * these.dots.cell_mm[:, None]
        found.brightness_ratio[rows] = brightness_ratio[:, 1]
    return found


def _is_one_photosite_per_cell(photograph: DotPhotograph) -> bool:
    """Whether each cell holds one photosite of a mosaic."""
    return (
        photograph.dot_images.mosaic is not None and photograph.dot_images.cell_px == 1
    )


def _measured_cells(dot_images: DotImages) -> Bool[np.ndarray, "dots 3 rows columns"]:
    """Where each channel was measured."""
    assert dot_images.mosaic is not None
    pixels = dot_images.corner_px[..., None] + np.arange(dot_images.light.shape[-1])
    columns, rows = pixels[:, 0, None, :], pixels[:, 1, :, None]
    return np.moveaxis(photosites_at(dot_images.mosaic, columns, rows), -1, 1)


def _places_mm(stage: Stage, these: DotData) -> Float[np.ndarray, "dots 3 2"]:
    """Where chief rays land, from the corner of the cells: fitted to the pixels of each
    dot, with lateral colour smoothed over neighbouring dots."""
    begun = replace(
        first_stage(these, stage.layout, stage.parameters),
        blades=stage.blades,
        weight=initial_weights(these, MODEL_SHARE),
    )
    place_mm = -recentre_patches(begun, _ROUNDS).corner_mm
    return place_mm - _lateral_deviation_mm(
        place_mm, np.asarray(these.dots.field_mm), these.take
    )


def _lateral_deviation_mm(place_mm: np.ndarray, field_mm: np.ndarray, take: np.ndarray):
    """Lateral colour of red and blue minus its median over nearby dots.

    A red spot on one photosite, far from the next ones, weakly determines its own
    position. Nearby dots do, since lateral colour changes slowly.
    """
    beside = place_mm - place_mm[:, 1:2]
    usual = np.zeros_like(beside)
    for k in np.unique(take):
        mine = np.flatnonzero(take == k)
        count = min(_NEIGHBOURS, len(mine))
        _, near = KDTree(field_mm[mine]).query(field_mm[mine], count)
        near = near.reshape(len(mine), count)
        usual[mine] = np.median(beside[mine][near], 1)
    return beside - usual


def centroid_and_brightness_errors(
    image: Float[np.ndarray, "dots 3 rows columns"],
    measured: np.ndarray,
) -> tuple[Float[np.ndarray, "dots 3 2"], Float[np.ndarray, "dots 3"]]:
    """Error of the centroid (column, row) and ratio of the light, measured over all
    cells.

    Zero and one where there is no image.

    Parameters
    ----------
    image : Light of each dot over its background.
    measured : Where each channel was measured.
    """
    share = measured.mean((-2, -1))
    whole, part = _sums(image), _sums(image * measured)
    with np.errstate(divide="ignore", invalid="ignore"):
        centroid_error = part[..., 1:] / part[..., :1] - whole[..., 1:] / whole[..., :1]
        brightness_ratio = part[..., 0] / (share * whole[..., 0])
    good = np.abs(centroid_error).max(-1) < _FARTHEST_CELLS
    good &= (brightness_ratio > _DIMMEST) & (brightness_ratio < 1 / _DIMMEST)
    return np.where(good[..., None], centroid_error, 0.0), np.where(
        good, brightness_ratio, 1.0
    )


def _sums(image: np.ndarray) -> np.ndarray:
    """Sum of light, and its first moments about the middle."""
    middle = np.arange(image.shape[-1]) - (image.shape[-1] - 1) / 2
    return np.stack(
        [
            image.sum((-2, -1)),
            (image.sum(-2) * middle).sum(-1),
            (image.sum(-1) * middle).sum(-1),
        ],
        -1,
    )
