"""Colour that JPEG stores at lower resolution than brightness (4:2:0), put back.

Of the encoded values JPEG keeps brightness Y at every pixel; how red, green and blue
differ from it, D, is averaged over a block of pixels, and interpolated when the file is
read: by a triangle from blocks of two pixels, by repetition from longer ones, as
libjpeg does (ITU-T T.871; jdsample.c of libjpeg-turbo). Call that A. What is grey
passes unharmed; of fringes along edges half of their width is lost, and with it of
lateral colour.

A chart is black and white, so that D comes from the lens alone: red and blue are moved
against Y, and blurred more or less, by amounts that vary slowly over the frame. D is
then, in every neighbourhood, a sum of Y, its slopes, its Laplacian and the slopes of
that, each times a constant, on an even slope: to third order across edges. A of these,
which all pixels of Y give, is fitted to the D of the file by least squares; the
constants then say what A took away, and that is put back. A small share of its square
counts in the fit, so that grain and pictures without edges, of which A leaves next to
nothing to fit, get next to nothing back either. Y stays what it is.

References: J. Kopf, M. F. Cohen, D. Lischinski and M. Uyttendaele, Joint bilateral
upsampling, ACM Trans. Graphics 26 (2007) 96; K. He, J. Sun and X. Tang, Guided image
filtering, IEEE TPAMI 35 (2013) 1397.
"""

from concurrent.futures import ThreadPoolExecutor
from itertools import combinations_with_replacement, product
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float32, UInt, UInt16

Picture = Float32[np.ndarray, "height width"]

LUMA = np.array([0.299, 0.587, 0.114], np.float32)
"""Weights of red, green and blue in Y, the luma (ITU-T T.871)."""
_RED, _GREEN, _BLUE = range(3)
_CELL_BLOCKS = 8
"""Along a cell, of which there is one set of constants."""
_NEIGHBOURHOOD_CELLS = 1.0
"""Standard deviation of the Gaussian over which constants are fitted."""
_TILE_CELLS, _MARGIN_CELLS = 32, 3
"""Along a tile, whose pictures stay in a processor's cache; and beyond it."""
_THREADS = 2
_SHARE_PUT_BACK = 0.02
"""Of the square of what is put back, in the sum that the fit minimises."""
_TINY = 1e-12
_LARGEST_CODE = 65535


class ChromaBlocks(NamedTuple):
    """The blocks of pixels that share one value of colour.

    Attributes
    ----------
    size_px : Pixels along a block to the right and down.
    first_px : Column and row where the first whole block of a picture begins.
    """

    size_px: tuple[int, int]
    first_px: tuple[int, int] = (0, 0)


class _Span(NamedTuple):
    """A tile along one axis.

    Attributes
    ----------
    own, seen : Its pixels of the picture, and with the margin.
    within : The first among the second.
    """

    own: slice
    seen: slice
    within: slice


def codes_with_fringes(
    codes: UInt[np.ndarray, "height width 3"], blocks: ChromaBlocks
) -> UInt16[np.ndarray, "height width 3"]:
    """Encoded red, green and blue as before colour was stored in blocks, of 16 bits;
    clipped pixels as they are.

    Parameters
    ----------
    codes : As the file was read, interpolated.
    """
    padded, inside = _in_whole_cells(codes, blocks)
    largest = np.iinfo(codes.dtype).max
    found = np.empty(padded.shape, np.uint16)

    def put_back(tile_spans: tuple[_Span, _Span]) -> None:
        """In the tile of these rows and columns."""
        own, seen, within = zip(*tile_spans, strict=True)
        part = padded[seen]
        given = part.astype(np.float32) / largest
        clipped = (part == largest).any(-1, keepdims=True)
        tile = np.where(clipped, given, _with_fringes(given, blocks.size_px))
        tile = np.round(np.clip(tile, 0.0, 1.0) * _LARGEST_CODE)
        found[own] = tile[within]

    spans = (
        _spans(count, _CELL_BLOCKS * size)
        for count, size in zip(padded.shape[:2], blocks.size_px[::-1], strict=True)
    )
    with ThreadPoolExecutor(_THREADS) as pool:
        list(pool.map(put_back, product(*spans)))
    return found[inside]


def _spans(count: int, cell_px: int) -> list[_Span]:
    """Tiles along an axis of so many pixels."""
    margin_px, found = _MARGIN_CELLS * cell_px, []
    for first in range(0, count, _TILE_CELLS * cell_px):
        last = min(first + _TILE_CELLS * cell_px, count)
        begin = max(first - margin_px, 0)
        seen, within = (
            slice(begin, last + margin_px),
            slice(first - begin, last - begin),
        )
        found.append(_Span(slice(first, last), seen, within))
    return found


