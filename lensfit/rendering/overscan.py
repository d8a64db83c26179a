"""How much more than the frame a CG camera must render, to the pixel.

The lens looks beyond the frame of an undistorted plate where its distortion pulls
outside points in. The finished frame reads the filter's support around the undistorted
positions of its pixels, in all three channels. A plate that holds those pixels has no
black border, and no pixel beyond them changes the frame. Depth of field reads further,
by the radius of the blur, since light from beside the frame spreads into it.

Overscan is stated in four ways that must agree: pixels on each side (the data window),
`lens/overscan` in percent of the size in total on both axes alike, the wider film back
of the CG camera at the same focal length, and the factor of OpenLensIO, which is
relative (1 + percent/100 of the frame's own border).

References
----------
OpenLensIO 1.0, eq. 21-24 (`overscan_factor`).
"""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lensfit.batches import in_batches
from lensfit.coords import Window
from lensfit.rendering.filters import Filter, first_tap
from lensfit.rendering.uv import Channel, PlateGeometry
from lensfit.rendering.warp import UNFILTERED_STRETCH

if TYPE_CHECKING:
    from lensfit.lens import Lens

_MAP_ERROR_PX = 5e-4
"""Positions of the renderer's maps differ from exact ones by less, at its default."""
_STILL_PX = 1e-9
_PERCENT_STEPS = 1e4
_SAMPLES_PER_SIDE = 256


class Margins(NamedTuple):
    """Pixels that are read on each side of the frame; `missing` if the lens has no
    undistorted point for part of it, which no plate can fill."""

    left: int
    top: int
    right: int
    bottom: int
    missing: bool = False

    def joined(self, other: "Margins") -> "Margins":
        """What serves both."""
        sides = (max(a, b) for a, b in zip(self[:4], other[:4], strict=True))
        return Margins(*sides, missing=self.missing or other.missing)


def margins_read(
    lens: "Lens",
    display_window: Window,
    *,
    channels: tuple[Channel, ...] | None = None,
    sensor_width_mm: float | None = None,
    method: Filter = "cubic",
    blur_px: float = 0.0,
) -> Margins:
    """Pixels beyond the frame that the finished frame reads.

    Parameters
    ----------
    lens : Lens at its camera state.
    display_window : The frame, which spans the sensor width.
    channels : Those that count; all that differ if None.
    sensor_width_mm : Width that the frame spans; the lens' own if None.
    method : Filter of the warp.
    blur_px : Radius of the widest blur at the border, px of the distorted picture.
    """
    geometry = PlateGeometry.of(lens, display_window, sensor_width_mm)
    # Reading between pixels takes half of one more.
    spread = math.ceil(blur_px + 0.5) if blur_px > 0 else 0
    output = display_window.grown(spread, spread)
    if channels is None:
        channels = ("r", "g", "b") if lens.has_lateral_colour else ("g",)
    found = Margins(0, 0, 0, 0)
    for channel in channels:
        mapping = geometry.undistorted(lens, channel)
        own = _border(output, 0.5)
        read = in_batches(mapping, own)
        edge = in_batches(mapping, _border(output, 0.0))
        stretch = 2 * np.linalg.norm(edge - read, axis=1)
        if np.nanmax(stretch, initial=0) > UNFILTERED_STRETCH:
            # Pixels there are means of readings all over their squares.
            own, read = _border(output, 0.0), edge
            corners = np.array(np.meshgrid(*_edges(output, 0.0))).reshape(2, -1).T
            own = np.concatenate([own, corners])
            read = np.concatenate([read, in_batches(mapping, corners)])
        found = found.joined(_margins(display_window, own, read, method))
    return found


def _border(window: Window, inset: float) -> np.ndarray:
    """Points beside the border pixels: their centres (inset by half a pixel), or where
    the border passes them."""
    x = np.arange(window.x_min, window.x_max + 1) + 0.5
    y = np.arange(window.y_min, window.y_max + 1) + 0.5
    at_x, at_y = _edges(window, inset)
    rows = [np.stack([x, np.full_like(x, at)], -1) for at in at_y]
    columns = [np.stack([np.full_like(y, at), y], -1) for at in at_x]
    return np.concatenate([*rows, *columns])


