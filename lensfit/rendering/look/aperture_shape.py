"""The shape of a lens' pupil, as lights far out of focus show it.

It is taken from the lens' own kernels for an object far from the focus distance, where
the pupil determines nearly all of the shape: blades, and the rims that cut it to a
cat's eye towards the corners. It is made at three by three points over the frame and
interpolated between them. A lens without measured blur has a disc.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Float32

from lensfit.coords import Window
from lensfit.rendering.circle import Circle
from lensfit.rendering.disc import disc_kernel
from lensfit.rendering.uv import PlateGeometry, window_grid

if TYPE_CHECKING:
    from lensfit.lens import Lens

_DIAMETER_PX = 96.0
_SIZE_PX = 160
_NODES = 3
_NEAR = 3.0
"""Nearest object that is asked for, in distances of the nearest of all."""
_RAY_ERROR = 0.02


@dataclass(frozen=True, eq=False)
class ApertureShape:
    """Shapes that sum to 1, at the nodes of a grid over a picture.

    Attributes
    ----------
    shapes : Row by row; one for the whole picture, or three by three.
    size_px : Width and height of the picture.
    diameter_px : Of the opening on the axis, in pixels of the shapes: that of the disc
        with the same mean square.
    """

    shapes: Float32[np.ndarray, "nodes size size"]
    size_px: tuple[int, int]
    diameter_px: float

    @classmethod
    def of(
        cls, lens: "Lens", geometry: PlateGeometry, window: Window
    ) -> "ApertureShape":
        """The opening of a lens for lights over a window."""
        size = window.width, window.height
        pitch_mm, distance_mm = _far_from_focus(lens, geometry)
        if pitch_mm == 0:
            disc = disc_kernel(_DIAMETER_PX / 2, _SIZE_PX // 2)
            return cls(disc[None], size, diameter_of(disc))
        axis_mm = np.asarray(lens.distortion.principal_point_mm)[None]
        points_mm = geometry.mm(window_grid(window, _NODES))
        points_mm = np.concatenate([axis_mm, points_mm])
        on_axis, *shapes = _shapes(lens, points_mm, distance_mm, pitch_mm)
        for shape in shapes:
            if not (np.isfinite(shape).all() and shape.sum() > 0):
                shape[:] = on_axis
        made = np.stack(shapes)
        made /= made.sum((1, 2), keepdims=True)
        return cls(made, size, diameter_of(on_axis))

    def node_shares(
        self, points_px: Float[np.ndarray, "lights 2"]
    ) -> Iterator[tuple[Float32[np.ndarray, " lights"], np.ndarray]]:
        """For each node, the share that lights have of its shape, and the shape.

        Parameters
        ----------
        points_px : From the picture's corner.
        """
        if len(self.shapes) == 1:
            yield np.ones(len(points_px), np.float32), self.shapes[0]
            return
        last = _NODES - 1
        x, y = np.clip(points_px / np.array(self.size_px) * last, 0, last).T
        for node, shape in enumerate(self.shapes):
            row, column = divmod(node, _NODES)
            wx = np.maximum(1 - np.abs(x - column), 0)
            wy = np.maximum(1 - np.abs(y - row), 0)
            yield (wx * wy).astype(np.float32), shape


def shrunk(
    shape: Float32[np.ndarray, "size size"], factor: float
) -> Float32[np.ndarray, "small small"]:
    """A shape at another size, each pixel the light that falls on it; sums to 1.

    Odd in size, the middle in the middle.
    """
    size = shape.shape[0]
    half = int(np.ceil(factor * size / 2))
    edges = (np.arange(-half, half + 2) - 0.5) / factor + size / 2
    known = np.arange(size + 1)
    for axis in (0, 1):
        upto = np.cumsum(np.insert(shape, 0, 0, axis), axis)
        columns = np.moveaxis(upto, axis, -1)
        rows = [np.diff(np.interp(edges, known, column)) for column in columns]
        shape = np.moveaxis(np.stack(rows), -1, axis)
    return (shape / shape.sum()).astype(np.float32)


def diameter_of(shape: Float32[np.ndarray, "size size"]) -> float:
    """Diameter of the disc with the same mean square about its middle."""
    t = np.arange(shape.shape[0]) + 0.5
    x, y = shape.sum(0), shape.sum(1)
    total = shape.sum()
    square = sum(
        (p * t * t).sum() / total - ((p * t).sum() / total) ** 2 for p in (x, y)
    )
    return float(2 * np.sqrt(2 * square))


def _far_from_focus(lens: "Lens", geometry: PlateGeometry) -> tuple[float, float]:
    """The pitch that makes the disc of an object about as large as wanted, and its
    distance from the sensor; no pitch where no blur is known."""
    blur = getattr(lens, "blur", None)
    if blur is None:
        return 0.0, np.inf
    circle = Circle.of(lens, geometry)
    offset_mm = float(lens.entrance_pupil_offset_mm)
    near_mm = _NEAR * float(blur.nearest_mm)
    distances_mm = np.array([near_mm, np.inf])
    radii_px = circle.radius_px((distances_mm - offset_mm).astype(np.float32))
    farther = int(np.abs(radii_px).argmax())
    plate_pitch_mm = geometry.area_mm[0] / geometry.size_px[0]
    diameter_mm = 2 * abs(float(radii_px[farther])) * plate_pitch_mm
    return diameter_mm / _DIAMETER_PX, float(distances_mm[farther])


def _shapes(
    lens: "Lens", points_mm: np.ndarray, distance_mm: float, pitch_mm: float
) -> Float32[np.ndarray, "points size size"]:
    found = lens.psfs(
        points_mm,
        distance_mm,
        ("g",),
        pixel_pitch_mm=pitch_mm,
        size_px=_SIZE_PX,
        tolerance=_RAY_ERROR,
    )
    return np.array(found[:, 0], np.float32)
