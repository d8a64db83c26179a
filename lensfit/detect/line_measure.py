"""Measure pieces of line in an image, whichever way they run.

Pieces nearer to upright are read row by row, the others column by column, as rows of
the transposed image; both come back in one order.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.optimize import least_squares
from scipy.special import erf

from lensfit.detect.line_curves import Pieces, cut_pieces
from lensfit.detect.line_profile import (
    Centres,
    Stretches,
    Window,
    mean_profile,
    measure_centres,
)

PROFILE_FOOT = 0.2
MARGIN_PX = 0.5
"""A profile ends half a pixel beyond where it falls to this fraction of its height:
a sharp one is then held whole, and long tails (scatter in the target, glare), seldom
the same on both sides, are not."""
WIDEST_PROFILE = 0.3
"""Widest half profile, in pitches."""
PIECES_FOR_PROFILE = 500
_NUMBERS = 4
"""Of a line's shape: half width, blur, height and base."""
LINE_WIDTH_DEVIATION = 0.05
"""Standard deviation of the width in pitches, a share: a bound that is not computed.
Drawn lines, turned and in perspective, come out within 4 %; the local pitch in place of
the mean one would do better."""
_RESOLVED = 2.0
"""Width of a line over the blur of its edges from which both edges are told apart."""


class MeanProfile(NamedTuple):
    """Median profile across many pieces of line.

    Attributes
    ----------
    distance_px : Along the axis that pieces are read along, from the middle.
    height : Signed image value; NaN where there is none.
    slant : Distance across the line per distance along that axis.
    """

    distance_px: Float[np.ndarray, " bins"]
    height: Float[np.ndarray, " bins"]
    slant: float


class LineShape(NamedTuple):
    """Two edges, blurred evenly.

    Attributes
    ----------
    width_px : From edge to edge.
    blur_px : Standard deviation of the blur, pixels included.
    """

    width_px: float
    blur_px: float

    @property
    def deviation_px(self) -> float:
        """Standard deviation of the light across the line."""
        return float(np.hypot(self.blur_px, self.width_px / np.sqrt(12)))

    @property
    def is_resolved(self) -> bool:
        """Whether its edges can be told apart."""
        return self.width_px >= _RESOLVED * self.blur_px


def measure_pieces(
    image: Float[np.ndarray, "height width"],
    pieces: Pieces,
    window: Window,
    sign: int,
    start_px: Float[np.ndarray, " pieces"] | None = None,
) -> Centres:
    """Centres of all pieces; displacements are along x or y as `read_axis` says."""
    parts, places = [], []
    for chosen, turned in _ways(pieces):
        parts.append(
            measure_centres(
                image.T if turned else image,
                _stretches(pieces, chosen, turned),
                window,
                sign,
                None if start_px is None else start_px[chosen],
            )
        )
        places.append(chosen)
    back = np.argsort(np.concatenate(places))
    return Centres(
        *(
            np.concatenate([getattr(part, name) for part in parts])[back]
            for name in Centres.__dataclass_fields__
        )
    )


def pieces_on_whole_rows(pieces: Pieces, rows: int) -> Pieces:
    """The same pieces moved along their line by up to half a pixel.

    Their middle becomes that of the rows (or columns) that are read, so that an error
    of the predicted slope does not shift the centre.
    """
    upright = _upright(pieces)[:, None]

    def along_scan(vectors: np.ndarray) -> np.ndarray:
        return np.where(upright, vectors[:, 1:], vectors[:, :1])

    place = along_scan(pieces.points_px)
    step = np.round(place - rows / 2) + rows / 2 - place
    step = step / along_scan(pieces.tangent_px)
    return replace(
        pieces,
        along=pieces.along + step[:, 0],
        points_px=pieces.points_px
        + step * pieces.tangent_px
        + step**2 / 2 * pieces.bend_px,
        tangent_px=pieces.tangent_px + step * pieces.bend_px,
    )


def read_axis(pieces: Pieces) -> Float[np.ndarray, "pieces 2"]:
    """The axis each piece is read along: x if it is nearer to upright, else y."""
    return np.where(_upright(pieces)[:, None], [1.0, 0.0], [0.0, 1.0])


def _upright(pieces: Pieces) -> Bool[np.ndarray, " pieces"]:
    return np.abs(pieces.tangent_px[:, 1]) >= np.abs(pieces.tangent_px[:, 0])


