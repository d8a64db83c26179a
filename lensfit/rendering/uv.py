"""Chief-ray maps of a lens over a window: the source position of each output pixel.

Maps are named by what applying them does: `stmap_redistort` turns an undistorted CG
plate into the distorted picture, so its values are *undistorted* positions;
`stmap_undistort` straightens a photograph, so its values are *distorted* ones.
The display window spans the sensor width and is centred on it, with pixels that are
square there unless their shape is stated (a plate of another aspect shows a centred
band of the sensor, or beyond); the window of the map may be larger (overscan).
Positions are NaN where the lens has no inverse.

Inside lensfit a map is a displacement in pixels, float32: a displacement has a
resolution of a millionth of a pixel where an absolute position of UHD has a
ten-thousandth, and the identity is exactly zero. `SourceMap.uv` converts it to the form
of files.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from jaxtyping import Float, Float32

from lensfit.coords import Window, mm_from_px, px_from_mm, px_from_uv, uv_from_px
from lensfit.rendering.buffers import aligned_empty
from lensfit.rendering.smooth import PointFunction, smooth_over_window

if TYPE_CHECKING:
    from lensfit.lens import Lens

Channel = Literal["r", "g", "b"]
DEFAULT_TOLERANCE_PX = 2.5e-4
_ROUNDING_PX = 1e-9


@dataclass(frozen=True, eq=False)
class SourceMap:
    """Where each pixel of `window` reads its source.

    Attributes
    ----------
    window : Output pixels, in the pixel space that the source shares.
    displacement_px : Source position minus own pixel centre: x plane, y plane.
        NaN where there is nothing to read.
    """

    window: Window
    displacement_px: Float32[np.ndarray, "2 height width"]

    def positions_px(self) -> Float[np.ndarray, "height width 2"]:
        """Source positions (x, y), pixels, float64."""
        return self.window.pixel_centres() + np.moveaxis(self.displacement_px, 0, -1)

    def uv(self, display_window: Window) -> Float32[np.ndarray, "height width 2"]:
        """Absolute UV of the source positions, normalised by `display_window`."""
        return uv_from_px(self.positions_px(), display_window).astype(np.float32)

    @classmethod
    def from_uv(
        cls,
        uv: Float[np.ndarray, "height width 2"],
        data_window: Window,
        display_window: Window,
    ) -> "SourceMap":
        """The map that a UV file holds.

        A float32 UV knows its pixel only to about 1e-4 px: displacements within that
        of a whole pixel are taken as whole, so that an identity file copies bits.
        """
        positions = px_from_uv(uv, display_window)
        displacement = positions - data_window.pixel_centres()
        size = np.array([display_window.width, display_window.height])
        doubt = np.maximum(np.abs(uv), 1.0) * size * 2.0**-23
        whole = np.round(displacement)
        snapped = np.where(np.abs(displacement - whole) <= doubt, whole, displacement)
        planes = aligned_empty((2, data_window.height, data_window.width))
        planes[:] = np.moveaxis(snapped, -1, 0)
        return cls(data_window, planes)

    @classmethod
    def identity(cls, window: Window) -> "SourceMap":
        """The map that reads every pixel at its own place."""
        planes = aligned_empty((2, window.height, window.width))
        planes[:] = 0
        return cls(window, planes)

    def after(self, other: "SourceMap") -> "SourceMap":
        """Both displacements together, for a small one such as lateral colour, which
        is given at the same output pixel."""
        planes = aligned_empty(self.displacement_px.shape)
        np.add(self.displacement_px, other.displacement_px, out=planes)
        return SourceMap(self.window, planes)

    def cropped(self, window: Window) -> "SourceMap":
        """The map over a part of its window.

        Raises
        ------
        ValueError : The map does not cover `window`.
        """
        own = self.window
        low = window.y_min - own.y_min, window.x_min - own.x_min
        if min(low) < 0 or window.x_max > own.x_max or window.y_max > own.y_max:
            raise ValueError(f"a map over {own} does not cover {window}")
        y, x = (
            slice(low[0], low[0] + window.height),
            slice(low[1], low[1] + window.width),
        )
        planes = aligned_empty((2, window.height, window.width))
        planes[:] = self.displacement_px[:, y, x]
        return SourceMap(window, planes)


def stmap_redistort(
    lens: "Lens",
    display_window: Window,
    data_window: Window | None = None,
    channel: Channel = "g",
    *,
    tolerance_px: float = DEFAULT_TOLERANCE_PX,
    sensor_width_mm: float | None = None,
) -> SourceMap:
    """Map that puts the lens' distortion on an undistorted plate.

    Parameters
    ----------
    lens : Lens at its camera state.
    display_window : Pixels that span the sensor width.
    data_window : Pixels of the map; the display window if None.
    channel : Colour channel; they differ where the lens has lateral colour.
    tolerance_px : Largest error of the interpolation between exact evaluations, px.
    sensor_width_mm : Width that the display window spans; the lens' own if None.
    """
    geometry = PlateGeometry.of(lens, display_window, sensor_width_mm)
    mapping = geometry.undistorted(lens, channel)
    return source_map(mapping, data_window or display_window, tolerance_px)


def stmap_undistort(
    lens: "Lens",
    display_window: Window,
    data_window: Window | None = None,
    channel: Channel = "g",
    *,
    tolerance_px: float = DEFAULT_TOLERANCE_PX,
    sensor_width_mm: float | None = None,
) -> SourceMap:
    """Map that takes the lens' distortion off; parameters as `stmap_redistort`."""
    geometry = PlateGeometry.of(lens, display_window, sensor_width_mm)
    mapping = geometry.distorted(lens, channel)
    return source_map(mapping, data_window or display_window, tolerance_px)


