"""Views stacked into arrays: start poses, and the detections of all photographs.

Detections are padded to the largest number in any photograph; padding is not `present`.

A program is compiled for the shapes of its arrays, and photographs hold any number of
detections. Start poses are therefore padded to a power of two, and detections divided
into chunks of `CHUNK_SIZE` of one photograph each, and the number of chunks is filled
up to a power of two, no smaller than most shoots need; a loop over the chunks in use
pays for those alone. Within a photograph detections are shuffled, so that

- the first chunks of all photographs are a fair sample of the whole, and
- every other detection of a chunk makes one of two random halves (`normal`).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from lensfit.coords import mm_from_px
from lensfit.detect.observations import LINE_OF_CONSTANT_I, POINT
from lensfit.fitting.chart_view import View
from lensfit.fitting.geometry import BoardPose
from lensfit.fitting.start_poses import Pose

CHUNK_SIZE = 64
"""Detections of one chunk; a board of few fills one."""
_FEWEST_CHUNKS = 128
FEWEST_VIEWS = 4
"""A state of a lens with fewer photographs runs the program of this many."""
OVERLAP_DEVIATION_PX = 0.1
"""Added to the noise of a detection whose blur touches its neighbour's."""


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


@dataclass(frozen=True, eq=False)
class Stack:
    """Views as padded arrays.

    Attributes
    ----------
    view : The stacked start poses.
    chunking : Division of the detections into chunks.
    board : Nominal place of every detection, half boards.
    observed_mm : Where it was seen.
    present : Which rows are detections.
    covariance_mm2 : Of each detection; identity for padding.
    normal : Unit vector across the line, NaN for points and padding.
    mm_per_px : Size of a pixel.
    """

    view: BoardPose
    chunking: Chunking
    board: Float[np.ndarray, "views detections 2"]
    observed_mm: Float[np.ndarray, "views detections 2"]
    present: Bool[np.ndarray, "views detections"]
    covariance_mm2: Float[np.ndarray, "views detections 2 2"]
    normal: Float[np.ndarray, "views detections 2"]
    mm_per_px: Float[np.ndarray, " views"]

    @cached_property
    def filled_view(self) -> BoardPose:
        """The start poses, and copies of the first ones up to a power of two."""
        count = len(self.present)
        room = max(FEWEST_VIEWS, 1 << (count - 1).bit_length())
        places = np.arange(room) % count
        return jax.tree.map(lambda a: jnp.asarray(np.asarray(a)[places]), self.view)


def board_of(view: View) -> Float[np.ndarray, "detections 2"]:
    """Nominal place of every detection, mm from the middle of the lattice seen."""
    lattice = view.observations.lattice
    middle = np.round((lattice.max(0) + lattice.min(0)) / 2)
    return (lattice - middle) * np.asarray(view.pitch_mm)


def observed_of(view: View) -> Float[np.ndarray, "detections 2"]:
    """Where every detection was seen, sensor mm."""
    observations = view.observations
    return mm_from_px(
        observations.points_px, observations.image_size_px, view.sensor_size_mm
    )