def mean_profiles(
    image: Float[np.ndarray, "height width"],
    indices: Int[np.ndarray, "crossings 2"],
    crossings_px: Float[np.ndarray, "crossings 2"],
    pitch_px: float,
    sign: int,
) -> list[MeanProfile]:
    """Of the pieces that are read along x, and of those that are read along y.

    Parameters
    ----------
    image : Samples, channel units.
    indices, crossings_px : The numbered crossings.
    pitch_px : Distance between neighbouring crossings, pixels.
    sign : +1 for bright lines, -1 for dark ones.
    """
    widest = WIDEST_PROFILE * pitch_px
    third = widest / 3
    pieces = cut_pieces(indices, crossings_px, Window(third, third, third, 3))
    found = []
    for chosen, turned in _ways(pieces):
        if not len(chosen):
            continue
        some = chosen[:: max(1, len(chosen) // PIECES_FOR_PROFILE)]
        turned_image = image.T if turned else image
        stretches = _stretches(pieces, some, turned)
        distance, height = mean_profile(turned_image, stretches, widest, sign)
        slant = float(np.median(1 / np.hypot(1, stretches.slope)))
        found.append(MeanProfile(distance, height, slant))
    return found


def profile_half_width_px(profiles: list[MeanProfile], pitch_px: float) -> float:
    """Distance at which the mean profile has died away on its steeper side.

    Parameters
    ----------
    pitch_px : Distance between neighbouring crossings.
    """
    feet_px = [_foot_px(one.distance_px, one.height) + MARGIN_PX for one in profiles]
    return float(min(max([1.0, *feet_px]), WIDEST_PROFILE * pitch_px))


def line_shape(profiles: list[MeanProfile]) -> LineShape | None:
    """Width and blur of lines by least squares; None where there is no profile."""
    across_px = np.concatenate([one.distance_px * one.slant for one in profiles])
    height = np.concatenate([_relative_height(one.height) for one in profiles])
    seen = np.isfinite(height)
    if seen.sum() <= _NUMBERS:
        return None
    across_px, height = across_px[seen], height[seen]
    foot_px = max(float(np.abs(across_px[height > PROFILE_FOOT]).max()), 1.0)

    def left(numbers: np.ndarray) -> np.ndarray:
        half_px, blur_px = np.exp(numbers[:2])
        edges = [
            erf((across_px + side * half_px) / (np.sqrt(2) * blur_px))
            for side in (1, -1)
        ]
        return numbers[2] * (edges[0] - edges[1]) / 2 + numbers[3] - height

    start = np.array([np.log(foot_px / 2), np.log(foot_px / 2), 1.0, 0.0])
    half_px, blur_px = np.exp(least_squares(left, start, loss="soft_l1").x[:2])
    return LineShape(float(2 * half_px), float(blur_px))


def _relative_height(height: Float[np.ndarray, " bins"]) -> Float[np.ndarray, " bins"]:
    """From 0 beside the line to 1 on it; NaN where it is level."""
    if not np.isfinite(height).any():
        return height
    low, high = np.nanmin(height), np.nanmax(height)
    return (height - low) / (high - low) if high > low else np.full_like(height, np.nan)


def _foot_px(
    distance_px: Float[np.ndarray, " bins"], height: Float[np.ndarray, " bins"]
) -> float:
    """Distance at which the profile falls to its foot, on its steeper side."""
    seen = np.isfinite(height)
    if not seen.any():
        return 0.0
    # Lines that all lie alike on the pixels leave some distances without a sample.
    height = np.interp(distance_px, distance_px[seen], height[seen])
    height = height - height.min()
    high = height > PROFILE_FOOT * height.max()
    middle = len(height) // 2
    right, left = high[middle:], high[middle::-1]
    steps = min(np.argmin(right) or len(right), np.argmin(left) or len(left))
    return float(steps * (distance_px[1] - distance_px[0]))


def _ways(pieces: Pieces) -> Iterator[tuple[np.ndarray, bool]]:
    """Pieces read along x, then those read along y in the transposed image."""
    upright = _upright(pieces)
    for turned in (False, True):
        yield np.flatnonzero(upright != turned), turned


def _stretches(pieces: Pieces, chosen: np.ndarray, turned: bool) -> Stretches:
    """The chosen pieces as curves x(y), or y(x) when the image is turned."""
    axes = [1, 0] if turned else [0, 1]
    x, y = pieces.points_px[chosen][:, axes].T
    tx, ty = pieces.tangent_px[chosen][:, axes].T
    bx, by = pieces.bend_px[chosen][:, axes].T
    return Stretches(x_px=x, y_px=y, slope=tx / ty, bend=(bx * ty - by * tx) / ty**3)
