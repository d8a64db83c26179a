"""Where things are: pixels, sensor millimetres, windows and UV maps.

Pixel (column 0, row 0) covers [0, 1) x [0, 1): its centre is (0.5, 0.5), and row 0 is
on top. Sensor millimetres have their origin at the sensor centre, x right, y down.
Windows are OpenEXR boxes: both corners inclusive, y down. A UV map holds absolute
positions, normalised by the *display window*, origin at its bottom-left corner, so
that the identity is (column + 0.5)/width, 1 - (row + 0.5)/height
(shared by Nuke, Natron and LDPK; OpenCV instead puts integers at pixel centres).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Num


class Window(NamedTuple):
    """An OpenEXR box, both corners inclusive, in pixels, y down."""

    x_min: int
    y_min: int
    x_max: int
    y_max: int

    @property
    def width(self) -> int:
        return self.x_max - self.x_min + 1

    @property
    def height(self) -> int:
        return self.y_max - self.y_min + 1

    @property
    def area(self) -> int:
        """Its pixels."""
        return self.width * self.height

    @classmethod
    def of_size(cls, width: int, height: int) -> "Window":
        """The window of an image without overscan."""
        return cls(0, 0, width - 1, height - 1)

    def grown(self, margin_x: int, margin_y: int) -> "Window":
        """The same window with a margin on each side (negative shrinks)."""
        return Window(
            self.x_min - margin_x,
            self.y_min - margin_y,
            self.x_max + margin_x,
            self.y_max + margin_y,
        )

    def joined(self, other: "Window") -> "Window":
        """The smallest window that holds both."""
        return Window(
            min(self.x_min, other.x_min),
            min(self.y_min, other.y_min),
            max(self.x_max, other.x_max),
            max(self.y_max, other.y_max),
        )

    def common(self, other: "Window") -> "Window | None":
        """The pixels that both have; None where there is none."""
        found = Window(
            max(self.x_min, other.x_min),
            max(self.y_min, other.y_min),
            min(self.x_max, other.x_max),
            min(self.y_max, other.y_max),
        )
        return found if found.width > 0 and found.height > 0 else None

    def pixel_centres(self) -> Float[np.ndarray, "height width 2"]:
        """(x, y) of every pixel centre, in pixels of the shared pixel space."""
        x = np.arange(self.x_min, self.x_max + 1, dtype=float) + 0.5
        y = np.arange(self.y_min, self.y_max + 1, dtype=float) + 0.5
        centres = np.empty((self.height, self.width, 2))
        centres[..., 0], centres[..., 1] = x, y[:, None]
        return centres


def mm_from_px(
    points_px: Float[np.ndarray, "*points 2"],
    image_size_px: tuple[float, float],
    sensor_size_mm: tuple[float, float],
) -> Float[np.ndarray, "*points 2"]:
    """Sensor millimetres of positions in pixels.

    Parameters
    ----------
    points_px : Positions, pixels, centre of the first pixel at (0.5, 0.5).
    image_size_px : Width and height of the image that spans the sensor, pixels.
    sensor_size_mm : Width and height of that sensor area, mm.
    """
    size = np.asarray(image_size_px, float)
    return (np.asarray(points_px, float) - size / 2) * (
        np.asarray(sensor_size_mm) / size
    )


def px_from_mm(
    points_mm: Float[np.ndarray, "*points 2"],
    image_size_px: tuple[float, float],
    sensor_size_mm: tuple[float, float],
) -> Float[np.ndarray, "*points 2"]:
    """Inverse of `mm_from_px`."""
    size = np.asarray(image_size_px, float)
    return np.asarray(points_mm, float) * (size / np.asarray(sensor_size_mm)) + size / 2


def uv_from_px(
    points_px: Float[np.ndarray, "*points 2"], display_window: Window
) -> Float[np.ndarray, "*points 2"]:
    """Absolute UV, origin bottom-left, of positions in the shared pixel space."""
    points_px = np.asarray(points_px, float)
    uv = np.empty_like(points_px)
    uv[..., 0] = (points_px[..., 0] - display_window.x_min) / display_window.width
    uv[..., 1] = (points_px[..., 1] - display_window.y_min) / display_window.height
    uv[..., 1] = 1.0 - uv[..., 1]
    return uv


def px_from_uv(
    uv: Float[np.ndarray, "*points 2"], display_window: Window
) -> Float[np.ndarray, "*points 2"]:
    """Inverse of `uv_from_px`."""
    uv = np.asarray(uv, float)
    x = uv[..., 0] * display_window.width + display_window.x_min
    y = (1.0 - uv[..., 1]) * display_window.height + display_window.y_min
    return np.stack([x, y], -1)


def pixels_over_window(
    samples: Num[np.ndarray, "height width *channels"],
    own: Window,
    wanted: Window,
    missing: float = 0,
) -> Num[np.ndarray, "new_height new_width *channels"]:
    """The same samples over another window; a view where that is a part of their own.

    Parameters
    ----------
    own : Where `samples` lie.
    wanted : Where they are wanted.
    missing : Value of what lies outside `own`.
    """
    top, left = wanted.y_min - own.y_min, wanted.x_min - own.x_min
    if min(top, left) >= 0 and wanted.x_max <= own.x_max and wanted.y_max <= own.y_max:
        return samples[top : top + wanted.height, left : left + wanted.width]
    size = (wanted.height, wanted.width, *samples.shape[2:])
    result = np.full(size, missing, samples.dtype)
    x0, x1 = max(own.x_min, wanted.x_min), min(own.x_max, wanted.x_max) + 1
    y0, y1 = max(own.y_min, wanted.y_min), min(own.y_max, wanted.y_max) + 1
    if x0 < x1 and y0 < y1:
        result[
            y0 - wanted.y_min : y1 - wanted.y_min, x0 - wanted.x_min : x1 - wanted.x_min
        ] = samples[y0 - own.y_min : y1 - own.y_min, x0 - own.x_min : x1 - own.x_min]
    return result