def _with_fringes(
    codes: Float32[np.ndarray, "rows columns 3"], size_px: tuple[int, int]
) -> Float32[np.ndarray, "rows columns 3"]:
    """Of a tile of whole cells, from 0 to 1."""
    luma = codes @ LUMA
    red, blue = (codes[..., k] - luma for k in (_RED, _BLUE))
    low, lost = [], []
    for feature in _features(luma):
        stored = _after_storage(feature, size_px)
        low.append(_averaged(stored, size_px))
        lost.append(feature - stored)
    squares = [_averaged(one**2, size_px) for one in lost]
    of_blocks = [_averaged(one, size_px) for one in (red, blue)]
    constants = _constants(low, squares, of_blocks)
    for away, of_features in zip((red, blue), constants, strict=True):
        for one, of_cells in zip(lost, of_features, strict=True):
            away += one * cv2.resize(of_cells, luma.shape[::-1])
    green = -(LUMA[_RED] * red + LUMA[_BLUE] * blue) / LUMA[_GREEN]
    return luma[..., None] + np.stack([red, green, blue], -1)


def _in_whole_cells(
    codes: UInt[np.ndarray, "height width 3"], blocks: ChromaBlocks
) -> tuple[UInt[np.ndarray, "rows columns 3"], tuple[slice, slice]]:
    """The picture continued to whole cells, and where it lies in that."""
    pads, inside = [], []
    for count, size, first in zip(
        codes.shape[:2], blocks.size_px[::-1], blocks.first_px[::-1], strict=True
    ):
        before = -first % size
        after = -(before + count) % (size * _CELL_BLOCKS)
        pads.append((before, after))
        inside.append(slice(before, before + count))
    return np.pad(codes, [*pads, (0, 0)], "edge"), (inside[0], inside[1])


def _constants(
    low: list[Picture], lost: list[Picture], away: list[Picture]
) -> list[list[Picture]]:
    """Of every cell, for each of the pictures of `away`, one for each feature.

    Parameters
    ----------
    low : Features after storage, averaged over blocks.
    lost : What storage takes of them, squared and averaged over blocks.
    away : Averaged over blocks.
    """
    low = [*low, *_even_slopes(low[0].shape)]
    count = len(low)
    seen = np.stack([[_over_cells(a * one) for one in away] for a in low])
    normal = np.empty((count, count, *seen.shape[2:]))
    for i, j in combinations_with_replacement(range(count), 2):
        normal[i, j] = normal[j, i] = _over_cells(low[i] * low[j])
    for k, one in enumerate(lost):
        normal[k, k] += _SHARE_PUT_BACK * _over_cells(one) + _TINY
    normal, seen = (np.moveaxis(part, (0, 1), (2, 3)) for part in (normal, seen))
    found = np.linalg.solve(normal, seen).astype(np.float32)
    return [[found[..., k, n] for k in range(len(lost))] for n in range(len(away))]


def _even_slopes(shape: tuple[int, ...]) -> list[Picture]:
    """1 and both places, of which storage takes nothing."""
    down, right = (np.linspace(-1, 1, count, dtype=np.float32) for count in shape)
    one = np.ones(shape, np.float32)
    return [one, one * right, one * down[:, None]]


def _features(luma: Picture) -> list[Picture]:
    """What fringes may be made of."""
    laplacian = cv2.Laplacian(luma, -1, borderType=cv2.BORDER_REPLICATE)
    return [luma, *_slopes(luma), laplacian, *_slopes(laplacian)]


def _slopes(picture: Picture) -> tuple[Picture, Picture]:
    down, right = np.gradient(picture)
    return right, down


def _over_cells(of_blocks: Picture) -> np.ndarray:
    """Mean over each cell and those around."""
    rows, columns = (n // _CELL_BLOCKS for n in of_blocks.shape)
    cells = cv2.resize(of_blocks, (columns, rows), interpolation=cv2.INTER_AREA)
    return cv2.GaussianBlur(cells.astype(float), (0, 0), _NEIGHBOURHOOD_CELLS)


def _after_storage(picture: Picture, size_px: tuple[int, int]) -> Picture:
    """A: averaged over blocks and interpolated."""
    averages = _averaged(picture, size_px)
    rows, columns = picture.shape
    (right, down), blocks = size_px, averages.shape[0]
    wide = cv2.resize(averages, (columns, blocks), interpolation=_way(right))
    return cv2.resize(wide, (columns, rows), interpolation=_way(down))


def _way(size: int) -> int:
    """Over blocks of two pixels linearly, which is the triangle."""
    return cv2.INTER_LINEAR if size == 2 else cv2.INTER_NEAREST


def _averaged(picture: Picture, size_px: tuple[int, int]) -> Picture:
    right, down = size_px
    rows, columns = picture.shape
    shape = (columns // right, rows // down)
    return cv2.resize(picture, shape, interpolation=cv2.INTER_AREA)
