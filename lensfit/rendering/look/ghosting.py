"""Ghosts: highlights reflected between glass, on the other side of the centre.

The n-th of N ghosts of a light at p lies at c - reach (n / N) (p - c), with c the
optical centre (the principal point), and is drawn with the shape of the pupil at that
field point, n / N of the size of the last. Each holds the same light. All together hold
`share` of the light above the threshold, *added* to the picture: a lens loses light by
reflections everywhere alike, and exposure compensates that. What falls beside the plate
is lost. The tint keeps the luminance: 1 is green, -1 magenta, as coatings are.

Ghosts are those of the plate before the lens blurs it: a light throws the same ghost
whether it is in focus or not. Light from beyond the plate is unknown, and makes none.

The shape of the pupil, as lights far out of focus show it, is taken from the lens' own
kernels for an object far from the focus distance, where the pupil determines nearly all
of the shape: blades, and the rims that cut it to a cat's eye towards the corners. It is
made at three by three points over the frame and interpolated between them. A lens
without measured blur has a disc.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
from jaxtyping import Float, Float32

from lensfit.coords import Window
from lensfit.rendering.circle import Circle
from lensfit.rendering.look.light import (
    Picture,
    brightest_channel,
    doubled_picture,
    halved_picture,
    padded_picture,
)
from lensfit.rendering.uv import PlateGeometry, window_grid

if TYPE_CHECKING:
    from lensfit.lens import Lens

LEVEL = 1
"""Lights are kept at half size."""
_LEAST_LEVELS = 16
_DIAMETER_PX = 96.0
_SIZE_PX = 160
_NODES = 3
_NEAR = 3.0
"""Nearest object that is asked for, in distances of the nearest of all."""
_RAY_ERROR = 0.02
_ROWS = 16
"""Of chords of a disc, per pixel; along a chord the integral is exact."""


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


def disc_kernel(radius_px: float, half: int) -> Float32[np.ndarray, "size size"]:
    """Share of a disc's light in each pixel; sums to 1.

    Parameters
    ----------
    radius_px : Its sign does not matter.
    half : Pixels of the kernel on either side of the middle one.
    """
    radius = abs(radius_px)
    size = 2 * half + 1
    rows = (np.arange(size * _ROWS) + 0.5) / _ROWS - size / 2
    chord = np.sqrt(np.maximum(radius * radius - rows * rows, 0))[:, None]
    edges = np.arange(size + 1) - size / 2
    inside = np.clip(edges[None], -chord, chord)
    shares = np.diff(inside, axis=1).reshape(size, _ROWS, size).sum(1)
    if shares.sum() <= 0 or radius < 1 / _ROWS:
        shares = np.zeros((size, size))
        shares[half, half] = 1
    return (shares / shares.sum()).astype(np.float32)


@dataclass(frozen=True)
class Ghosts:
    """The ghosts of a point.

    Attributes
    ----------
    count : How many.
    reach : Distance of the last from the centre over that of its light; positive on
        the other side.
    diameter_px : Of the last, in pixels of the whole picture.
    tint : 1 is green, -1 magenta.
    """

    count: int
    reach: float
    diameter_px: float
    tint: float


def ghosts_of(
    small: Picture,
    level: int,
    shape: tuple[int, int],
    centre_px: Float[np.ndarray, "2"],
    ghosts: Ghosts,
    opening: ApertureShape,
    least_px: float,
    luminance: tuple[float, float, float],
) -> Picture:
    """All ghosts of some lights, holding as much light together as those.

    Parameters
    ----------
    small : The lights, halved `level` times.
    shape : Rows and columns of the whole picture.
    centre_px : Optical centre, x and y from the picture's corner.
    opening : Its shape, for lights over the picture.
    least_px : Pixels that a ghost measures at least at the size where it is drawn.
    luminance : Of red, green and blue, for the tint.
    """
    if small.max() <= 0:
        return np.zeros((*shape, small.shape[2]), np.float32)
    drawn: dict[int, Picture] = {}
    for n in range(1, ghosts.count + 1):
        part = n / ghosts.count
        diameter_px = part * ghosts.diameter_px
        own = max(level, _level_of(diameter_px, least_px, shape))
        lights = halved_picture(padded_picture(small, own - level), own - level)
        place = -ghosts.reach * part
        centre = centre_px / 2**own
        made = _drawn_ghosts(
            lights, place, centre, diameter_px / 2**own, opening, 2**own
        )
        drawn[own] = drawn[own] + made if own in drawn else made
    total = _together(drawn)
    if total.shape[2] == 3:
        total *= tint_of(ghosts.tint, luminance)
    total /= np.float32(ghosts.count)
    return total[: shape[0], : shape[1]]


def tint_of(
    tint: float, luminance: tuple[float, float, float]
) -> Float32[np.ndarray, "3"]:
    """Gains of red, green and blue that keep the luminance of a grey."""
    green = luminance[1]
    if tint >= 0:
        others, own = 1 - tint, 1 + tint * (1 - green) / green
    else:
        others, own = 1 - tint * green / (1 - green), 1 + tint
    return np.array([others, own, others], np.float32)


def _together(drawn: dict[int, Picture]) -> Picture:
    """Pictures of several sizes on one of the whole size, from the smallest up."""
    level = max(drawn)
    total = drawn[level]
    while level > 0:
        total, level = doubled_picture(total), level - 1
        if level in drawn:
            height, width = drawn[level].shape[:2]
            total = drawn[level] + total[:height, :width]
    return total


def _level_of(diameter_px: float, least_px: float, shape: tuple[int, int]) -> int:
    level = 0
    while (
        diameter_px / 2 ** (level + 1) >= least_px
        and min(shape) >> (level + 1) >= _LEAST_LEVELS
    ):
        level += 1
    return level


def _drawn_ghosts(
    lights: Picture,
    place: float,
    centre: Float[np.ndarray, "2"],
    diameter_px: float,
    opening: ApertureShape,
    pixel: int,
) -> Picture:
    """Every light at its place, in the shape of the opening."""
    total = np.zeros_like(lights)
    rows, columns = np.nonzero(brightest_channel(lights) > 0)
    own = np.stack([columns + 0.5, rows + 0.5], -1)
    there = centre + place * (own - centre)
    values = lights[rows, columns]
    for weights, shape in opening.node_shares(own * pixel):
        if not weights.any():
            continue
        points = _splatted_lights(values * weights[:, None], there, lights.shape)
        kernel = shrunk(shape, diameter_px / opening.diameter_px)
        spread = cv2.filter2D(points, -1, kernel, borderType=cv2.BORDER_CONSTANT)
        total += np.maximum(spread.reshape(total.shape), 0)
    return total


def _splatted_lights(
    values: Float32[np.ndarray, "lights channels"],
    points_px: Float[np.ndarray, "lights 2"],
    shape: tuple[int, ...],
) -> Picture:
    """Lights divided among the four pixels around each, keeping sum and place."""
    height, width, channels = shape
    corner = np.floor(points_px - 0.5).astype(int)
    fx, fy = np.moveaxis(points_px - 0.5 - corner, -1, 0)
    result = np.zeros((height * width, channels))
    for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
        x, y = corner[:, 0] + dx, corner[:, 1] + dy
        share = (fx if dx else 1 - fx) * (fy if dy else 1 - fy)
        inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
        index = (y * width + x)[inside]
        for c in range(channels):
            light = (values[:, c] * share)[inside]
            result[:, c] += np.bincount(index, light, height * width)
    return result.reshape(shape).astype(np.float32)
