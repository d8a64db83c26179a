"""Small bright lights: the image of a point as a mesh of pupil triangles.

A light of hundreds times white shows details that the rest of a picture does not: the
rim of its disc, caustics where the wavefront folds, blades, coloured edges. So the
pupil is divided into triangles. Each is imaged as a triangle that holds the light of
its part of the pupil, whatever its area in the image. A triangle is rasterised in
pieces smaller than a pixel, and each piece is visible or occluded by what stands before
the light on its ray: half a disc behind a column, a line where a wire crosses.

The meshes are computed at the nodes of a grid over the frame, at three radii of blur,
for every wavelength of every channel. Between them they are interpolated as rays are
(`lensfit.rendering.ray_field`), with

    landing = place + f0 + f1 r + f2 r^2.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numba as nb
import numpy as np
from jaxtyping import Float, Float32, Int32

from lensfit.coords import Window
from lensfit.rendering.circle import Circle
from lensfit.rendering.gather import (
    HEIGHT,
    LEFT,
    MIDDLE,
    MOST,
    R_START,
    START,
    TOP,
    WIDTH,
    PackedSurfaces,
    surface_in_rectangle,
)
from lensfit.rendering.outlines import STEP_GROWTH, STEP_PX
from lensfit.rendering.ray_field import DepthNodes, landed_rays
from lensfit.rendering.uv import PlateGeometry

if TYPE_CHECKING:
    from lensfit.lens import Lens

RINGS = 12
"""Of the pupil; where rays land is linear between them."""
COLUMNS, ROWS = 9, 7
"""Nodes over the window."""
_FINE_SIDES = ((6.0, 4), (12.0, 3), (40.0, 2))
"""Blur up to this radius (px) is laid down on so many times finer pixels."""
_PER_PIXEL = 4.0
"""Pieces per finer pixel."""
_MOST_PARTS = 40
"""Along the side of a triangle."""
_LEAST_SAMPLED_PX = 4.0
"""A smaller image is not told by its values at the middles of pixels."""


@dataclass(frozen=True, eq=False)
class LightField:
    """Meshes over a window.

    Attributes
    ----------
    window : Pixels over which the nodes lie, the outermost ones on its border.
    moved_px : f0, f1, f2 along x and y, at each vertex.
    density : Light per area of the unit disc, up to a factor, at each vertex.
    diffraction_px : As in `RayField`.
    rings : Of the mesh.
    """

    window: Window
    moved_px: Float32[np.ndarray, "channels waves rows columns vertices 2 3"]
    density: Float32[np.ndarray, "channels waves rows columns vertices"]
    diffraction_px: float
    rings: int = RINGS

    def node_px(self) -> tuple[float, float]:
        """Pixels from node to node, along x and y."""
        rows, columns = self.density.shape[2:4]
        size = max(self.window.width - 1, 1), max(self.window.height - 1, 1)
        return size[0] / (columns - 1), size[1] / (rows - 1)


@lru_cache(maxsize=4)
def pupil_mesh(
    rings: int = RINGS,
) -> tuple[Float[np.ndarray, "vertices 2"], Int32[np.ndarray, "triangles 3"]]:
    """Vertices on the unit disc, on rings about its middle, and triangles of them."""
    from scipy.spatial import Delaunay

    found = [np.zeros((1, 2))]
    for ring in range(1, rings + 1):
        angle = (np.arange(6 * ring) + (ring % 2) / 2) * (2 * np.pi / (6 * ring))
        found.append(ring / rings * np.stack([np.cos(angle), np.sin(angle)], -1))
    vertices = np.concatenate(found)
    return vertices, Delaunay(vertices).simplices.astype(np.int32)


def disc_lights(window: Window) -> LightField:
    """Of an ideal lens."""
    vertices, _ = pupil_mesh()
    moved = np.zeros((1, 1, 2, 2, len(vertices), 2, 3), np.float32)
    moved[..., 1] = -vertices
    return LightField(window, moved, np.ones(moved.shape[:5], np.float32), 0.0)


def lens_lights(
    lens: "Lens",
    geometry: PlateGeometry,
    circle: Circle,
    window: Window,
    depth: DepthNodes,
    rings: int = RINGS,
    nodes: tuple[int, int] = (COLUMNS, ROWS),
) -> LightField:
    """Of any lens; parameters as of `ray_field.lens_field`.

    Parameters
    ----------
    rings : Of the mesh.
    """
    vertices, _ = pupil_mesh(rings)
    waves = (lens.blur or lens.perfect_blur()).bands.wavelengths_nm.shape[1]
    reach = np.hypot(*vertices.T)
    polar = np.stack([np.arctan2(vertices[:, 1], vertices[:, 0]), reach, reach**0])
    is_even = lens.blur is None or lens.blur.is_ideal
    size = (1, 1) if is_even else nodes
    # Rays take the wavelengths in turn: each vertex once for each.
    found = landed_rays(
        lens,
        geometry,
        circle,
        window,
        depth,
        np.repeat(polar, waves, 1),
        *size,
    )
    matrix = np.linalg.inv(np.vander(np.array(depth), 3, increasing=True))
    shape = (3, 3, size[1], size[0], len(vertices), waves)
    moved = np.einsum(
        "pd,cdrkvwx->cwrkvxp", matrix, found.landing_px.reshape(*shape, 2)
    )
    density = np.moveaxis(found.share.reshape(shape).mean(1), -1, 1)
    if is_even:
        moved = np.repeat(np.repeat(moved, 2, 2), 2, 3)
        density = np.repeat(np.repeat(density, 2, 2), 2, 3)
    return LightField(
        window,
        np.ascontiguousarray(moved, np.float32),
        np.ascontiguousarray(density, np.float32),
        found.diffraction_px,
        rings,
    )


def light_kernel(
    field: LightField,
    channel: int,
    place_px: tuple[float, float],
    radius_px: float,
    in_front: PackedSurfaces,
    offset: tuple[int, int] = (0, 0),
    *,
    is_point: bool = True,
) -> Float32[np.ndarray, "size size"]:
    """Image of a point, less what stands before it; odd in size, the chief ray in the
    middle. It sums to 1 where nothing does.

    Parameters
    ----------
    place_px : x and y of where its chief ray lands, from the first pixel's corner.
    radius_px : Of its blur, signed.
    in_front : At full resolution.
    offset : Row and column of the first pixel of those.
    is_point : Whether pixels are to hold the means over their squares; a light of
        several pixels has been through the filter of whoever rendered it.
    """
    channel = min(channel, field.density.shape[0] - 1)
    x, y = field.node_px()
    mesh, density = _between(
        field.moved_px[channel],
        field.density[channel],
        ((place_px[0] - 0.5) / x, (place_px[1] - 0.5) / y),
    )
    landing = mesh @ np.array([1, radius_px, radius_px**2], np.float32)
    reach = float(np.abs(landing).max())
    half = int(np.ceil(reach + 3 * field.diffraction_px)) + 1
    finer = next((n for radius, n in _FINE_SIDES if reach <= radius), 1)
    is_sampled = not is_point and reach > _LEAST_SAMPLED_PX
    if is_sampled:
        finer = 3 if finer > 1 else 1  # odd, to have a middle
    elif not is_point:
        mesh = mesh * _less_a_pixel(landing, density, field.rings)
    fine = np.zeros(((2 * half + 1) * finer,) * 2)
    _lay_down(
        fine,
        np.float32((half + 0.5) * finer),
        np.float32(finer),
        mesh,
        density,
        *pupil_mesh(field.rings),
        (np.float32(place_px[0] - offset[1]), np.float32(place_px[1] - offset[0])),
        np.float32(radius_px),
        in_front,
        _nearer(in_front, radius_px, place_px, offset, half),
    )
    side = 2 * half + 1
    parts = fine.reshape(side, finer, side, finer)
    if not is_sampled:
        kernel = parts.sum((1, 3))
    else:
        kernel = parts[:, finer // 2, :, finer // 2]
        kernel = kernel * (fine.sum() / max(kernel.sum(), 1e-30))
    return _diffracted_kernel(kernel, field.diffraction_px).astype(np.float32)


def _less_a_pixel(
    landing: Float[np.ndarray, "waves vertices 2"],
    density: Float[np.ndarray, "waves vertices"],
    rings: int,
) -> Float32[np.ndarray, "2 1"]:
    """By how much an image shrinks along x and y so that its second moments are right
    once means over pixels are taken, which add a twelfth."""
    light = np.broadcast_to(density, landing.shape[:2]) * _areas_about(rings)
    light = light[..., None] / light.sum()
    middle = (light * landing).sum((0, 1))
    variance = (light * (landing - middle) ** 2).sum((0, 1))
    left = np.maximum(1 - 1 / (12 * np.maximum(variance, 1e-6)), 0.0)
    return np.sqrt(left)[:, None].astype(np.float32)


@lru_cache(maxsize=4)
def _areas_about(rings: int) -> Float[np.ndarray, " vertices"]:
    """Of the unit disc, of the triangles about each vertex, up to a factor."""
    vertices, triangles = pupil_mesh(rings)
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    area = np.abs(np.linalg.det(np.stack([b - a, c - a], -1)))
    return np.bincount(triangles.ravel(), np.repeat(area, 3), len(vertices))


def _nearer(
    surfaces: PackedSurfaces,
    radius_px: float,
    place_px: tuple[float, float],
    offset: tuple[int, int],
    half: int,
) -> Int32[np.ndarray, " n"]:
    """Surfaces with anything that may lie before a light of this radius of blur."""
    step = STEP_PX + STEP_GROWTH * abs(radius_px)
    x, y = place_px[0] - offset[1], place_px[1] - offset[0]
    tops, lefts = surfaces.table[:, TOP], surfaces.table[:, LEFT]
    may = np.flatnonzero(surfaces.extent_px[:, MOST] > radius_px + step).tolist()
    found = [
        n
        for n in may
        # Towards the lens a ray strays farther than it lands from its chief ray.
        for reach in [half * max(1.0, _widening(surfaces, n, radius_px))]
        for low in [(y - reach - tops[n], x - reach - lefts[n])]
        if surface_in_rectangle(
            surfaces, n, low, (low[0] + 2 * reach, low[1] + 2 * reach)
        )[0]
    ]
    return np.array(found, np.int32)


def _widening(surfaces: PackedSurfaces, surface: int, radius_px: float) -> float:
    """How far rays of a light are apart where they cross a surface, over how far they
    are where they land."""
    most = abs(radius_px - surfaces.extent_px[surface, MOST])
    return float(most / max(abs(radius_px), 1.0))


def _between(
    moved: np.ndarray, density: np.ndarray, at: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """A mesh between nodes."""
    rows, columns = density.shape[1:3]
    column = min(max(int(at[0]), 0), columns - 2)
    row = min(max(int(at[1]), 0), rows - 2)
    u, v = at[0] - column, at[1] - row
    shares = np.outer([1 - v, v], [1 - u, u]).astype(np.float32)
    part = np.s_[:, row : row + 2, column : column + 2]
    mesh = np.einsum("rk,wrkvxp->wvxp", shares, moved[part])
    return mesh, np.einsum("rk,wrkv->wv", shares, density[part])


def _diffracted_kernel(kernel: np.ndarray, sigma_px: float) -> np.ndarray:
    if sigma_px < 0.05:
        return kernel
    import cv2

    return cv2.GaussianBlur(kernel, (0, 0), sigma_px, borderType=cv2.BORDER_CONSTANT)


@nb.njit(fastmath=True, nogil=True, cache=True, error_model="numpy")
def _lay_down(
    fine,
    middle,
    finer,
    mesh,
    density,
    vertices,
    triangles,
    place,
    radius,
    surfaces,
    nearer,
):
    """Add all triangles, in pieces."""
    waves = mesh.shape[0]
    total = 0.0
    areas = np.empty(len(triangles))
    for t in range(len(triangles)):
        a, b, c = (
            vertices[triangles[t, 0]],
            vertices[triangles[t, 1]],
            vertices[triangles[t, 2]],
        )
        areas[t] = abs((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
        for w in range(waves):
            for k in range(3):
                total += areas[t] * density[w, triangles[t, k]]
    if total <= 0:
        return
    corners = np.empty((3, 6), np.float32)
    for w in range(waves):
        for t in range(len(triangles)):
            light = 0.0
            for k in range(3):
                vertex = triangles[t, k]
                light += areas[t] * density[w, vertex] / total
                for n in range(6):
                    corners[k, n] = mesh[w, vertex, n // 3, n % 3]
            _lay_triangle(
                fine,
                middle,
                finer,
                corners,
                light,
                place,
                radius,
                surfaces,
                nearer,
                waves,
            )


@nb.njit(fastmath=True, nogil=True, cache=True, error_model="numpy")
def _lay_triangle(
    fine, middle, finer, corners, light, place, radius, surfaces, nearer, waves
):
    """Add one triangle: pieces of equal area in the pupil, each by linear weights."""
    x, y = np.empty(3, np.float32), np.empty(3, np.float32)
    for k in range(3):
        x[k] = corners[k, 0] + radius * (corners[k, 1] + radius * corners[k, 2])
        y[k] = corners[k, 3] + radius * (corners[k, 4] + radius * corners[k, 5])
    longest = np.float32(0)
    for k in range(3):
        n = (k + 1) % 3
        longest = max(longest, (x[k] - x[n]) ** 2 + (y[k] - y[n]) ** 2)
    area = abs((x[1] - x[0]) * (y[2] - y[0]) - (y[1] - y[0]) * (x[2] - x[0])) / 2
    wanted = np.float32(_PER_PIXEL / waves) * finer * finer * area
    parts = int(np.ceil(np.sqrt(max(wanted, finer * np.sqrt(longest)))))
    parts = max(parts, 1)
    parts = min(parts, _MOST_PARTS)
    share = light / (parts * parts)
    size = fine.shape[0]
    third = np.float32(1 / 3)
    for i in range(parts):
        for j in range(parts - i):
            for down in range(2 if j < parts - i - 1 else 1):
                # Middle of an upright piece, or of the one beside it.
                s = (i + third * (1 + down)) / parts
                t = (j + third * (1 + down)) / parts
                o = np.float32(1) - s - t
                left = np.float32(1)
                for index in range(len(nearer)):
                    left *= 1 - _coverage(
                        corners, o, s, t, place, radius, surfaces, nearer[index]
                    )
                if left <= 0:
                    continue
                u = (o * x[0] + s * x[1] + t * x[2]) * finer + middle - np.float32(0.5)
                v = (o * y[0] + s * y[1] + t * y[2]) * finer + middle - np.float32(0.5)
                column, row = int(np.floor(u)), int(np.floor(v))
                if column < 0 or row < 0 or column + 1 >= size or row + 1 >= size:
                    continue
                u -= column
                v -= row
                seen = share * left
                fine[row, column] += seen * (1 - u) * (1 - v)
                fine[row, column + 1] += seen * u * (1 - v)
                fine[row + 1, column] += seen * (1 - u) * v
                fine[row + 1, column + 1] += seen * u * v


@nb.njit(fastmath=True, nogil=True, cache=True, error_model="numpy")
def _coverage(corners, o, s, t, place, radius, surfaces, surface):
    """How much of a ray a surface covers, where it lies before the light."""
    half = np.float32(0.5)
    row = surfaces.table[surface]
    f1x = o * corners[0, 1] + s * corners[1, 1] + t * corners[2, 1]
    f2x = o * corners[0, 2] + s * corners[1, 2] + t * corners[2, 2]
    f1y = o * corners[0, 4] + s * corners[1, 4] + t * corners[2, 4]
    f2y = o * corners[0, 5] + s * corners[1, 5] + t * corners[2, 5]
    r = surfaces.extent_px[surface, MIDDLE]
    right, bottom = np.float32(row[WIDTH] - 1), np.float32(row[HEIGHT] - 1)
    column = line = 0
    x = y = np.float32(0)
    for _ in range(1 if row[R_START] < 0 else 3):
        # The ray at radius r: where it lands, less what leads from r to there.
        square = radius * radius - r * r
        x = place[0] - row[LEFT] + (radius - r) * f1x + square * f2x - half
        y = place[1] - row[TOP] + (radius - r) * f1y + square * f2y - half
        x, y = min(max(x, np.float32(0)), right), min(max(y, np.float32(0)), bottom)
        if row[R_START] >= 0:
            column, line = int(x + half), int(y + half)
            r = surfaces.radii[row[R_START] + line * row[WIDTH] + column]
    if r < radius + np.float32(STEP_PX) + np.float32(STEP_GROWTH) * abs(radius):
        return np.float32(0)
    column, line = min(int(x), row[WIDTH] - 2), min(int(y), row[HEIGHT] - 2)
    u, v = x - column, y - line
    p = 4 * (row[START] + line * row[WIDTH] + column) + 3
    q = p + 4 * row[WIDTH]
    pixels = surfaces.pixels
    upper = pixels[p] + u * (pixels[p + 4] - pixels[p])
    lower = pixels[q] + u * (pixels[q + 4] - pixels[q])
    return upper + v * (lower - upper)