def window_grid(window: Window, count: int) -> Float[np.ndarray, "points 2"]:
    """`count` by `count` positions (x, y) px over a window, its border included."""
    x = np.linspace(window.x_min, window.x_max + 1, count)
    y = np.linspace(window.y_min, window.y_max + 1, count)
    return np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)


class SpannedWidth(float):
    """Sensor width that a display window spans, mm, where its pixels are not square.

    It stands wherever a `sensor_width_mm` does; a plain number means square pixels.

    Attributes
    ----------
    pixel_shape : Width of a pixel over its height, on the sensor.
    """

    pixel_shape: float

    def __new__(cls, width_mm: float, pixel_shape: float = 1.0) -> "SpannedWidth":
        width = super().__new__(cls, width_mm)
        width.pixel_shape = pixel_shape
        return width


def spanned_mm(display_window: Window, width_mm: float) -> tuple[float, float]:
    """Width and height on the sensor of a display window so wide; its pixels are square
    unless the width is a `SpannedWidth`."""
    aspect = display_window.height / display_window.width
    if isinstance(width_mm, SpannedWidth):
        aspect /= width_mm.pixel_shape
    return float(width_mm), float(width_mm) * aspect


@dataclass(frozen=True)
class PlateGeometry:
    """How a plate's pixels lie on the sensor: display window and its size in mm."""

    display_window: Window
    area_mm: tuple[float, float]

    @classmethod
    def of(
        cls, lens: "Lens", display_window: Window, sensor_width_mm: float | None = None
    ) -> "PlateGeometry":
        """Centred, the display window as wide as the sensor; pixels are square unless
        the width is a `SpannedWidth`."""
        width_mm = sensor_width_mm or float(lens.sensor_size_mm[0])
        return cls(display_window, spanned_mm(display_window, width_mm))

    @property
    def pitch_mm(self) -> tuple[float, float]:
        """Width and height of a pixel on the sensor."""
        return self.area_mm[0] / self.size_px[0], self.area_mm[1] / self.size_px[1]

    @property
    def pixel_shape(self) -> float:
        """Width of a pixel over its height, on the sensor."""
        return self.pitch_mm[0] / self.pitch_mm[1]

    @property
    def size_px(self) -> tuple[int, int]:
        return self.display_window.width, self.display_window.height

    def mm(self, points_px: np.ndarray) -> np.ndarray:
        """Sensor millimetres of positions in the shared pixel space."""
        origin = np.array(self.display_window[:2], float)
        return mm_from_px(points_px - origin, self.size_px, self.area_mm)

    def px(self, points_mm: np.ndarray) -> np.ndarray:
        """Inverse of `mm`."""
        origin = np.array(self.display_window[:2], float)
        return px_from_mm(points_mm, self.size_px, self.area_mm) + origin

    def undistorted(self, lens: "Lens", channel: Channel) -> PointFunction:
        """Undistorted px of distorted px."""
        return lambda points: self.px(
            np.asarray(lens.undistorted_from_distorted(self.mm(points), channel))
        )

    def distorted(self, lens: "Lens", channel: Channel) -> PointFunction:
        """Distorted px of undistorted px."""
        return lambda points: self.px(
            np.asarray(lens.distorted_from_undistorted(self.mm(points), channel))
        )


def source_map(
    mapping: PointFunction, window: Window, tolerance_px: float
) -> SourceMap:
    """The map of `mapping` (px to px) over `window`."""

    def displacement(points: np.ndarray) -> np.ndarray:
        moved = mapping(points) - points
        return np.where(np.abs(moved) < _ROUNDING_PX, 0.0, moved)

    exact = smooth_over_window(displacement, window, tolerance_px)
    planes = aligned_empty(exact.shape)
    planes[:] = exact
    return SourceMap(window, planes)
