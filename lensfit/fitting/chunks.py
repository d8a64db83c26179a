"""Detections divided into chunks of one size, so that few programs need compiling.

A program is compiled for the shapes of its arrays, and photographs hold any number of
detections. They are therefore divided into chunks of `CHUNK_SIZE` of one photograph
each, and the number of chunks is filled up to a power of two, no smaller than most
shoots need; a loop over the chunks in use pays for those alone. Within a photograph
detections are shuffled, so that

- the first chunks of all photographs are a fair sample of the whole, and
- every other detection of a chunk makes one of two random halves (`normal`).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Array, Bool, Float, Int

CHUNK_SIZE = 64
"""Detections of one chunk; a board of few fills one."""
_FEWEST_CHUNKS = 128


class Detections(NamedTuple):
    """What the residual needs of every detection; zero `whitening` leaves it out.

    Attributes
    ----------
    view : Photograph of each chunk.
    chunks : How many of the chunks are looked at.
    board : Nominal place, half boards from the middle of what was seen.
    observed_mm : Where it was seen, its centroid's predicted shift taken off.
    whitening : Turns a residual into standard deviations, 1/mm.
    """

    view: Int[Array, " chunks"]
    chunks: Int[Array, ""]
    board: Float[Array, "chunks detections 2"]
    observed_mm: Float[Array, "chunks detections 2"]
    whitening: Float[Array, "chunks detections 2 2"]


@dataclass(frozen=True, eq=False)
class Chunking:
    """Which detection of a padded (views, detections) array lies where.

    Attributes
    ----------
    index : Flat index of each detection; places without one repeat one of their view.
    real : Which places hold a detection.
    view : Photograph of each chunk.
    count : Chunks in use.
    views : Number of photographs.
    """

    index: Int[np.ndarray, "chunks detections"]
    real: Bool[np.ndarray, "chunks detections"]
    view: Int[np.ndarray, " chunks"]
    count: int
    views: int

    def in_chunks(self, values: np.ndarray) -> np.ndarray:
        """(views, detections, ...) to (chunks, detections, ...)."""
        return values.reshape(-1, *values.shape[2:])[self.index]

    def from_chunks(self, pieces: np.ndarray, like: np.ndarray) -> np.ndarray:
        """(chunks, detections, ...) in the shape of `like`; zero in empty places."""
        whole = np.zeros((like.shape[0] * like.shape[1], *pieces.shape[2:]))
        whole[self.index[self.real]] = pieces[self.real]
        return whole.reshape(*like.shape[:2], *pieces.shape[2:])

    def sample(self, detections_per_view: int) -> int:
        """Chunks that hold about so many detections of every photograph."""
        parts = -(-detections_per_view // CHUNK_SIZE)
        return min(self.count, parts * self.views)


def chunking_of(present: Bool[np.ndarray, "views detections"]) -> Chunking:
    """Divide the present detections of each photograph into chunks."""
    rng = np.random.default_rng(7)
    pieces = []
    for view, here in enumerate(present):
        mine = rng.permutation(np.flatnonzero(here)) + view * present.shape[1]
        for part, first in enumerate(range(0, max(len(mine), 1), CHUNK_SIZE)):
            pieces.append((part, view, mine[first : first + CHUNK_SIZE]))
    pieces.sort(key=lambda piece: piece[:2])
    count = len(pieces)
    total = max(_FEWEST_CHUNKS, 1 << (count - 1).bit_length())
    index = np.zeros((total, CHUNK_SIZE), int)
    real = np.zeros((total, CHUNK_SIZE), bool)
    views = np.zeros(total, int)
    for k, (_, view, mine) in enumerate(pieces):
        views[k] = view
        real[k, : len(mine)] = True
        index[k] = np.resize(mine, CHUNK_SIZE) if len(mine) else view * present.shape[1]
    return Chunking(index, real, views, count, len(present))
