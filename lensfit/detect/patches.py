"""Small square patches around many dots at once, and sums over them.

One row per dot. Every sum over a patch is a matrix product with the polynomials 1, x,
y, x^2, x y, y^2 of its samples, x and y being pixels from the middle of the patch.
"""

from typing import final

import numpy as np


@final
class Patches:
    """Samples around each dot, one row per dot, and the patch polynomials.

    Coordinates are pixels from the middle of the patch. `basis` holds the polynomials
    of the moments, `design` those of a background.
    """

    def __init__(self, image, smooth, centre_px, half: int, ignore=None):
        middle = np.floor(centre_px).astype(int)
        offset = np.arange(-half, half + 1)
        height, width = image.shape
        column = middle[:, :1] + offset
        row = middle[:, 1:] + offset
        inside_x = (column >= 0) & (column < width)
        inside_y = (row >= 0) & (row < height)
        flat = np.clip(row, 0, height - 1)[:, :, None] * width
        flat = (flat + np.clip(column, 0, width - 1)[:, None, :]).reshape(len(row), -1)
        self.sharp = np.take(image.reshape(-1), flat)
        self.smooth = np.take(smooth.reshape(-1), flat)
        inside = inside_y[:, :, None] & inside_x[:, None, :]
        self.inside = inside.reshape(len(row), -1)
        if ignore is not None:
            self.inside &= ~np.take(ignore.reshape(-1), flat)
        y, x = (g.reshape(-1) for g in np.meshgrid(offset, offset, indexing="ij"))
        one = np.ones_like(x)
        self.basis = np.stack([one, x, y, x * x, x * y, y * y], 1).astype(np.float32)
        saddle = [one, x, y, x * y, x * x - y * y]
        self.design = np.stack(saddle, 1).astype(np.float32)
        self.origin = middle + 0.5
        self.start = centre_px - self.origin

    def radius(self, shape_px2: np.ndarray, centre: np.ndarray) -> np.ndarray:
        """Distance of every sample from the centre in aperture radii."""
        inverse = np.linalg.inv(shape_px2)
        a, b, c = inverse[:, 0, 0], inverse[:, 0, 1], inverse[:, 1, 1]
        u, v = centre.T
        row = [
            a * u * u + 2 * b * u * v + c * v * v,
            -2 * (a * u + b * v),
            -2 * (b * u + c * v),
            a,
            2 * b,
            c,
        ]
        rho2 = np.stack(row, 1).astype(np.float32) @ self.basis.T
        return np.sqrt(np.maximum(rho2, 0, out=rho2), out=rho2)


def second_moments_about(
    weight: np.ndarray, patch: Patches, centre: np.ndarray
) -> np.ndarray:
    """Second moments of a weight about the centre, not normalised."""
    sums = (weight @ patch.basis).astype(float)
    u, v = centre.T
    n, x, y, xx, xy, yy = sums.T
    a = xx - 2 * u * x + n * u * u
    b = xy - u * y - v * x + n * u * v
    c = yy - 2 * v * y + n * v * v
    return np.stack([np.stack([a, b], -1), np.stack([b, c], -1)], -2)
