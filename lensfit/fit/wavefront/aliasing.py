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
from scipy.ndimage import spline_filter1d
from scipy.spatial import KDTree

from lensfit.detect.cutouts import Cutouts
from lensfit.fit.wavefront.gather import Gathered, chosen
from lensfit.fit.wavefront.shown import Shown
from lensfit.fit.wavefront.stages import Stage, first_stage, settled
from lensfit.fit.wavefront.weigh import MODEL_SHARE, first_weights
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
    brightened : Measured brightness over the true one.
    """

    moved_mm: Float[np.ndarray, "dots 3 2"]
    brightened: Float[np.ndarray, "dots 3"]


def aliasing_of(stage: Stage, gathered: Gathered) -> Aliasing:
    """From the fitted image of every dot, laid where it suits best."""
    found = Aliasing(
        np.zeros_like(gathered.observed_mm), np.ones(gathered.observed_mm.shape[:2])
    )
    own = {k: _own_of(s.cutouts) for k, s in enumerate(gathered.shown) if _narrow(s)}
    rows = np.flatnonzero(np.isin(gathered.take, list(own)))
    if len(rows):
        image, cell_mm = _images(stage, chosen(gathered, rows))
        moved, brightened = aliased(image, np.concatenate(list(own.values())))
        found.moved_mm[rows] = moved * cell_mm
        found.brightened[rows] = brightened
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
    """Light of the fitted model over its background, and the size of its cells, mm."""
    begun = replace(
        first_stage(these, stage.layout, stage.parameters),
        blades=stage.blades,
        weight=first_weights(these, MODEL_SHARE),
    )
    found = settled(begun, _ROUNDS)
    image = these.light - found.residual - found.nuisance[..., 1, None, None]
    cell_mm = these.dots.cell_mm[:, None]
    unusual = _unusual_mm(-found.corner_mm, np.asarray(these.dots.field_mm), these.take)
    return shifted(image, -unusual / cell_mm), cell_mm


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


def shifted(
    image: Float[np.ndarray, "*patches rows columns"],
    cells: Float[np.ndarray, "*patches 2"],
) -> Float[np.ndarray, "*patches rows columns"]:
    """Every patch moved by so many columns and rows, by cubic splines."""
    across = _shifted_along_rows(image, cells[..., 0])
    down = _shifted_along_rows(np.swapaxes(across, -1, -2), cells[..., 1])
    return np.swapaxes(down, -1, -2)


def _shifted_along_rows(image: np.ndarray, cells: np.ndarray) -> np.ndarray:
    count = image.shape[-1]
    spline = spline_filter1d(image, axis=-1, mode="nearest")
    from_column = np.arange(count) - cells[..., None]
    before = np.floor(from_column).astype(int)
    t = from_column - before
    weights = [
        (1 - t) ** 3,
        (3 * t - 6) * t**2 + 4,
        ((3 - 3 * t) * t + 3) * t + 1,
        t**3,
    ]
    found = np.zeros_like(image)
    for k, weight in enumerate(weights):
        column = np.clip(before + k - 1, 0, count - 1)
        columns = np.broadcast_to(column[..., None, :], image.shape)
        found += weight[..., None, :] / 6 * np.take_along_axis(spline, columns, -1)
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
