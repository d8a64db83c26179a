"""Dots on a photograph of a dot or circle grid: measured, indexed, then checked.

Bright dots on black or dark dots on white. Candidates come from a local threshold
(`blobs`), their lattice from `lattice`, their positions from `centroids`; then what
does not fit its neighbours in place, size and contrast is left out. Positions refer to
the green channel, and every channel is measured by the same rule around the same start,
so that differences between channels are lateral colour and nothing else.

A dot resembles its lattice neighbours: in contrast, in size, and in place. Reflections
of dots, texture beyond the target's edge and dirt on a missing dot's cell do not, and a
mark without neighbours cannot be checked and is left out. Larger marker dots inside the
grid are kept, since their position agrees with their neighbours.
"""

from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from lensfit.detect.blobs import POLARITIES, Blobs, find_blobs
from lensfit.detect.centroids import Measured, measure, windows_of
from lensfit.detect.lattice import (
    consistent_members,
    deviations,
    index_lattice,
    nanmedian,
)
from lensfit.detect.lattice_growth import STEPS, Board, nearest
from lensfit.detect.observations import POINT, Observations
from lensfit.errors import DetectionError
from lensfit.photograph import Photograph

_CONTRAST_RATIO = 2.5
_AREA_RATIO = 2.5
_LEAST_AREA_PX = 9.0
"""A mask of fewer samples says no more than this of a dot's size."""
_UNREST, _UNREST_RATIO = 0.11, 5.0
"""Surroundings this uneven (a shadow's edge, a scratch) make a position worthless."""
_STEEP_LIGHT, _LEAST_LIT = 0.1, 2**-2.5
"""A dot on the slope of a shadow must get this part of the usual light."""
_SLOPING_LIGHT = 0.05
"""Relative change over a radius from which the light itself looks like an overlap."""
_ROUNDS = 3
_OFF_STEPS = 0.12
_OFF_DEVIATIONS = 12.0
_LEAST_OFF_STEPS = 0.03
_MARKER_OFF = 4.0
"""A larger mark must be in its place this well, in usual deviations."""
_TOUCHING = 0.05
"""Light midway between two dots, relative to their level, that counts as overlap."""


