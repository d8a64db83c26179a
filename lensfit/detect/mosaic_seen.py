"""Whether a photograph was interpolated from a colour mosaic, from its noise.

A value that was interpolated is a mean of its neighbours, or nearly; one that was
measured has noise of its own. So how far pixels are from the mean of their neighbours
differs between the places of a 2 x 2 lattice (A. C. Gallagher and T. Chen, CVPR
Workshops 2008): of green between the two colours of a chessboard, of red and of blue it
is largest at one place of the four, red's and blue's across from each other. Only
together these are taken for a mosaic, and only where the picture is quiet: structure
may have any period.
"""

import cv2
import numpy as np

from lensfit.mosaic import MOSAICS, Mosaic, photosites
from lensfit.photograph import Photograph

_LARGEST_PX = 1024
_BLOCK = 8
_QUIET = 0.5
"""Share of the blocks that count: those with the least structure."""
_FEWEST_BLOCKS = 40
_MOST = (0.8, 0.75, 0.8)
"""Of red, green and blue: interpolated pixels depart from their neighbours by no more
than so much of what measured ones do; without a mosaic it is 1 within a hundredth."""
_CROSS = np.array([[0, 1, 0], [1, -4, 1], [0, 1, 0]], np.float32) / 4
_AROUND = np.array([[1, 1, 1], [1, -8, 1], [1, 1, 1]], np.float32) / 8


def mosaic_seen(photograph: Photograph) -> Mosaic | None:
    """The mosaic that a photograph was plainly interpolated from; None if none is.

    From the top left of the file as it is stored, as a shoot file states it. None too
    where nothing is told: a grey picture, one without noise, or one that is a raw file
    or holds red and blue at lower resolution, where to state it would be of no use.
    """
    pixels = photograph.pixels
    if photograph.mosaic or photograph.chroma_subsampled or pixels.shape[2] != 3:
        return None
    turned = photograph.metadata.get("orientation", 1) != 1
    if turned or min(pixels.shape[:2]) < 8 * _BLOCK:
        return None
    kernels = (_AROUND, _CROSS, _AROUND)
    found = [_departure(pixels[..., k], kernel) for k, kernel in enumerate(kernels)]
    departures = [departure for departure in found if departure is not None]
    if len(departures) < len(kernels):
        return None
    for mosaic in MOSAICS:
        own = photosites(mosaic, (2, 2))
        shares = [_less(one, own[..., k]) for k, one in enumerate(departures)]
        if np.all(np.less(shares, _MOST)):
            return mosaic
    return None


def _less(departure: np.ndarray, own: np.ndarray) -> float:
    """Largest departure where it was not measured over the least where it was."""
    least = float(departure[own].min())
    return float(departure[~own].max()) / least if least > 0 else np.inf


def _middle_of(channel: np.ndarray) -> np.ndarray:
    """Whole blocks from the middle, beginning at an even row and column."""
    whole = np.minimum(channel.shape, _LARGEST_PX) // _BLOCK * _BLOCK
    top, left = (channel.shape - whole) // 4 * 2
    return channel[top : top + whole[0], left : left + whole[1]]


def _departure(channel: np.ndarray, kernel: np.ndarray) -> np.ndarray | None:
    """Mean distance from the neighbours at the four places, in quiet blocks."""
    part = np.ascontiguousarray(_middle_of(channel), np.float32)
    height, width = part.shape
    away = np.abs(cv2.filter2D(part, -1, kernel, borderType=cv2.BORDER_REFLECT_101))
    blocks = away.reshape(height // _BLOCK, _BLOCK, width // _BLOCK, _BLOCK)
    blocks = blocks.transpose(0, 2, 1, 3)[1:-1, 1:-1].reshape(-1, _BLOCK, _BLOCK)
    level = blocks.mean((1, 2))
    noisy = np.isfinite(level) & (level > 0)
    if np.count_nonzero(noisy) < _FEWEST_BLOCKS:
        return None
    quiet = noisy & (level <= np.quantile(level[noisy], _QUIET))
    return blocks[quiet].reshape(-1, _BLOCK // 2, 2, _BLOCK // 2, 2).mean((0, 1, 3))
