"""The error of a UV map that is coarser than its frame and enlarged where it is used.

UV maps of a lens are smooth, so that a map of an eighth of the width is often as good
as the whole one; how coarse it may be depends on the lens. Here a coarse map is
enlarged as compositing programs do it, with pixel centres aligned: linearly, or by the
cubic of Keys (a = -1/2; "Keys" in Nuke's Reformat). Both reproduce ramps, so that for
an ideal lens every width is exact.
"""

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_array

from lensfit.batches import in_batches
from lensfit.coords import px_from_uv
from lensfit.exchange.stmaps import StmapFrame, channel_uv
from lensfit.rendering.uv import PlateGeometry

if TYPE_CHECKING:
    from lensfit.lens import Lens

FIRST_WIDTH_PX = 512
_MOST_COMPARED = 512


class WidthError(NamedTuple):
    """Errors of both maps of a width, px of the frame.

    Attributes
    ----------
    width_px, height_px : Of the map.
    linear_rms_px, linear_worst_px : Enlarged linearly.
    cubic_rms_px, cubic_worst_px : Enlarged by the cubic of Keys.
    """

    width_px: int
    height_px: int
    linear_rms_px: float
    linear_worst_px: float
    cubic_rms_px: float
    cubic_worst_px: float


def width_errors(
    lens: "Lens", frame: StmapFrame, tolerance_px: float
) -> list[WidthError]:
    """Of maps of 512 pixels, 1024 and so on, and of the width of the frame.

    Parameters
    ----------
    frame : The whole frame; positions of green are compared with the lens' own
        equations at up to 512 x 512 pixels, the border among them.
    tolerance_px : Largest error of the interpolation between exact evaluations.
    """
    columns, rows = (_spread(n) for n in frame.size_px)
    exact = _exact_px(lens, frame, columns, rows)
    widths, width = [], FIRST_WIDTH_PX
    while width < frame.size_px[0]:
        widths.append(width)
        width *= 2
    widths.append(frame.size_px[0])
    return [
        _error(lens, frame, w, exact, (columns, rows), tolerance_px) for w in widths
    ]


def _spread(count: int) -> Int[np.ndarray, " some"]:
    """Pixels along a side, first and last among them."""
    return np.unique(np.linspace(0, count - 1, _MOST_COMPARED).round().astype(int))


def _exact_px(
    lens: "Lens", frame: StmapFrame, columns: np.ndarray, rows: np.ndarray
) -> dict[str, np.ndarray]:
    """Where pixels read in both directions, by the lens itself."""
    geometry = PlateGeometry.of(
        lens, frame.display_window, frame.spanned_width_mm(lens)
    )
    own = np.stack(np.meshgrid(columns + 0.5, rows + 0.5), -1)
    mappings = {
        "undistort": geometry.distorted(lens, "g"),
        "redistort": geometry.undistorted(lens, "g"),
    }
    return {
        direction: in_batches(mapping, own.reshape(-1, 2)).reshape(own.shape)
        for direction, mapping in mappings.items()
    }


def _error(
    lens: "Lens",
    frame: StmapFrame,
    width: int,
    exact: dict[str, np.ndarray],
    pixels: tuple[np.ndarray, np.ndarray],
    tolerance_px: float,
) -> WidthError:
    coarse = replace(frame, overscan_percent=0.0, map_width_px=width).map_frame
    # What is an error of a pixel of the frame is less of a coarse one.
    tolerance_px *= width / frame.size_px[0]
    found: dict[int, list[np.ndarray]] = {2: [], 4: []}
    for direction, wanted in exact.items():
        uv = channel_uv(lens, coarse, direction, "g", tolerance_px).astype(np.float64)
        for taps, errors in found.items():
            large = enlarged_samples(uv, frame.size_px, coarse.margin_px, taps, pixels)
            off = px_from_uv(large, frame.display_window) - wanted
            errors.append(np.hypot(off[..., 0], off[..., 1]).ravel())
    linear, cubic = (np.concatenate(errors) for errors in found.values())
    return WidthError(
        *coarse.size_px,
        float(np.sqrt(np.nanmean(linear**2))),
        float(np.nanmax(linear)),
        float(np.sqrt(np.nanmean(cubic**2))),
        float(np.nanmax(cubic)),
    )


def enlarged_samples(
    samples: Float[np.ndarray, "height width channels"],
    size_px: tuple[int, int],
    margin_px: int,
    taps: int,
    pixels: tuple[np.ndarray, np.ndarray],
) -> Float[np.ndarray, "rows columns channels"]:
    """Samples with a margin, enlarged to a frame, pixel centres aligned.

    Parameters
    ----------
    size_px : Width and height of the frame.
    margin_px : Samples beyond the frame on each side; at least half the taps.
    taps : 2 is linear, 4 the cubic of Keys.
    pixels : Columns and rows of the frame that are wanted.
    """
    height, width = samples.shape[:2]
    across = _weights(width, size_px[0], margin_px, taps, pixels[0])
    down = _weights(height, size_px[1], margin_px, taps, pixels[1])
    planes = (down @ plane @ across.T for plane in np.moveaxis(samples, -1, 0))
    return np.stack(list(planes), -1)


def _weights(
    count: int, size: int, margin: int, taps: int, pixels: np.ndarray
) -> csr_array:
    """Of `count` samples in each of some pixels of a side of `size`."""
    scale = (count - 2 * margin) / size
    at = (pixels + 0.5) * scale - 0.5 + margin
    first = np.floor(at).astype(int)
    t = at - first
    if taps == 2:
        weights = np.stack([1 - t, t])
    else:
        weights = np.stack(
            [
                ((-0.5 * t + 1) * t - 0.5) * t,
                (1.5 * t - 2.5) * t * t + 1,
                ((-1.5 * t + 2) * t + 0.5) * t,
                (0.5 * t - 0.5) * t * t,
            ]
        )
    columns = first + np.arange(taps)[:, None] - (taps // 2 - 1)
    rows = np.broadcast_to(np.arange(len(pixels)), columns.shape)
    columns = np.clip(columns, 0, count - 1)
    return csr_array(
        (weights.ravel(), (rows.ravel(), columns.ravel())), shape=(len(pixels), count)
    )
