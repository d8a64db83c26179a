"""Background correction of dot images, for many patches at once.

The background of a bright dot adds to its light and is subtracted. A dark dot reflects
the light that falls on it, so its image is divided by the background. In both cases
the background is fitted to a ring around the dot.
"""

from typing import NamedTuple

import numpy as np

from lensfit.detect.patches import Patches

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


def on_black(patch: Patches, ring: np.ndarray) -> Flattened:
    """Take off the light around a bright dot: it adds to the dot's own."""
    plane, covariance, noise = fitted_background(patch, patch.sharp, ring)
    background = plane.astype(np.float32) @ patch.design[:, :PLANE].T
    sharp, smooth = patch.sharp - background, patch.smooth - background
    return Flattened(sharp, smooth, plane, covariance, noise)


def on_white(patch: Patches, ring: np.ndarray, radius: np.ndarray) -> Flattened:
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