def stack_takes(
    views: list[View], poses: list[Pose], apertures: list[int], whole: list[bool]
) -> Stack:
    """Stack views whose start poses are known."""
    most = max(len(view.observations) for view in views)
    count = len(views)
    board = np.zeros((count, most, 2))
    observed = np.zeros((count, most, 2))
    covariance = np.tile(np.eye(2), (count, most, 1, 1))
    normal = np.full((count, most, 2), np.nan)
    present = np.zeros((count, most), bool)
    half = np.zeros((count, 2))
    mm_per_px = np.zeros(count)
    for k, view in enumerate(views):
        n = len(view.observations)
        board[k, :n] = board_of(view)
        half[k] = np.maximum(np.abs(board[k, :n]).max(0), 1e-9)
        observed[k, :n] = observed_of(view)
        mm_per_px[k] = view.sensor_size_mm[0] / view.observations.image_size_px[0]
        doubt = OVERLAP_DEVIATION_PX**2 * view.observations.overlapping[:, None, None]
        noise = view.observations.covariance_px2 + doubt * np.eye(2)
        covariance[k, :n] = noise * mm_per_px[k] ** 2
        lines = view.observations.family != POINT
        normal[k, :n][lines] = view.observations.normal[lines]
        present[k, :n] = True
    start = BoardPose(
        rotation=jnp.asarray(np.stack([p.rotation for p in poses])),
        translation_mm=jnp.asarray(np.stack([p.translation_mm for p in poses])),
        aperture=jnp.asarray(apertures),
        half_board_mm=jnp.asarray(half),
        whole_board=jnp.asarray(np.asarray(whole, float)),
    )
    return Stack(
        view=start,
        chunking=chunking_of(present),
        board=board / half[:, None],
        observed_mm=observed,
        present=present,
        covariance_mm2=covariance,
        normal=normal,
        mm_per_px=mm_per_px,
    )


def whitening_of(
    stack: Stack, model_variance_mm2: Float[np.ndarray, " views"]
) -> Float[np.ndarray, "views detections 2 2"]:
    """Matrices that turn residuals into standard deviations; zero for padding.

    `model_variance_mm2` is what the model leaves besides detection noise, so that a
    detection with little noise does not outvote its neighbours.
    """
    total = stack.covariance_mm2 + model_variance_mm2[:, None, None, None] * np.eye(2)
    points = _inverse_root(total)
    lines = np.isfinite(stack.normal[..., 0])
    deviation = np.sqrt(variance_of(total, stack.normal))
    rows = np.nan_to_num(stack.normal) / deviation[..., None]
    one_row = np.stack([rows, np.zeros_like(rows)], -2)
    whitening = np.where(lines[..., None, None], one_row, points)
    return whitening * stack.present[..., None, None]


def noise_mm2(stack: Stack) -> Float[np.ndarray, "views detections"]:
    """Detection variance of one residual of every detection."""
    return variance_of(stack.covariance_mm2, stack.normal)


def variance_of(
    covariance: Float[np.ndarray, "*detections 2 2"],
    normal: Float[np.ndarray, "*detections 2"],
) -> Float[np.ndarray, "*detections"]:
    """Variance of one residual of every detection.

    Of a point (its normal is NaN) the mean over both axes; of a line sample across the
    line, since along it nothing was measured.
    """
    n = np.nan_to_num(normal)
    across = np.einsum("...i,...ij,...j->...", n, covariance, n)
    mean = np.trace(covariance, axis1=-2, axis2=-1) / 2
    return np.where(np.isfinite(normal[..., 0]), across, mean)


def residuals_of(stack: Stack) -> Int[np.ndarray, "views detections"]:
    """Number of residuals of every detection: two of a point, one of a line sample."""
    return np.where(np.isfinite(stack.normal[..., 0]), 1, 2)


def _inverse_root(
    covariance: Float[np.ndarray, "... 2 2"],
) -> Float[np.ndarray, "... 2 2"]:
    """Inverse of the lower Cholesky factor; LAPACK is slow on tiny matrices."""
    first = 1 / np.sqrt(covariance[..., 0, 0])
    below = covariance[..., 1, 0] * first
    second = 1 / np.sqrt(covariance[..., 1, 1] - below**2)
    root = np.zeros_like(covariance)
    root[..., 0, 0], root[..., 1, 1] = first, second
    root[..., 1, 0] = -below * first * second
    return root


def line_numbers(family: np.ndarray, lattice: np.ndarray) -> np.ndarray:
    """A number for every line of a lattice, so that lines can be told apart."""
    across = np.where(family == LINE_OF_CONSTANT_I, lattice[:, 0], lattice[:, 1])
    return np.round(across).astype(int)
