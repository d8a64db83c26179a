"""Colour at lower resolution than brightness, as JPEG stores it (4:2:0, 4:2:2).

Of the encoded values JPEG keeps brightness Y at every pixel; how red, green and blue
differ from it is averaged over a block of pixels, and interpolated when the file is
read: by a triangle from blocks of two pixels, by repetition from longer ones, as
libjpeg does (ITU-T T.871; jdsample.c of libjpeg-turbo). What is grey passes unharmed;
a colour fringe of a pixel is widened, and light of one channel goes to the others.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

_LUMA = np.array([0.299, 0.587, 0.114])
"""Weights of red, green and blue in Y (ITU-T T.871)."""
_OF_NEAREST = 0.75
"""Weight of a pixel's own block of two; the rest is its neighbour's."""


class ChromaBlocks(NamedTuple):
    """The blocks of pixels that share one value of colour.

    Attributes
    ----------
    size_px : Pixels along a block to the right and down.
    first_px : Column and row where the first whole block of a picture begins.
    """

    size_px: tuple[int, int]
    first_px: tuple[int, int] = (0, 0)

    def cropped(self, columns: int, rows: int) -> "ChromaBlocks":
        """Those of the picture without its first so many columns and rows."""
        away = zip(self.first_px, (columns, rows), self.size_px, strict=True)
        right, down = ((first - gone) % size for first, gone, size in away)
        return self._replace(first_px=(right, down))


def codes_after_storage(
    codes: Float[np.ndarray, "patches 3 rows columns"],
    corner_px: Int[np.ndarray, "patches 2"],
    blocks: ChromaBlocks,
) -> Float[np.ndarray, "patches 3 rows columns"]:
    """What a file gives back of encoded patches of a photograph.

    What lies beyond a patch is taken to be as its border is.

    Parameters
    ----------
    corner_px : Column and row of the first pixel of each patch.
    """
    luma = np.einsum("c,ncij->nij", _LUMA, codes)[:, None]
    first = np.asarray(blocks.first_px) - corner_px
    right, down = (
        _pixels_after_storage(count, size, first[:, axis] % size)
        for axis, (count, size) in enumerate(
            zip(codes.shape[:1:-1], blocks.size_px, strict=True)
        )
    )
    return luma + down[:, None] @ (codes - luma) @ right[:, None].swapaxes(2, 3)


def _pixels_after_storage(
    count: int, size: int, first: Int[np.ndarray, " patches"]
) -> Float[np.ndarray, "patches count count"]:
    """What each pixel along an axis is made of.

    Parameters
    ----------
    size : Pixels along a block.
    first : Where the first whole block begins in each patch.
    """
    of_phase = [_averaged_and_interpolated(count, size, phase) for phase in range(size)]
    return np.stack(of_phase)[first]


def _averaged_and_interpolated(
    count: int, size: int, first: int
) -> Float[np.ndarray, "count count"]:
    """The same for one phase."""
    block = (np.arange(count) - first) // size
    block = block - block[0]
    mine = block[:, None] == np.arange(block[-1] + 1)
    averaged = (mine / mine.sum(0)).T
    if size != 2:
        return averaged[block]
    later = (np.arange(count) - first) % size
    beside = np.clip(block + 2 * later - 1, 0, block[-1])
    return _OF_NEAREST * averaged[block] + (1 - _OF_NEAREST) * averaged[beside]
