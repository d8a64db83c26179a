"""Measure pieces of line in an image, whichever way they run.

Pieces nearer to upright are read row by row, the others column by column, as rows of
the transposed image; both come back in one order.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int

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


def on_whole_rows(pieces: Pieces, rows: int) -> Pieces:
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


def profile_half_width(
    image: Float[np.ndarray, "height width"],
    indices: Int[np.ndarray, "crossings 2"],
    crossings_px: Float[np.ndarray, "crossings 2"],
    pitch_px: float,
    sign: int,
) -> float:
    """Distance at which the mean profile has died away on its steeper side, pixels.

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
    half_widths = [1.0]
    for chosen, turned in _ways(pieces):
        if not len(chosen):
            continue
        some = chosen[:: max(1, len(chosen) // PIECES_FOR_PROFILE)]
        turned_image = image.T if turned else image
        stretches = _stretches(pieces, some, turned)
        distance, height = mean_profile(turned_image, stretches, widest, sign)
        half_widths.append(_foot_px(distance, height) + MARGIN_PX)
    return float(min(max(half_widths), widest))


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
