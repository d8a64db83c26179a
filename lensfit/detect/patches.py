"""Small square patches around many dots at once: sums over them, their background.

One row per dot. Every sum over a patch is a matrix product with the polynomials 1, x,
y, x^2, x y, y^2 of its samples, x and y being pixels from the middle of the patch.

The background of a bright dot adds to its light and is subtracted. A dark dot reflects
the light that falls on it, so its image is divided by the background. In both cases
the background is fitted to a ring around the dot.
"""

from typing import NamedTuple, final

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


_DARKEST = 1e-3
"""Of the brightest sample: light below is not told from none."""
_STEEP = 0.2
"""Dark dots: light that changes by this much to the aperture's edge is no plane."""
_SLOPE_LEFT = 0.4
"""Of the shift by a slope of the light: scatter of half-lit dots about a smooth map."""
PLANE, SADDLE = 3, 5
"""Terms of a background: 1, x, y, and where it bends x y and x^2 - y^2. The sum of the
squares is left out: on a ring it cannot be told from the level."""


class Flattened(NamedTuple):
    """Patches with their background taken off.

    plane : Background as level, x slope and y slope at the middle of the patch.
    plane_covariance : Its covariance for unit noise.
    """

    sharp: np.ndarray
    smooth: np.ndarray
    plane: np.ndarray
    plane_covariance: np.ndarray
    noise: np.ndarray


def flatten_bright(patch: Patches, ring: np.ndarray) -> Flattened:
    """Take off the light around a bright dot: it adds to the dot's own."""
    plane, covariance, noise = fitted_background(patch, patch.sharp, ring)
    background = plane.astype(np.float32) @ patch.design[:, :PLANE].T
    sharp, smooth = patch.sharp - background, patch.smooth - background
    return Flattened(sharp, smooth, plane, covariance, noise)


def flatten_dark(patch: Patches, ring: np.ndarray, radius: np.ndarray) -> Flattened:
    """Undo the illumination of a dark dot, which reflects the light that falls on it.

    It is a plane of the logarithm, since fall-off and shadows multiply; in the steep
    light of a penumbra it bends as well.
    """
    dimmest = _DARKEST * patch.sharp.max(1, keepdims=True, initial=1e-9)
    logarithm = np.log(np.maximum(patch.sharp, dimmest))
    plane, covariance, noise = fitted_background(patch, logarithm, ring)
    steep = np.linalg.norm(plane[:, 1:], axis=1) * radius[:, 0] > _STEEP
    even = _levelling(patch, plane)
    if steep.any():
        bent, bent_covariance, noise[steep] = fitted_background(
            patch, logarithm[steep], ring[steep], SADDLE
        )
        even[steep] = _levelling(patch, bent)
        plane[steep] = bent[:, :PLANE]
        covariance[steep] = bent_covariance[:, :PLANE, :PLANE]
    light = np.exp(plane[:, :1]).astype(np.float32)
    sharp, smooth = patch.sharp * even - light, patch.smooth * even - light
    plane = light * np.concatenate([np.ones_like(light), plane[:, 1:]], 1)
    return Flattened(sharp, smooth, plane, covariance, noise * light[:, 0])


def _levelling(patch: Patches, terms: np.ndarray) -> np.ndarray:
    """What makes the light as bright everywhere as in the middle, from its logarithm.

    Bounded by what the logarithm was bounded by.
    """
    last, most = terms.shape[1], -np.log(_DARKEST)
    slopes = -terms[:, 1:].astype(np.float32) @ patch.design[:, 1:last].T
    np.clip(slopes, -most, most, out=slopes)
    return np.exp(slopes, out=slopes)


def unevenly_lit_px(steepness: np.ndarray, radius_px: np.ndarray) -> np.ndarray:
    """Standard deviation of a dot's place from steep light.

    Light that grows by a relative s over the radius r draws the centroid of a disc
    towards it by s r / 4, which dividing by the light undoes. But steep light means
    besides that part of the lamp or of the pupil is hidden, which moves the image
    itself: on photographed penumbras by a part of that.
    """
    return _SLOPE_LEFT * steepness * radius_px / 4


def fitted_background(
    patch: Patches, values: np.ndarray, ring: np.ndarray, terms: int = PLANE
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Background through the ring, its covariance per noise, and the noise.

    Fitted twice: samples beyond three deviations (dirt, a neighbour) are left out.
    """
    weight = ring.astype(np.float32)
    design = patch.design[:, :terms]
    first_of, second_of = np.triu_indices(terms)
    products = design[:, first_of] * design[:, second_of]
    normal = np.zeros((len(values), terms, terms))
    for last in (False, True):
        sums = (weight @ products).astype(float)
        normal[:, first_of, second_of] = normal[:, second_of, first_of] = sums
        normal += np.eye(terms) * (1e-9 + 1e-9 * normal[:, :1, :1])
        right = ((weight * values) @ design).astype(float)
        fitted = np.linalg.solve(normal, right[..., None])[..., 0]
        residual = values - fitted.astype(np.float32) @ design.T
        square = residual * residual * weight
        noise = np.sqrt(square.sum(1) / np.maximum(sums[:, 0] - terms, 1)).astype(float)
        if not last:
            first = noise
            weight = weight * (square <= (9 * noise * noise)[:, None])
    first = np.minimum(first, 2 * np.median(first)) if len(first) else first
    return fitted, np.linalg.inv(normal), np.maximum(noise, first)