def _edges(window: Window, inset: float) -> tuple[list[float], list[float]]:
    """Where the border lies, along x and along y."""
    x = [window.x_min + inset, window.x_max + 1 - inset]
    return x, [window.y_min + inset, window.y_max + 1 - inset]


def _margins(
    frame: Window, own: np.ndarray, read: np.ndarray, method: Filter
) -> Margins:
    """Margins that hold every sample with a weight at the positions `read`."""
    finite = np.isfinite(read).all(-1)
    if not finite.any():
        return Margins(0, 0, 0, 0, True)
    own, read = own[finite], read[finite]
    # A position at a pixel's own centre is read without its neighbours.
    still = np.abs(read - own) < _STILL_PX
    read, doubt = np.where(still, own, read), np.where(still, 0.0, _MAP_ERROR_PX)
    reach = -first_tap(method)
    sample = read - 0.5
    low = np.floor(sample - doubt) - np.where(still, 0, reach)
    high = np.ceil(sample + doubt) + np.where(still, 0, reach)
    return Margins(
        max(0, frame.x_min - int(low[:, 0].min())),
        max(0, frame.y_min - int(low[:, 1].min())),
        max(0, int(high[:, 0].max()) - frame.x_max),
        max(0, int(high[:, 1].max()) - frame.y_max),
        not finite.all(),
    )


@dataclass(frozen=True)
class CgCamera:
    """The camera of the CG: the same lens before a wider film back.

    One percentage serves both axes and both of their sides, so that the window may hold
    a pixel or more than is read on some of them.

    Attributes
    ----------
    percent : `lens/overscan`: pixels beyond the frame, in total, percent of its size,
        on both axes alike.
    render_px : Width and height to render.
    data_window : Where those pixels lie, the frame beginning at its own corner.
    sensor_mm : Horizontal and vertical film back (aperture) at unchanged focal length.
    """

    percent: float
    render_px: tuple[int, int]
    data_window: Window
    sensor_mm: tuple[float, float]


def cg_camera(
    margins: Margins, display_window: Window, sensor_width_mm: float
) -> CgCamera:
    """The smallest camera with the frame in its middle that holds the margins."""
    width, height = display_window.width, display_window.height
    across = max(margins.left, margins.right)
    along = max(margins.top, margins.bottom)
    share = 200 * max(across / width, along / height)
    percent = math.ceil(round(share * _PERCENT_STEPS, 6)) / _PERCENT_STEPS
    window = window_of_percent(display_window, percent)
    pitch_mm = sensor_width_mm / width
    return CgCamera(
        percent,
        (window.width, window.height),
        window,
        (window.width * pitch_mm, window.height * pitch_mm),
    )


def window_of_percent(display_window: Window, percent: float) -> Window:
    """The data window of a stated overscan, in total: 10 is 5 % on each side."""
    size = display_window.width, display_window.height
    return display_window.grown(*(round(n * percent / 200) for n in size))


def overscan_factor(
    lens: "Lens", display_window: Window, *, sensor_width_mm: float | None = None
) -> float:
    """The smallest symmetrical enlargement of the frame (>= 1, as in OpenLensIO) that
    holds the undistorted positions of all of it, where there are any.

    The map is continuous and one-to-one, so the frame's border holds the extremes;
    all three channels count.
    """
    geometry = PlateGeometry.of(lens, display_window, sensor_width_mm)
    t = np.linspace(0.0, 1.0, _SAMPLES_PER_SIDE)
    low, size = np.array(display_window[:2], float), np.array(geometry.size_px)
    sides = [np.stack([t, t * 0 + e], -1) for e in (0.0, 1.0)]
    border = low + size * np.concatenate([*sides, *(side[:, ::-1] for side in sides)])
    channels = ("r", "g", "b") if lens.has_lateral_colour else ("g",)
    mapped = np.concatenate(
        [in_batches(geometry.undistorted(lens, c), border) for c in channels]
    )
    finite = np.isfinite(mapped).all(-1)
    mapped = mapped[finite] if finite.any() else border
    over_low = np.maximum(low - mapped.min(0), 0.0)
    over_high = np.maximum(mapped.max(0) - (low + size), 0.0)
    return 1 + 2 * float(np.maximum(over_low / size, over_high / size).max())
