"""The mean over the pupil: every ray of every pixel through the surfaces it crosses.

A ray meets surfaces in order, the nearest first. Each hides what is behind it by its
coverage where the ray crosses it, so with s the premultiplied colours and a the
coverages along one ray

    ray = s_1 + (1 - a_1) [ s_2 + (1 - a_2) [ ... ] ],

and the pixel is the weighted mean of its rays. Visibility is decided for each ray
separately: a leaf cuts the disc of a lamp behind it, and both sides of an outline blur
by their own distances. Where the blur is small, surfaces are read by a cubic, which
swings below zero beside an outline; a pixel whose rays meet no negative colour is held
above zero, as `lensfit.rendering.warp` holds it.

A surface has its own distance at each pixel. The crossing of a ray is found by two
fixed-point steps: read the distance at the present crossing, and recompute the
crossing from it.

The picture is made in small squares. In a square where nothing is far out of focus few
rays are enough; where everything is, few points are: a blur of R pixels holds no detail
finer than about R / 8, so it is computed at every second or fourth pixel, and
interpolated linearly.

This is the inner loop of the renderer, compiled by Numba for the processor: it takes
some nanoseconds per surface and ray, where array programs write every ray to memory.
"""

from typing import NamedTuple

import numba as nb
import numpy as np
from jaxtyping import Float32, Int32

from lensfit.rendering.reading import add_colour, add_cubic, add_grey

TILE = 16
"""Side of the squares, within which rays move linearly with the pixel."""
BLOCK = 8
"""Side of the squares of which a surface counts what it covers."""
_STEPS = (4, 2, 1)
_RADII_PER_STEP = 8.0
_THROUGH = np.float32(1e-5)
"""A ray with less left to see has ended."""
_NOTHING = np.float32(1e9)
# Columns of the table of surfaces.
START, HEIGHT, WIDTH, SCALE, R_START, COUNT_START, COUNT_WIDTH = range(7)
IS_CUBIC, TOP, LEFT = range(7, 10)
# Columns of the table of their radii.
MIDDLE, LEAST, MOST, SPOT_LEAST, SPOT_MOST = range(5)


class PackedSurfaces(NamedTuple):
    """Surfaces front to back, flat in memory, as the loop reads them.

    Attributes
    ----------
    pixels : Premultiplied r g b a of all surfaces, one after the other.
    radii : Signed radius of blur of each of their pixels, px.
    counts : Summed-area tables of their blocks: how many hold anything, how many one
        can see through, and how many hold a colour below zero.
    table : For each surface, where it starts in `pixels` (in pixels), its size, plate
        pixels per pixel, where it starts in `radii` (-1 for none), where its counts
        start and how wide they are, whether it is read by a cubic, and row and column
        of its first pixel, in pixels of the plate.
    extent_px : Radius of blur in its middle, the least and the greatest; least and
        greatest radius of the spots that it makes over the frame.
    """

    pixels: Float32[np.ndarray, " values"]
    radii: Float32[np.ndarray, " pixels"]
    counts: Int32[np.ndarray, "corners 3"]
    table: Int32[np.ndarray, "surfaces 10"]
    extent_px: Float32[np.ndarray, "surfaces 5"]


