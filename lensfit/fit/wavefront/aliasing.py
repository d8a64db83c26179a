"""What a colour mosaic does to centroid and brightness of a dot whose image is known.

Photosites of red and blue lie two pixels apart, those of green on every other corner of
a chessboard. A spot of a pixel or two falls on one of them or between, and whatever
interpolates, its centroid goes wrong by tenths of a pixel and its brightness by half:
aliasing. Both follow from sums over the modelled image, once over all pixels and once
over those that measured the channel. The wavefront needs to be only nearly right, since
an error of its own moves both sums alike.
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
from lensfit.detect.cutouts import Cutouts
from lensfit.fit.wavefront.dots import Dots
from lensfit.fit.wavefront.gather import Gathered, chosen
from lensfit.fit.wavefront.normal import as_float32
from lensfit.fit.wavefront.parameters import Layout, Scale
from lensfit.fit.wavefront.rays import Colour, spot_seen
from lensfit.fit.wavefront.shown import Shown
from lensfit.fit.wavefront.stages import Stage, first_stage, settled, with_iris
from lensfit.fit.wavefront.weigh import MODEL_SHARE, first_weights
from lensfit.kernel.pixels import diffraction_variance_mm2, image_of, profile_of
from lensfit.mosaic import photosites_at

_ROUNDS = 4
_BATCH = 512
_NEIGHBOURS = 24
_FARTHEST_CELLS = 1.0
"""No spot is moved by more; then the model is not of it."""
_DIMMEST = 0.1


class Aliasing(NamedTuple):
    """Of all dots. None of those that were photographed without a mosaic, or are so
    wide that each of their cells holds photosites of every colour.

    Attributes
    ----------
    moved_mm : How far the centroid of each channel went wrong.
    green_alone : Whether green alone says how bright the dot is. Photosites of red and
        of blue lie so far apart that they miss or catch half of such a dot, and what
        they should have seen is known to a tenth; a lens darkens red and blue as it
        does green, to one or two per cent.
    brightened : Measured brightness of green over the true one.
    """

    moved_mm: Float[np.ndarray, "dots 3 2"]
    green_alone: Bool[np.ndarray, " dots"]
    brightened: Float[np.ndarray, " dots"]


def aliasing_of(stage: Stage, gathered: Gathered) -> Aliasing:
    """From the fitted image of every dot, laid where it suits best."""
    own = {k: _own_of(s.cutouts) for k, s in enumerate(gathered.shown) if _narrow(s)}
    green_alone = np.isin(gathered.take, list(own))
    rows = np.flatnonzero(green_alone)
    found = Aliasing(
        np.zeros_like(gathered.observed_mm), green_alone, np.ones(len(green_alone))
    )
    if len(rows):
        image, cell_mm = _images(stage, chosen(gathered, rows))
        moved, brightened = aliased(image, np.concatenate(list(own.values())))
        found.moved_mm[rows] = moved * cell_mm
        found.brightened[rows] = brightened[:, 1]
    return found


def _narrow(shown: Shown) -> bool:
    """Whether each cell holds one photosite of a mosaic."""
    return shown.cutouts.mosaic is not None and shown.cutouts.cell_px == 1


def _own_of(cutouts: Cutouts) -> Bool[np.ndarray, "dots 3 rows columns"]:
    """Where each channel was measured."""
    assert cutouts.mosaic is not None
    pixels = cutouts.corner_px[..., None] + np.arange(cutouts.light.shape[-1])
    columns, rows = pixels[:, 0, None, :], pixels[:, 1, :, None]
    return np.moveaxis(photosites_at(cutouts.mosaic, columns, rows), -1, 1)


def _images(
    stage: Stage, these: Gathered
) -> tuple[Float[np.ndarray, "dots 3 rows columns"], Float[np.ndarray, "dots 1 2"]]:
    """The light of every dot as the fit has it, and the size of its cells, mm."""
    begun = replace(
        first_stage(these, stage.layout, stage.parameters),
        blades=stage.blades,
        weight=first_weights(these, MODEL_SHARE),
    )
    corner_mm = settled(begun, _ROUNDS).corner_mm
    field_mm = np.asarray(these.dots.field_mm)
    corner_mm = corner_mm + _unusual_mm(-corner_mm, field_mm, these.take)
    image = in_batches(
        lambda part: _drawn(
            as_float32(jnp.asarray(stage.parameters)),
            jax.tree.map(as_float32, part),
            as_float32(jnp.asarray(these.chromatic)),
            stage.layout,
            jax.tree.map(as_float32, these.scale),
            (stage.points.image, these.light.shape[-1]),
        ),
        (with_iris(these, stage.blades), corner_mm),
        _BATCH,
    )
    return _of_sharp_holes(image.astype(float), these), these.dots.cell_mm[:, None]


@partial(jax.jit, static_argnames=("layout", "points_and_cells"))
def _drawn(
    parameters: Array,
    part: tuple[Dots, Array],
    chromatic: Array,
    layout: Layout,
    scale: Scale,
    points_and_cells: tuple[int, int],
) -> Array:
    """Dots of all channels on their cells, each of a brightness of 1."""
    points, cells = points_and_cells

    def of_dot(one: tuple[Dots, Array]) -> Array:
        dot, corners_mm = one

        def channel(chromatic: Array, lateral_mm: Array, corner_mm: Array) -> Array:
            colour = Colour(chromatic, lateral_mm)
            spot, _ = spot_seen(parameters, dot, colour, layout, scale, points)
            profile = profile_of(
                spot,
                corner_mm=corner_mm,
                cell_mm=dot.cell_mm,
                cells=cells,
                variance_mm2=dot.variance_mm2,
                apart_mm=dot.apart_mm,
            )
            return image_of(spot, profile)

        return jax.vmap(channel)(chromatic, dot.lateral_mm, corners_mm)

    return jax.lax.map(of_dot, part)


def _of_sharp_holes(image: np.ndarray, these: Gathered) -> np.ndarray:
    """Images of holes with sharp rims.

    The fit takes holes for Gaussians, which is good enough for pixels. At the finest
    detail, which is what aliases, a Gaussian of a pixel and a half has three times as
    much as a disc.
    """
    dots = these.dots
    if dots.apart_mm is not None:
        return image
    f_number = jnp.asarray(these.f_numbers)[dots.stop]
    variance_mm2 = dots.variance_mm2 - np.asarray(diffraction_variance_mm2(f_number))
    radius = 2 * np.sqrt(np.maximum(variance_mm2, 0.0)) / dots.cell_mm[:, 0]
    return with_rims(image, radius)


def _unusual_mm(place_mm: np.ndarray, field_mm: np.ndarray, take: np.ndarray):
    """How far red and blue lie from where they do next to green in other dots nearby.

    A red spot on one photosite and far from the next ones hardly says where it lies.
    Those of other dots do, since lateral colour changes slowly.
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


