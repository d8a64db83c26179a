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
from jaxtyping import Float, Int
from scipy.ndimage import shift
from scipy.spatial import KDTree

from lensfit.fit.wavefront.gather import Gathered, chosen
from lensfit.fit.wavefront.stages import Stage, first_stage, settled
from lensfit.fit.wavefront.weigh import MODEL_SHARE, first_weights
from lensfit.mosaic import cropped_mosaic, photosites

_ROUNDS = 4
_NEIGHBOURS = 24
_FARTHEST_CELLS = 1.0
"""No spot is moved by more; then the model is not of it."""
_DIMMEST = 0.1


class Aliasing(NamedTuple):
    """Of the dots that were photographed through a mosaic, pixel by pixel.

    Attributes
    ----------
    rows : Which of the gathered dots.
    moved_mm : How far the centroid of each channel went wrong.
    brightened : Measured brightness over the true one.
    """

    rows: Int[np.ndarray, " some"]
    moved_mm: Float[np.ndarray, "some 3 2"]
    brightened: Float[np.ndarray, "some 3"]


def aliasing_of(stage: Stage, gathered: Gathered) -> Aliasing:
    """From the fitted image of every dot, laid where it suits best."""
    narrow = np.array(
        [s.cutouts.mosaic and s.cutouts.cell_px == 1 for s in gathered.shown], bool
    )
    rows = np.flatnonzero(narrow[gathered.take])
    if not len(rows):
        return Aliasing(rows, np.zeros((0, 3, 2)), np.ones((0, 3)))
    these = chosen(gathered, rows)
    begun = replace(
        first_stage(these, stage.layout, stage.parameters),
        blades=stage.blades,
        weight=first_weights(these, MODEL_SHARE),
    )
    found = settled(begun, _ROUNDS)
    image = these.light - found.residual - found.nuisance[..., 1, None, None]
    cell_mm = these.dots.cell_mm[:, None]
    unusual = _unusual_mm(-found.corner_mm, np.asarray(these.dots.field_mm), these.take)
    image = _shifted(image, -unusual / cell_mm)
    moved, brightened = aliased(image, _own_of(gathered)[rows])
    return Aliasing(rows, moved * cell_mm, brightened)


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


def _shifted(image: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Every patch moved by so many columns and rows, by cubic splines."""
    found = np.empty_like(image)
    for dot, channel in np.ndindex(image.shape[:2]):
        across, down = cells[dot, channel]
        found[dot, channel] = shift(image[dot, channel], (down, across), mode="nearest")
    return found


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


def _own_of(gathered: Gathered) -> np.ndarray:
    """Where each channel was measured, (dots, 3, rows, columns); everywhere if there is
    no mosaic."""
    size = gathered.light.shape[-1]
    found = []
    for shown in gathered.shown:
        cut = shown.cutouts
        own = np.ones((2, 2, 3, size, size), bool)
        if cut.mosaic is not None:
            for y, x in np.ndindex(2, 2):
                of_phase = photosites(cropped_mosaic(cut.mosaic, x, y), (size, size))
                own[y, x] = np.moveaxis(of_phase, -1, 0)
        column, row = cut.corner_px.T % 2
        found.append(own[row, column])
    return np.concatenate(found)
