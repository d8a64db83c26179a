"""What a colour mosaic does to centroid and brightness of a dot whose image is known.

Photosites of red and blue lie two pixels apart, those of green on every other corner of
a chessboard. A spot of a pixel or two falls on one of them or between, and whatever
interpolates, its centroid goes wrong by tenths of a pixel and its brightness by half:
aliasing. Both follow from sums over the modelled image, once over all pixels and once
over those that measured the channel. The wavefront needs to be only nearly right, since
an error of its own moves both sums alike.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import KDTree

from lensfit.detect.cutouts import Cutouts
from lensfit.fitting.wavefront.dot_patches import Shown
from lensfit.fitting.wavefront.dot_weights import MODEL_SHARE, first_weights
from lensfit.fitting.wavefront.drawn import drawn
from lensfit.fitting.wavefront.gather import Gathered, chosen
from lensfit.fitting.wavefront.stages import Stage, first_stage, settled
from lensfit.mosaic import photosites_at

_ROUNDS = 4
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
        these = chosen(gathered, rows)
        image = drawn(stage, these, _places_mm(stage, these))
        moved, brightened = aliased(image, np.concatenate(list(own.values())))
        found.moved_mm[rows] = moved * these.dots.cell_mm[:, None]
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


def _places_mm(stage: Stage, these: Gathered) -> Float[np.ndarray, "dots 3 2"]:
    """Where chief rays land, from the corner of the cells: as the pixels of a dot say,
    together with those of other dots."""
    begun = replace(
        first_stage(these, stage.layout, stage.parameters),
        blades=stage.blades,
        weight=first_weights(these, MODEL_SHARE),
    )
    place_mm = -settled(begun, _ROUNDS).corner_mm
    return place_mm - _unusual_mm(place_mm, np.asarray(these.dots.field_mm), these.take)


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
