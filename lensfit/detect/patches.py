"""Small square patches around many dots at once, and sums and planes over them.

One row per dot. Every sum over a patch is a matrix product with the polynomials 1, x,
y, x^2, x y, y^2 of its samples, x and y being pixels from the middle of the patch.
"""

from typing import final

import numpy as np


@final
class Patches:
    """Samples around each dot, one row per dot, and the patch polynomials.

    Coordinates are pixels from the middle of the patch.
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


def fitted_plane(
    patch: Patches, values: np.ndarray, ring: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Background plane through the ring, its covariance per noise, and the noise.

    Fitted twice: samples beyond three deviations (dirt, a neighbour) are left out.
    """
    weight = ring.astype(np.float32)
    for last in (False, True):
        sums = (weight @ patch.basis).astype(float)
        normal = sums[:, [[0, 1, 2], [1, 3, 4], [2, 4, 5]]]
        normal += np.eye(3) * (1e-9 + 1e-9 * normal[:, :1, :1])
        right = ((weight * values) @ patch.basis[:, :3]).astype(float)
        plane = np.linalg.solve(normal, right[..., None])[..., 0]
        residual = values - plane.astype(np.float32) @ patch.basis[:, :3].T
        square = residual * residual * weight
        noise = np.sqrt(square.sum(1) / np.maximum(sums[:, 0] - 3, 1)).astype(float)
        if not last:
            first = noise
            weight = weight * (square <= (9 * noise * noise)[:, None])
    first = np.minimum(first, 2 * np.median(first)) if len(first) else first
    return plane, np.linalg.inv(normal), np.maximum(noise, first)


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