def primitive_cells(
    indices: Int[np.ndarray, "dots 2"], asymmetric: bool
) -> Int[np.ndarray, "dots 2"]:
    """Cells in which neighbouring dots are one step apart."""
    if not asymmetric:
        return indices
    i, j = indices.T
    return np.stack([(i + j) // 2, (j - i) // 2], 1)


def resembling(
    cells: Int[np.ndarray, "dots 2"],
    points_px: Float[np.ndarray, "dots 2"],
    contrast: Float[np.ndarray, " dots"],
    area_px: Float[np.ndarray, " dots"],
    unrest: Float[np.ndarray, " dots"],
    lit: Bool[np.ndarray, " dots"],
) -> Bool[np.ndarray, " dots"]:
    """Dots that resemble their lattice neighbours, connected to each other.

    Parameters
    ----------
    cells : Cells in which neighbouring dots are one step apart.
    points_px : Measured positions; NaN where the measurement failed.
    contrast : Positive level of each dot against its surroundings.
    area_px : Area of each dot's mask.
    unrest : Deviation of each dot's surroundings from a smooth background, relative
        to its level.
    lit : Whether enough light falls on each dot to tell where it is.
    """
    good = np.isfinite(points_px).all(1) & (contrast > 0) & lit
    if good.any():
        good &= unrest < max(_UNREST, _UNREST_RATIO * float(np.median(unrest[good])))
    points_px = np.where(good[:, None], points_px, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        tone = np.log(np.where(good, contrast, 1))
        size = np.log(np.maximum(area_px, _LEAST_AREA_PX))
    for _ in range(_ROUNDS):
        board = _board(cells, good)
        around = _around(board, cells)
        odd = _differs(tone, around, _CONTRAST_RATIO)
        odd_size = _differs(size, around, _AREA_RATIO)
        vouched = sum(board.at(cells + step) >= 0 for step in STEPS) >= 3
        off = deviations(board, points_px)
        usual = np.nanmedian(off) if np.isfinite(off).any() else 0.0
        vouched &= (size > np.median(size[good])) & ~(
            off > max(_MARKER_OFF * usual, 0.01)
        )
        odd |= odd_size & ~vouched
        odd |= (around < 0).all(0)
        odd |= off > min(_OFF_STEPS, max(_LEAST_OFF_STEPS, _OFF_DEVIATIONS * usual))
        if not np.any(good & odd):
            break
        good &= ~odd
        if np.count_nonzero(good) < 4:
            break
    board = _board(cells, good)
    return consistent_members(board, points_px)


def lit_enough(
    light: Float[np.ndarray, " dots"], steepness: Float[np.ndarray, " dots"]
) -> Bool[np.ndarray, " dots"]:
    """Whether dots are outside the depth of a penumbra.

    What light gets there comes past an edge, through part of the pupil or off the
    lamp's rim, and moves dots by a good part of a pixel. Evenly dim dots are fine.

    Parameters
    ----------
    light : Brightness of each dot's surroundings.
    steepness : Relative change of the light over the dot's radius.
    """
    known = np.isfinite(light)
    usual = float(np.median(light[known])) if known.any() else 0.0
    return ~((steepness > _STEEP_LIGHT) & (light < _LEAST_LIT * usual))


def overlapping(
    image: Float[np.ndarray, "height width"],
    cells: Int[np.ndarray, "dots 2"],
    points_px: Float[np.ndarray, "dots 2"],
    level: Float[np.ndarray, " dots"],
    noise: float,
    steepness: Float[np.ndarray, " dots"],
) -> Bool[np.ndarray, " dots"]:
    """Whether light (or dark) of a dot still shows midway to a neighbour.

    Compared with the middle of the cell's four corners, which is farthest from dots.

    Parameters
    ----------
    image : Scene-linear luminance.
    cells : Cells in which neighbouring dots are one step apart.
    points_px : Measured positions.
    level : Brightness of each dot against its surroundings, negative for dark dots.
    noise : Standard deviation of the surroundings.
    steepness : Relative change of the light over the dot's radius; where the light is
        steep its own slope hides an overlap.
    """
    smooth = cv2.GaussianBlur(image, (0, 0), 1.0)
    board = _board(cells, np.ones(len(cells), bool))
    neighbour = np.stack([board.at(cells + step) for step in STEPS])
    corner = np.stack(
        [board.at(cells + STEPS[k] + STEPS[(k + 1) % 4]) for k in range(4)]
    )
    padded = np.concatenate([points_px, np.full((1, 2), np.nan)])
    between = _sample(smooth, (padded[neighbour] + points_px) / 2)
    empty = nanmedian(_sample(smooth, (padded[corner] + points_px) / 2))
    excess = (between - empty) * np.sign(level)
    limit = np.maximum(_TOUCHING * np.abs(level), 5 * noise)
    with np.errstate(invalid="ignore"):
        touching = np.asarray(excess > limit)
    return np.asarray(touching.any(axis=0)) & (steepness < _SLOPING_LIGHT)


def _board(cells, good) -> Board:
    board = Board(len(cells))
    members = np.flatnonzero(good)
    board.place(members, cells[members])
    return board


def _around(board: Board, cells) -> Int[np.ndarray, "24 dots"]:
    """The dots of the 5 x 5 cells about each, -1 where there is none."""
    offsets = [(i, j) for i in range(-2, 3) for j in range(-2, 3) if (i, j) != (0, 0)]
    return np.stack([board.at(cells + np.array(offset)) for offset in offsets])


def _differs(value, around, ratio: float):
    """Whether a logarithm is farther from its neighbours' median than the ratio."""
    padded = np.append(value, np.nan)
    with np.errstate(invalid="ignore"):
        return np.abs(value - nanmedian(padded[around])) > np.log(ratio)


def _sample(image, points_px):
    """Nearest sample at positions; NaN outside or where the position is NaN."""
    height, width = image.shape
    known = np.isfinite(points_px).all(-1)
    place = np.floor(np.where(known[..., None], points_px, 0)).astype(int)
    x = np.clip(place[..., 0], 0, width - 1)
    y = np.clip(place[..., 1], 0, height - 1)
    return np.where(known, image[y, x], np.nan)


_FEWEST = 16
_THREADS = 2
"""Of channels: the noise of one is judged while dots of another are measured."""


def find_dots(
    photograph: Photograph,
    *,
    polarity: str | None = None,
    asymmetric: bool = False,
) -> Observations:
    """Find, measure and index the dots of a grid.

    Parameters
    ----------
    photograph : Scene-linear picture.
    polarity : "bright" dots on black, "dark" dots on white, or None to find out.
    asymmetric : The target is an asymmetric circle grid.

    Raises
    ------
    DetectionError : No dots, too few, or no lattice among them; the sentence says what
        was seen and what to do.
    """
    polarities = POLARITIES if polarity is None else (polarity,)
    if not set(polarities) <= set(POLARITIES):
        raise ValueError(f"polarity must be one of {POLARITIES} or None")
    image = photograph.luminance_channel
    search = find_blobs(np.ascontiguousarray(image), polarities)
    candidates = len(search.blobs.centre_px)
    indices, valid = index_lattice(search.blobs.centre_px, asymmetric=asymmetric)
    if np.count_nonzero(valid) < _FEWEST:
        raise _complaint(photograph, image, candidates, int(valid.sum()))
    whole = valid & ~search.blobs.cut
    blobs, strays = search.blobs.subset(whole), search.blobs.subset(~valid)
    observations = _observe(
        photograph, blobs, indices[whole], search.polarity, asymmetric, strays
    )
    if len(observations) < _FEWEST:
        raise _complaint(photograph, image, candidates, len(observations))
    return observations


def _observe(
    photograph: Photograph, blobs: Blobs, indices, polarity, asymmetric, strays: Blobs
) -> Observations:
    """Measure every channel, leave out what is no dot, and fill in the record."""
    pixels, ceiling = photograph.pixels, photograph.saturation
    green = 1 if pixels.shape[2] == 3 else 0
    spacing = nearest(KDTree(blobs.centre_px), blobs.centre_px, 2)[0][:, 1]
    windows = windows_of(blobs.moment_px2, spacing, bright=polarity == "bright")
    ignore = _stray_mask(strays, pixels.shape[:2])

    def measured(channel: int) -> Measured:
        light = pixels[..., channel]
        return measure(light, blobs.centre_px, windows, polarity, ceiling, ignore)

    with ThreadPoolExecutor(_THREADS) as pool:
        channels = list(pool.map(measured, range(pixels.shape[2])))
    candidates = len(blobs.centre_px) + len(strays.centre_px)
    main = channels[green]
    sign = 1 if polarity == "bright" else -1
    tone = sign * main.level / (1 if polarity == "bright" else main.background)
    cells = primitive_cells(indices, asymmetric)
    with np.errstate(divide="ignore", invalid="ignore"):  # some have no light
        unrest = main.noise / np.abs(main.level)
    lit = lit_enough(main.background, main.steepness)
    keep = resembling(cells, main.centre_px, tone, blobs.area_px, unrest, lit)
    channels = [Measured(*(column[keep] for column in m)) for m in channels]
    main = channels[green]
    touching = overlapping(
        photograph.luminance_channel,
        cells[keep],
        main.centre_px,
        main.level,
        float(np.median(main.noise)) if keep.any() else 0.0,
        main.steepness,
    )
    lattice = _from_zero(indices[keep], asymmetric)
    return _record(photograph, lattice, channels, touching, polarity, candidates)


def _from_zero(indices: np.ndarray, asymmetric: bool) -> np.ndarray:
    """Indices counted from the smallest of the dots that are left."""
    least = indices.min(0, initial=1 << 30)
    if asymmetric:
        least -= [0, least.sum() % 2]  # keep i + j even
    return indices - least if len(indices) else indices


def _stray_mask(strays: Blobs, shape: tuple[int, int]) -> np.ndarray:
    """Mask of the marks that belong to no lattice, with their blur."""
    mask = np.zeros(shape, np.uint8)
    radius = 1.3 * np.sqrt(strays.area_px / np.pi) + 2
    centres = np.floor(strays.centre_px).astype(int)
    for (x, y), r in zip(centres.tolist(), np.ceil(radius).astype(int), strict=True):
        cv2.circle(mask, (x, y), int(r), 1, -1)
    return mask.view(bool)


def _record(
    photograph, indices, channels: list[Measured], touching, polarity, candidates
) -> Observations:
    """The observations of measured, checked dots."""
    count = len(indices)
    main = channels[1 if len(channels) == 3 else 0]
    points = np.full((3, count, 2), np.nan)
    covariances = np.full((3, count, 2, 2), np.nan)
    if len(channels) == 3:
        points = np.stack([m.centre_px for m in channels])
        covariances = np.stack([m.covariance_px2 for m in channels])
    saturated = np.any([m.saturated for m in channels], axis=0)
    flux = [m.flux if polarity == "bright" else m.background for m in channels]
    half_trace = np.trace(main.moment_px2, axis1=1, axis2=2) / 2
    return Observations(
        lattice=indices.astype(float),
        points_px=main.centre_px,
        covariance_px2=main.covariance_px2,
        family=np.full(count, POINT),
        normal=np.full((count, 2), np.nan),
        saturated=saturated,
        overlapping=touching,
        channel_points_px=points,
        channel_covariance_px2=covariances,
        flux=np.stack(flux, 1),
        diameter_px=4 * np.sqrt(np.maximum(half_trace, 0)),
        image_size_px=photograph.size_px,
        candidates=candidates,
        bright=polarity == "bright",
    )


def _complaint(photograph, image, candidates: int, indexed: int) -> DetectionError:
    """What was seen on a photograph without a grid, and what to do."""
    clipped = float(np.mean(image >= photograph.saturation))
    if clipped > 0.5:
        what = f"no dot grid found: {clipped:.0%} of the picture is over-exposed"
        remedy = "expose less, or light the target evenly"
    elif not candidates:
        what, remedy = "no dots found", "check the picture, its polarity and its roi"
    elif indexed < 9:
        what = f"{candidates} dot-like marks found, but no lattice among them"
        remedy = "check that this is a dot grid, or set a roi around it"
    else:
        what = f"only {indexed} dots of a lattice found, {_FEWEST} are needed"
        remedy = "show more of the target, or set a roi around it"
    return DetectionError(what, where=photograph.path, remedy=remedy)