@nb.njit(fastmath=True, nogil=True, cache=True, error_model="numpy")
def gather(
    picture: Float32[np.ndarray, "height width 4"],
    corner: tuple[int, int],
    rows: tuple[int, int],
    surfaces: PackedSurfaces,
    many: tuple[np.ndarray, np.ndarray],
    few: tuple[np.ndarray, np.ndarray],
    node_px: tuple[float, float],
    place_px: tuple[float, float],
    limits: tuple[np.float32, np.float32, bool],
    sharp: Float32[np.ndarray, "height width 4"],
) -> None:
    """Fill rows of a picture with the mean over the pupil.

    Parameters
    ----------
    picture : Premultiplied colour and alpha.
    corner : Row and column of its first pixel on the surfaces.
    rows : First and last (not included) to fill; the first a multiple of `TILE`.
    surfaces : `PackedSurfaces`.
    many, few : Rays: `moved_px` and `weight` of a `RayField`.
    node_px : Pixels from node to node, along x and y.
    place_px : x and y of the first pixel's centre, from the first node.
    limits : Displacement that is not seen, px; spots up to this radius need few rays;
        and whether the scene has no holes, so that what rays miss is made up.
    sharp : As it is where nothing is displaced visibly.
    """
    rays = np.empty((max(many[1].shape[3], few[1].shape[3]), 19), np.float32)
    met = np.empty(surfaces.table.shape[0], np.int32)
    grid, crossed, light = _room_for_points()
    for top in range(rows[0], rows[1], TILE):
        for left in range(0, picture.shape[1], TILE):
            size = min(TILE, rows[1] - top), min(TILE, picture.shape[1] - left)
            middle = place_px[0] + left + TILE / 2, place_px[1] + top + TILE / 2
            _rays_at(rays, few, few[1].shape[0] // 2, middle, node_px)
            found, moved, least, most, is_negative = _surfaces_met(
                met, rays, few[1].shape[3], surfaces, corner, (top, left), size
            )
            if moved <= limits[0]:
                for j in range(top, top + size[0]):
                    picture[j, left : left + size[1]] = sharp[j, left : left + size[1]]
                continue
            chosen = few if most <= limits[1] else many
            step = step_for(least)
            down, across = _points_of(grid, corner, (top, left), size, step)
            light[:, : down * across] = 0
            channels = chosen[1].shape[0]
            for channel in range(channels):
                _rays_at(rays, chosen, channel, middle, node_px)
                _follow(
                    light,
                    crossed,
                    grid,
                    down * across,
                    rays[: chosen[1].shape[3]],
                    surfaces,
                    met[:found],
                    channel,
                    channels,
                )
            _fill(
                picture,
                light,
                (top, left),
                size,
                down * across,
                across,
                step,
                channels,
                limits[2],
                is_negative,
            )


@nb.njit(fastmath=True, nogil=True, cache=True, error_model="numpy")
def _room_for_points():
    """For the points of a tile: place on the surfaces and from the tile's middle; place
    that a ray crosses, and what is still seen of it; colours and coverages."""
    points = (TILE + 1) ** 2
    grid = np.empty((4, points), np.float32)
    crossed = np.empty((3, points), np.float32)
    return grid, crossed, np.empty((6, points), np.float32)


@nb.njit(fastmath=True, nogil=True, cache=True, error_model="numpy")
def _points_of(grid, corner, at, size, step):
    """Lay out the points of a tile; how many down and across."""
    down, across = points_along(size[0], step), points_along(size[1], step)
    for point in range(down * across):
        i, j = point % across * step, point // across * step
        grid[0, point] = corner[1] + at[1] + i + 0.5
        grid[1, point] = corner[0] + at[0] + j + 0.5
        grid[2, point] = i + 0.5 - TILE / 2
        grid[3, point] = j + 0.5 - TILE / 2
    return down, across


@nb.njit(fastmath=True, nogil=True, cache=True, error_model="numpy")
def _follow(light, crossed, grid, points, rays, surfaces, met, channel, channels):
    """Add all rays of one colour through the surfaces that they meet."""
    for ray in range(rays.shape[0]):
        crossed[2, :points] = rays[ray, 18]
        for index in range(len(met)):
            _cross(crossed, grid, points, rays[ray], surfaces, met[index])
            left = _add(light, crossed, points, surfaces, met[index], channel, channels)
            if left < _THROUGH * rays[ray, 18]:
                break


@nb.njit(fastmath=True, nogil=True, cache=True, error_model="numpy")
def step_for(radius_px: float | np.float32) -> int:
    """Pixels from point to point, where the smallest spots have this radius."""
    for wider in _STEPS:
        if radius_px >= _RADII_PER_STEP * wider:
            return wider
    return 1


@nb.njit(fastmath=True, nogil=True, cache=True, error_model="numpy")
def points_along(pixels: int, step: int) -> int:
    """Points along a side of a tile: one beyond the last where they are apart."""
    return pixels if step == 1 else -(-pixels // step) + 1


@nb.njit(fastmath=True, nogil=True, cache=True, error_model="numpy")
def _rays_at(rays, field, channel, middle, node_px):
    """Coefficients of rays in the middle of a tile, their changes per pixel along x
    and along y, and their shares."""
    moved, weight = field
    node_rows, node_columns = weight.shape[1:3]
    x, y = middle[0] / node_px[0], middle[1] / node_px[1]
    column = min(max(int(np.floor(x)), 0), node_columns - 2)
    row = min(max(int(np.floor(y)), 0), node_rows - 2)
    u, v = np.float32(x - column), np.float32(y - row)
    per_x, per_y = np.float32(1 / node_px[0]), np.float32(1 / node_px[1])
    for ray in range(weight.shape[3]):
        for n in range(6):
            axis, power = n // 3, n % 3
            a = moved[channel, row, column, ray, axis, power]
            b = moved[channel, row, column + 1, ray, axis, power]
            c = moved[channel, row + 1, column, ray, axis, power]
            d = moved[channel, row + 1, column + 1, ray, axis, power]
            upper, lower = a + u * (b - a), c + u * (d - c)
            rays[ray, n] = upper + v * (lower - upper)
            rays[ray, 6 + n] = ((b - a) + v * ((d - c) - (b - a))) * per_x
            rays[ray, 12 + n] = (lower - upper) * per_y
        a, b = weight[channel, row, column, ray], weight[channel, row, column + 1, ray]
        c = weight[channel, row + 1, column, ray]
        d = weight[channel, row + 1, column + 1, ray]
        upper, lower = a + u * (b - a), c + u * (d - c)
        rays[ray, 18] = upper + v * (lower - upper)


@nb.njit(fastmath=True, nogil=True, cache=True, error_model="numpy")
def _surfaces_met(met, rays, count, surfaces, corner, at, size):
    """Surfaces that rays of a tile can meet, as far as one sees: how many, how far any
    ray is led, the least and greatest radius of their spots, and whether a colour of
    theirs is below zero there."""
    found, furthest, is_negative = 0, np.float32(0), False
    least, most = _NOTHING, np.float32(0)
    for surface in range(surfaces.table.shape[0]):
        x_low = y_low = _NOTHING
        x_high = y_high = -_NOTHING
        for end in (LEAST, MOST):
            r = surfaces.extent_px[surface, end]
            for ray in range(count):
                x = rays[ray, 0] + r * (rays[ray, 1] + r * rays[ray, 2])
                y = rays[ray, 3] + r * (rays[ray, 4] + r * rays[ray, 5])
                x_low, x_high = min(x_low, x), max(x_high, x)
                y_low, y_high = min(y_low, y), max(y_high, y)
        moved = max(max(-x_low, x_high), max(-y_low, y_high))
        # Rays between those looked at go a little farther; so do their footprints.
        spare = np.float32(0.35) * moved + 2 * surfaces.table[surface, SCALE]
        top = corner[0] + at[0] - surfaces.table[surface, TOP]
        left = corner[1] + at[1] - surfaces.table[surface, LEFT]
        holds, opens, below_zero = surface_in_rectangle(
            surfaces,
            surface,
            (top + y_low - spare, left + x_low - spare),
            (top + size[0] + y_high + spare, left + size[1] + x_high + spare),
        )
        if not holds:
            continue
        met[found] = surface
        found += 1
        is_negative |= below_zero
        furthest = max(furthest, moved)
        least = min(least, surfaces.extent_px[surface, SPOT_LEAST])
        most = max(most, surfaces.extent_px[surface, SPOT_MOST])
        if not opens:
            break
    return found, furthest, least, most, is_negative


@nb.njit(fastmath=True, nogil=True, cache=True, error_model="numpy")
def surface_in_rectangle(
    surfaces: PackedSurfaces,
    surface: int,
    low: tuple[float, float],
    high: tuple[float, float],
) -> tuple[bool, bool, bool]:
    """Whether a surface has anything in a rectangle (corners y, x), whether one can see
    through it anywhere there, and whether a colour of it is below zero there."""
    row = surfaces.table[surface]
    tall, wide = row[HEIGHT] * row[SCALE], row[WIDTH] * row[SCALE]
    # Beyond its border a surface goes on as it is there.
    blocks_y, blocks_x = -(-tall // BLOCK), -(-wide // BLOCK)
    y0 = min(max(int(low[0]) // BLOCK, 0), blocks_y - 1)
    x0 = min(max(int(low[1]) // BLOCK, 0), blocks_x - 1)
    y1 = min(max(int(high[0]) // BLOCK + 1, y0 + 1), blocks_y)
    x1 = min(max(int(high[1]) // BLOCK + 1, x0 + 1), blocks_x)
    start, stride = row[COUNT_START], row[COUNT_WIDTH]
    a, b = start + y0 * stride, start + y1 * stride
    ends = a + x0, a + x1, b + x0, b + x1
    return (
        _are_any(surfaces.counts, ends, 0),
        _are_any(surfaces.counts, ends, 1),
        _are_any(surfaces.counts, ends, 2),
    )


@nb.njit(fastmath=True, nogil=True, cache=True, error_model="numpy")
def _are_any(counts, ends, kind):
    """Whether a rectangle of a summed-area table holds any block of a kind."""
    a, b, c, d = ends
    return counts[d, kind] - counts[b, kind] - counts[c, kind] + counts[a, kind] > 0


@nb.njit(fastmath=True, nogil=True, cache=True, error_model="numpy")
def _cross(crossed, grid, points, ray, surfaces, surface):
    """Where a ray of each point crosses a surface, in its pixels."""
    half = np.float32(0.5)
    row = surfaces.table[surface]
    finer = np.float32(1) / np.float32(row[SCALE])
    right, bottom = np.float32(row[WIDTH] - 1), np.float32(row[HEIGHT] - 1)
    x, y, zero = crossed[0], crossed[1], np.float32(0)
    r = surfaces.extent_px[surface, MIDDLE]
    left, top = np.float32(row[LEFT]), np.float32(row[TOP])
    a0 = ray[0] + r * (ray[1] + r * ray[2]) - left
    b0 = ray[3] + r * (ray[4] + r * ray[5]) - top
    ax, bx = ray[6] + r * (ray[7] + r * ray[8]), ray[9] + r * (ray[10] + r * ray[11])
    ay, by = (
        ray[12] + r * (ray[13] + r * ray[14]),
        ray[15] + r * (ray[16] + r * ray[17]),
    )
    for i in range(points):
        u = grid[0, i] + a0 + grid[2, i] * ax + grid[3, i] * ay
        v = grid[1, i] + b0 + grid[2, i] * bx + grid[3, i] * by
        x[i] = min(max(u * finer - half, zero), right)
        y[i] = min(max(v * finer - half, zero), bottom)
    if row[R_START] < 0:
        return
    start, wide = row[R_START], row[WIDTH]
    radii = surfaces.radii
    for _ in range(2):
        for i in range(points):
            column, line = np.int32(x[i] + half), np.int32(y[i] + half)
            r = radii[start + line * wide + column]
            dx, dy = grid[2, i], grid[3, i]
            c0 = ray[0] + dx * ray[6] + dy * ray[12]
            c1 = ray[1] + dx * ray[7] + dy * ray[13]
            c2 = ray[2] + dx * ray[8] + dy * ray[14]
            d0 = ray[3] + dx * ray[9] + dy * ray[15]
            d1 = ray[4] + dx * ray[10] + dy * ray[16]
            d2 = ray[5] + dx * ray[11] + dy * ray[17]
            u = grid[0, i] - left + c0 + r * (c1 + r * c2)
            v = grid[1, i] - top + d0 + r * (d1 + r * d2)
            x[i] = min(max(u * finer - half, zero), right)
            y[i] = min(max(v * finer - half, zero), bottom)


@nb.njit(fastmath=True, nogil=True, cache=True, error_model="numpy")
def _add(light, crossed, points, surfaces, surface, channel, channels):
    """Add what a surface shows of a ray of each point; the most that is seen of what
    lies behind."""
    row = surfaces.table[surface]
    pixels = surfaces.pixels
    start, wide, tall = row[START], row[WIDTH], row[HEIGHT]
    if row[IS_CUBIC]:
        add_cubic(light, crossed, points, pixels, start, wide, tall, channel, channels)
    elif channels == 1:
        add_grey(light, crossed, points, pixels, start, wide, tall)
    else:
        add_colour(light, crossed, points, pixels, start, wide, tall, channel)
    left = np.float32(0)
    for i in range(points):
        left = max(left, crossed[2, i])
    return left


@nb.njit(fastmath=True, nogil=True, cache=True, error_model="numpy")
def _fill(
    picture, light, at, size, points, across, step, channels, is_whole, is_negative
):
    """Pixels of a tile from its points, linear between them."""
    zero = np.float32(0)
    for n in range(3):
        cover = light[3 + n] if channels > 1 else light[3]
        for i in range(points):
            # A cubic swings a little beyond full coverage beside an outline.
            if (is_whole and cover[i] > 0) or cover[i] > 1:
                light[n, i] /= cover[i]
            if not is_negative:
                light[n, i] = max(light[n, i], zero)
    covered = light[4] if channels > 1 else light[3]
    for i in range(points):
        most = np.float32(1)
        covered[i] = most if is_whole else min(max(covered[i], zero), most)
    for j in range(size[0]):
        row = j // step
        v = np.float32(j - row * step) / np.float32(step)
        for i in range(size[1]):
            column = i // step
            u = np.float32(i - column * step) / np.float32(step)
            a = row * across + column
            for n in range(4):
                plane = light[n] if n < 3 else covered
                value = plane[a]
                if step > 1:
                    upper = value + u * (plane[a + 1] - value)
                    lower = plane[a + across]
                    lower += u * (plane[a + across + 1] - lower)
                    value = upper + v * (lower - upper)
                picture[at[0] + j, at[1] + i, n] = value
