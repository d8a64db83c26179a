"""Rays of a lens over a plate: the place that each pupil point sees, and its weight.

A ray is identified by the pixel that it reaches on the sensor and by the place where it
passed the pupil. Followed back into the scene it is a straight line, and the place of
the plate that it crosses at some distance moves in proportion to vergence: on the
plate, to the signed radius r of the circle of confusion (`lensfit.rendering.circle`).
So

    place = pixel + c0 + c1 r + c2 r^2

with c0 the displacement by the lens' aberrations in focus, c1 the place in the pupil,
and c2 the small change of the aberrations with distance. The same ray serves all
distances, and occlusion is decided along it.

The c vary slowly over the frame. They are computed at the nodes of a grid and
interpolated linearly. Places and pixels are distorted positions relative to the chief
ray of each colour, since the maps of `lensfit.rendering.render_stages` hold those. A
fully vignetted pixel takes the rays of the nearest node that receives light.

References: W. R. Hamilton's characteristic functions as in H. A. Buchdahl, An
Introduction to Hamiltonian Optics (1970): area in the pupil and area on the sensor
change together (etendue), so a scene of one radiance stays one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float, Float32

from lensfit.coords import Window
from lensfit.rendering.circle import Circle
from lensfit.rendering.uv import PlateGeometry

if TYPE_CHECKING:
    from lensfit.lens import Lens

COLUMNS, ROWS = 25, 15
"""Nodes over the window: a ray beside a rim that clips is half a pixel off at most."""
_TURN_RAD = 2 * np.pi / 3**0.5
"""From ray to ray of the spiral: its multiples, and those of three times it, spread
evenly, so that each wavelength of a channel fills the pupil by itself."""
_LEAST_SPAN_PX = 2.0
_NEWTON_STEPS = 4


class DepthNodes(NamedTuple):
    """Three radii of blur between which rays are a parabola, far to near, px."""

    far: float
    middle: float
    near: float

    @classmethod
    def over(cls, far_px: float, near_px: float) -> "DepthNodes":
        """Of a range of depth, in focus included: there the aberrations are alone."""
        far, near = min(far_px, 0.0), max(near_px, 0.0)
        near = max(near, far + _LEAST_SPAN_PX)
        return cls(far, (far + near) / 2, near)


@dataclass(frozen=True, eq=False)
class RayField:
    """Rays over a window.

    Attributes
    ----------
    window : Pixels over which the nodes lie, the outermost ones on its border.
    moved_px : c0, c1, c2 along x and y; one channel where all colours have the same.
    weight : Share of each ray; sums to 1 over the rays.
    diffraction_px : Standard deviation of the Gaussian nearest to the Airy pattern.
    """

    window: Window
    moved_px: Float32[np.ndarray, "channels rows columns rays 2 3"]
    weight: Float32[np.ndarray, "channels rows columns rays"]
    diffraction_px: float

    @property
    def rays(self) -> int:
        return self.weight.shape[-1]

    def displacements_px(
        self, radius_px: float
    ) -> Float32[np.ndarray, "channels rows columns rays 2"]:
        """From pixel to place, at every node."""
        powers = np.array([1.0, radius_px, radius_px**2], np.float32)
        return self.moved_px @ powers

    def spot_radius_px(self, radius_px: float) -> Float32[np.ndarray, "rows columns"]:
        """Radius of the disc that spreads light as far (rms), at every node; the widest
        of the colours."""
        moved = self.displacements_px(radius_px)
        weight = self.weight[..., None]
        away = moved - (weight * moved).sum(-2, keepdims=True)
        square = (weight * away**2).sum((-2, -1)).max(0)
        return np.sqrt(2 * square + 4 * self.diffraction_px**2)

    @np.errstate(over="ignore", invalid="ignore")
    def reach_px(self, radius_px: float) -> float:
        """How far any ray is led, diffraction included; not finite if nowhere."""
        most = np.abs(self.displacements_px(radius_px)).max()
        return float(most + 3 * self.diffraction_px)


def disc_spiral(rays: int) -> Float[np.ndarray, "2 rays"]:
    """Azimuth and reach of places that fill a disc evenly, equal in area.

    Moved a little so that their mean and their second moments are those of the disc:
    few rays then shift nothing, and blur as widely as many.
    """
    number = np.arange(rays)
    angle, reach = number * _TURN_RAD, np.sqrt((number + 0.5) / rays)
    places = reach * np.stack([np.cos(angle), np.sin(angle)])
    places -= places.mean(1, keepdims=True)
    root = np.linalg.cholesky(places @ places.T / rays)
    x, y = np.linalg.solve(root, places) / 2
    return np.stack([np.arctan2(y, x) % (2 * np.pi), np.minimum(np.hypot(x, y), 1)])


def disc_field(window: Window, rays: int) -> RayField:
    """Rays of an ideal lens: the place in the pupil is a place in the disc of blur."""
    azimuth, reach = disc_spiral(rays)
    moved = np.zeros((1, 2, 2, rays, 2, 3), np.float32)
    moved[..., 0, 1] = reach * np.cos(azimuth)
    moved[..., 1, 1] = reach * np.sin(azimuth)
    weight = np.full((1, 2, 2, rays), 1 / rays, np.float32)
    return RayField(window, moved, weight, 0.0)


def lens_field(
    lens: "Lens",
    geometry: PlateGeometry,
    circle: Circle,
    window: Window,
    depth: DepthNodes,
    counts: Sequence[int],
    nodes: tuple[int, int] = (COLUMNS, ROWS),
) -> list[RayField]:
    """Rays of any lens, in sets of these sizes.

    Parameters
    ----------
    circle : Distances of radii of blur.
    window : Pixels that rays reach.
    depth : Range of what they cross.
    counts : Multiples of three.
    nodes : Columns and rows of the grid over the window.
    """
    is_even = lens.blur is None or lens.blur.is_ideal
    sets = [np.concatenate([disc_spiral(n), np.full((1, n), 1 / n)]) for n in counts]
    every = np.concatenate(sets, 1)
    size = (1, 1) if is_even else nodes
    found = landed_rays(lens, geometry, circle, window, depth, every, *size)
    ends = np.cumsum([0, *counts])
    return [
        _field(found, slice(first, last), window, depth)
        for first, last in pairwise(ends.tolist())
    ]


def _field(
    found: "LandedRays", some: slice, window: Window, depth: DepthNodes
) -> RayField:
    """Some of the rays, seen from the pixels that they reach."""
    landing, weight = found.landing_px[..., some, :], found.share[..., some].mean(1)
    if landing.shape[2] == 1:
        # An ideal lens blurs alike all over the frame.
        moved = np.repeat(np.repeat(-landing, 2, 2), 2, 3)
        weight = np.repeat(np.repeat(weight, 2, 1), 2, 2)
    else:
        step_px = np.array(window_steps_px(window, *landing.shape[2:4]))
        moved = _seen_from_pixels(landing, step_px)
        weight = weight * _area_followed(moved.mean(1), step_px)
    weight /= weight.sum(-1, keepdims=True)
    return RayField(
        window,
        np.ascontiguousarray(_parabola(moved, depth), np.float32),
        np.ascontiguousarray(weight, np.float32),
        found.diffraction_px,
    )


class LandedRays(NamedTuple):
    """Rays of points at the nodes of a grid, at three depths.

    Attributes
    ----------
    landing_px : From where the chief ray of its channel lands.
    share : Of the light of its point.
    diffraction_px : As in `RayField`.
    """

    landing_px: Float[np.ndarray, "channels depths rows columns rays 2"]
    share: Float[np.ndarray, "channels depths rows columns rays"]
    diffraction_px: float


def landed_rays(
    lens: "Lens",
    geometry: PlateGeometry,
    circle: Circle,
    window: Window,
    depth: DepthNodes,
    places: Float[np.ndarray, "3 rays"],
    columns: int = COLUMNS,
    rows: int = ROWS,
) -> LandedRays:
    """Rays of points whose chief rays land at the nodes.

    Parameters
    ----------
    places : Azimuth, reach and share of the pupil.
    """
    from lensfit.psf.polar_rays import PupilPlaces, rays_of_points

    nodes_px = grid_px(window, columns, rows).reshape(-1, 2)
    distances = np.array([circle.depth_mm(r) for r in depth])
    distances = distances + float(lens.entrance_pupil_offset_mm)
    channels, nodes = 3, len(nodes_px)
    points_mm = np.tile(geometry.mm(nodes_px), (channels * len(depth), 1))
    each_mm = np.tile(np.repeat(distances, nodes), channels)
    each_mm = lens.distances_within_largest_blur(each_mm)
    index = np.repeat(np.arange(channels), len(depth) * nodes)
    optics = lens.optics_without_lateral_colour()
    found = rays_of_points((points_mm, each_mm, index), optics, PupilPlaces(*places))
    pitch_mm = np.array(geometry.area_mm) / geometry.size_px
    shape = (channels, len(depth), rows, columns, places.shape[1])
    landing = found.landing_mm.astype(float).reshape(*shape, 2) / pitch_mm
    light = found.share.astype(float).reshape(shape)
    lit = np.isfinite(landing).all((-2, -1)) & (light.sum(-1) > 0)
    landing, light = _without_gaps(landing, lit), _without_gaps(light, lit)
    diffraction_px = float(np.nanmedian(found.airy_mm)) / pitch_mm[0]
    return LandedRays(landing, light, diffraction_px)


def window_steps_px(window: Window, rows: int, columns: int) -> tuple[float, float]:
    """From node to node down and across. Those of a single row or column of pixels all
    lie on it and hold the same, as if they were apart."""
    down, across = max(window.height - 1, 1), max(window.width - 1, 1)
    return down / (rows - 1), across / (columns - 1)


def grid_px(window: Window, columns: int, rows: int) -> Float[np.ndarray, "r c 2"]:
    """Nodes (x, y) from the first pixel's centre to the last one's; one by itself in
    the middle."""
    x, y = (
        np.linspace(low + 0.5, high + 0.5, count)
        if count > 1
        else np.array([(low + high + 1) / 2])
        for low, high, count in (
            (window.x_min, window.x_max, columns),
            (window.y_min, window.y_max, rows),
        )
    )
    return np.stack(np.meshgrid(x, y), -1)


def _without_gaps(values: np.ndarray, lit: np.ndarray) -> np.ndarray:
    """Nodes without light take the values of the nearest one that has some."""
    if lit.all():
        return values
    if not lit.any():
        return np.zeros_like(values)
    from scipy.ndimage import distance_transform_edt

    result = values.copy()
    for at in np.ndindex(*lit.shape[:2]):
        own = lit[at]
        if own.any() and not own.all():
            near = distance_transform_edt(
                ~own, return_distances=False, return_indices=True
            )
            assert near is not None
            result[at] = values[at][near[0], near[1]]
        elif not own.any():
            result[at] = 0
    return result


def _seen_from_pixels(landing_px: np.ndarray, step_px: np.ndarray) -> np.ndarray:
    """From each pixel at a node back to the place whose ray lands there: the place x
    with x + landing(x) = pixel, so that D = x - pixel = -landing(pixel + D)."""
    moved = -landing_px
    for _ in range(_NEWTON_STEPS):
        moved = -_interpolated_between_nodes(landing_px, moved, step_px)
    return moved


def _interpolated_between_nodes(
    values: np.ndarray, moved_px: np.ndarray, step_px: np.ndarray
) -> np.ndarray:
    """Values of (channels, depths, rows, columns, rays, 2) beside each node, by a cubic
    through the nodes around; beyond the outermost it goes on."""
    rows, columns = values.shape[2:4]
    row = np.arange(rows)[:, None, None] + moved_px[..., 1] / step_px[0]
    column = np.arange(columns)[:, None] + moved_px[..., 0] / step_px[1]
    first = [
        np.clip(np.floor(at).astype(int) - 1, 0, max(n - 4, 0))
        for at, n in ((row, rows), (column, columns))
    ]
    shares = [_lagrange(at - low) for at, low in zip((row, column), first, strict=True)]
    index = np.ogrid[tuple(slice(n) for n in row.shape)]
    result = np.zeros_like(values)
    for i in range(4):
        for j in range(4):
            share = shares[0][i] * shares[1][j]
            taken = values[index[0], index[1], first[0] + i, first[1] + j, index[4]]
            result += share[..., None] * taken
    return result


def _lagrange(t: np.ndarray) -> list[np.ndarray]:
    """Shares of four values at 0, 1, 2, 3."""
    a, b, c = t - 1, t - 2, t - 3
    return [-a * b * c / 6, t * b * c / 2, -t * a * c / 2, t * a * b / 6]


def _area_followed(moved_px: np.ndarray, step_px: np.ndarray) -> np.ndarray:
    """Area of places per area of pixels, of each ray: |det dx/dy|."""
    per_row = np.gradient(moved_px, step_px[0], axis=1)
    per_column = np.gradient(moved_px, step_px[1], axis=2)
    return np.abs(
        (1 + per_column[..., 0]) * (1 + per_row[..., 1])
        - per_column[..., 1] * per_row[..., 0]
    )


def _parabola(moved: np.ndarray, depth: DepthNodes) -> np.ndarray:
    """c0, c1, c2 on a last axis from values at three radii (second axis)."""
    matrix = np.linalg.inv(np.vander(np.array(depth), 3, increasing=True))
    return np.einsum("pd,cdrkns->crknsp", matrix, moved)


def with_grey(field: RayField, unseen_px: float) -> RayField:
    """One channel for all where no ray of a colour strays farther than can be seen."""
    moved, weight = field.moved_px, field.weight
    if len(moved) == 1 or np.abs(moved[..., 0] - moved[1:2, ..., 0]).max() > unseen_px:
        return field
    return replace(field, moved_px=moved[1:2], weight=weight[1:2])
