"""Add the colours and coverage that rays read from a surface where they cross it.

`light` holds red, green, blue and the coverage of each; `crossed` the place x and y of
each point's ray, in pixels of the surface, and the remaining visibility behind the
surfaces before. Each function adds what the surface shows of every ray and returns what
it lets through. The loops have no branches, so that the compiler takes eight points at
a time.
"""

import numba as nb
import numpy as np
from jaxtyping import Float32


@nb.njit(fastmath=True, nogil=True, cache=True, error_model="numpy")
def add_colour(
    light: Float32[np.ndarray, "6 points"],
    crossed: Float32[np.ndarray, "3 points"],
    points: int,
    pixels: Float32[np.ndarray, " values"],
    start: int,
    wide: int,
    tall: int,
    channel: int,
) -> None:
    """One colour, linear between pixels."""
    shown, cover, through = light[channel], light[3 + channel], crossed[2]
    last_column, last_row = np.int32(max(wide - 2, 0)), np.int32(max(tall - 2, 0))
    right = np.int32(4 if wide > 1 else 0)
    below = np.int32(4 * wide if tall > 1 else 0)
    one, first = np.float32(1), np.int32(4 * start)
    for i in range(points):
        x, y = crossed[0, i], crossed[1, i]
        column, line = min(np.int32(x), last_column), min(np.int32(y), last_row)
        u, v = x - np.float32(column), y - np.float32(line)
        p = first + np.int32(4) * (line * np.int32(wide) + column)
        a, b, c, d = (one - u) * (one - v), u * (one - v), (one - u) * v, u * v
        n = p + np.int32(channel)
        colour = (
            a * pixels[n]
            + b * pixels[n + right]
            + c * pixels[n + below]
            + d * pixels[n + below + right]
        )
        n = p + np.int32(3)
        alpha = (
            a * pixels[n]
            + b * pixels[n + right]
            + c * pixels[n + below]
            + d * pixels[n + below + right]
        )
        seen = through[i]
        shown[i] += seen * colour
        cover[i] += seen * alpha
        through[i] = seen * (one - alpha)


@nb.njit(fastmath=True, nogil=True, cache=True, error_model="numpy")
def add_grey(
    light: Float32[np.ndarray, "6 points"],
    crossed: Float32[np.ndarray, "3 points"],
    points: int,
    pixels: Float32[np.ndarray, " values"],
    start: int,
    wide: int,
    tall: int,
) -> None:
    """All colours, linear between pixels."""
    through = crossed[2]
    last_column, last_row = np.int32(max(wide - 2, 0)), np.int32(max(tall - 2, 0))
    right = np.int32(4 if wide > 1 else 0)
    below = np.int32(4 * wide if tall > 1 else 0)
    one, first = np.float32(1), np.int32(4 * start)
    for i in range(points):
        x, y = crossed[0, i], crossed[1, i]
        column, line = min(np.int32(x), last_column), min(np.int32(y), last_row)
        u, v = x - np.float32(column), y - np.float32(line)
        p = first + np.int32(4) * (line * np.int32(wide) + column)
        q, m, n = p + right, p + below, p + below + right
        seen = through[i]
        a, b = seen * (one - u) * (one - v), seen * u * (one - v)
        c, d = seen * (one - u) * v, seen * u * v
        light[0, i] += a * pixels[p] + b * pixels[q] + c * pixels[m] + d * pixels[n]
        light[1, i] += (
            a * pixels[p + 1]
            + b * pixels[q + 1]
            + c * pixels[m + 1]
            + d * pixels[n + 1]
        )
        light[2, i] += (
            a * pixels[p + 2]
            + b * pixels[q + 2]
            + c * pixels[m + 2]
            + d * pixels[n + 2]
        )
        alpha = (
            a * pixels[p + 3]
            + b * pixels[q + 3]
            + c * pixels[m + 3]
            + d * pixels[n + 3]
        )
        light[3, i] += alpha
        through[i] = seen - alpha


@nb.njit(fastmath=True, nogil=True, cache=True, error_model="numpy")
def add_cubic(
    light: Float32[np.ndarray, "6 points"],
    crossed: Float32[np.ndarray, "3 points"],
    points: int,
    pixels: Float32[np.ndarray, " values"],
    start: int,
    wide: int,
    tall: int,
    channel: int,
    channels: int,
) -> None:
    """One colour or all, by Catmull and Rom's cubic, which takes no detail off."""
    first = channel if channels > 1 else 0
    last = channel + 1 if channels > 1 else 3
    for i in range(points):
        x, y, seen = crossed[0, i], crossed[1, i], crossed[2, i]
        column, row = int(x), int(y)
        xs, ys = _cubic(x - np.float32(column)), _cubic(y - np.float32(row))
        alpha = np.float32(0)
        for m in range(4):
            line = start + min(max(row + m - 1, 0), tall - 1) * wide
            for k in range(4):
                p = 4 * (line + min(max(column + k - 1, 0), wide - 1))
                share = ys[m] * xs[k]
                alpha += share * pixels[p + 3]
                for n in range(first, last):
                    light[n, i] += seen * share * pixels[p + n]
        light[3 + first, i] += seen * alpha
        crossed[2, i] = seen * (np.float32(1) - alpha)


@nb.njit(fastmath=True, nogil=True, cache=True, error_model="numpy")
def _cubic(t):
    half, two, three = np.float32(0.5), np.float32(2), np.float32(3)
    square = t * t
    cube = square * t
    return (
        half * (two * square - cube - t),
        half * (three * cube - np.float32(5) * square + two),
        half * (np.float32(4) * square - three * cube + t),
        half * (cube - square),
    )