def with_rims(
    image: Float[np.ndarray, "dots 3 rows columns"], radius: Float[np.ndarray, " dots"]
) -> Float[np.ndarray, "dots 3 rows columns"]:
    """Images of Gaussian holes as those of discs of the same second moments.

    Parameters
    ----------
    radius : Of the discs, in cells.
    """
    size = image.shape[-1]
    wave = 2 * np.pi * np.hypot(np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size))
    x = np.maximum(radius[:, None, None, None] * wave, 1e-9)
    ratio = 2 * j1(x) / x * np.exp(x**2 / 8)
    return np.fft.irfft2(np.fft.rfft2(image) * ratio, s=(size, size))


def aliased(
    image: Float[np.ndarray, "dots 3 rows columns"],
    own: np.ndarray,
) -> tuple[Float[np.ndarray, "dots 3 2"], Float[np.ndarray, "dots 3"]]:
    """Centroid (column, row) and sum of what was measured, against those of all.

    Zero and one where the image is none.

    Parameters
    ----------
    image : Light of each dot over its background.
    own : Where each channel was measured.
    """
    share = own.mean((-2, -1))
    whole, part = _sums(image), _sums(image * own)
    with np.errstate(divide="ignore", invalid="ignore"):
        moved = part[..., 1:] / part[..., :1] - whole[..., 1:] / whole[..., :1]
        brightened = part[..., 0] / (share * whole[..., 0])
    good = np.abs(moved).max(-1) < _FARTHEST_CELLS
    good &= (brightened > _DIMMEST) & (brightened < 1 / _DIMMEST)
    return np.where(good[..., None], moved, 0.0), np.where(good, brightened, 1.0)


def _sums(image: np.ndarray) -> np.ndarray:
    """Light, and its first moments about the middle."""
    middle = np.arange(image.shape[-1]) - (image.shape[-1] - 1) / 2
    return np.stack(
        [
            image.sum((-2, -1)),
            (image.sum(-2) * middle).sum(-1),
            (image.sum(-1) * middle).sum(-1),
        ],
        -1,
    )
