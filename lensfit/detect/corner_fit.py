"""Sub-pixel position of a checker corner by fitting what a blurred one looks like.

Two edges cross; each is a step blurred by the lens and the pixel, so that the light
about the corner is

    (a + gx u + gy v) (1 + m erf(d1 / s) erf(d2 / s)),

with d1, d2 the distances from the two edges, s the blur (sqrt 2 times its standard
deviation), m the contrast and a, gx, gy the illumination. Position, both directions,
blur, contrast and illumination are found together by damped Gauss-Newton steps, for
all corners at once, on the pixels of a window inside the four squares. The covariance
is that of the fit with its own residuals as noise.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import erf

_HALF_WIDTH_PX = 7, 24
"""Of the window at most: of sharp corners, and of blurred ones."""
_BLURS = 3.0
"""Half the window over the standard deviation of the blur, where it is wide: narrower
windows see no plateau, and take what is lopsided of an edge for its place."""
WINDOW_PER_SQUARE = 0.4
"""Half width of the window along each lattice direction, in squares."""
STEPS = 20
ENOUGH = 1e-7
"""A step that lowers the sum of squares by less than this part is the last."""
BLUR_PX = (0.5, 16.0)
FEWEST_PIXELS = 20
PARAMETERS = 9


class CornerFit(NamedTuple):
    """Fitted corners; NaN where the fit did not settle; blur is a deviation."""

    points_px: Float[np.ndarray, "corners 2"]
    covariance_px2: Float[np.ndarray, "corners 2 2"]
    white: Float[np.ndarray, " corners"]
    contrast: Float[np.ndarray, " corners"]
    highest: Float[np.ndarray, " corners"]
    blur_px: Float[np.ndarray, " corners"]
    settled: Bool[np.ndarray, " corners"]


class _Patches(NamedTuple):
    values: Float[np.ndarray, "corners pixels"]
    u_px: Float[np.ndarray, "corners pixels"]
    v_px: Float[np.ndarray, "corners pixels"]
    weight: Float[np.ndarray, "corners pixels"]


def fit_corners(
    image: Float[np.ndarray, "height width"],
    starts_px: Float[np.ndarray, "corners 2"],
    steps_px: Float[np.ndarray, "corners 2 2"],
    window_per_square: float = WINDOW_PER_SQUARE,
) -> CornerFit:
    """Fit all corners of a board in one channel, once more where blur is wide.

    Parameters
    ----------
    image : Samples, channel units.
    starts_px : First positions, good to a pixel or two.
    steps_px : Lattice steps at each corner: row 0 along i, row 1 along j, pixels.
    window_per_square : Half width of the window along each step, in squares.
    """
    given = image, starts_px, steps_px, window_per_square
    found = _fit_corners(*given, _HALF_WIDTH_PX[0])
    if not found.settled.any():
        return found
    wanted_px = half_width_px(found.blur_px[found.settled])
    return found if wanted_px == _HALF_WIDTH_PX[0] else _fit_corners(*given, wanted_px)


def half_width_px(blur_px: Float[np.ndarray, " corners"]) -> int:
    """Half the window of corners whose edges are so blurred."""
    wanted_px = int(np.ceil(_BLURS * np.median(blur_px)))
    return int(np.clip(wanted_px, *_HALF_WIDTH_PX))


def _fit_corners(
    image: Float[np.ndarray, "height width"],
    starts_px: Float[np.ndarray, "corners 2"],
    steps_px: Float[np.ndarray, "corners 2 2"],
    window_per_square: float,
    half_width_px: int,
) -> CornerFit:
    """Fit corners within a window."""
    known = np.isfinite(steps_px).all((1, 2)) & (np.abs(np.linalg.det(steps_px)) > 1)
    steps_px = np.where(known[:, None, None], steps_px, 1e-3 * np.eye(2))
    patches = _patches_around(
        image, starts_px, steps_px, window_per_square, half_width_px
    )
    parameters = _first_guess(patches, steps_px)
    damping = np.full(len(starts_px), 1e-3)
    cost = _cost(patches, parameters)
    for _ in range(STEPS):
        jacobian, residual = _weighted_linear_model(patches, parameters)
        normal = np.einsum("npi,npj->nij", jacobian, jacobian)
        slope = np.einsum("npi,np->ni", jacobian, residual)
        scale = np.einsum("nii->ni", normal) + 1e-12
        damped = normal + (damping[:, None] * scale)[..., None] * np.eye(PARAMETERS)
        trial = parameters + np.linalg.solve(damped, slope[..., None])[..., 0]
        trial[:, 4] = np.clip(trial[:, 4], *np.log(BLUR_PX))
        trial_cost = _cost(patches, trial)
        better = trial_cost <= cost
        gain = np.where(better, cost - trial_cost, 0.0)
        resting = (gain <= ENOUGH * cost) & better
        parameters = np.where(better[:, None], trial, parameters)
        cost = np.where(better, trial_cost, cost)
        damping = np.where(better, damping / 5, damping * 5).clip(1e-9, 1e6)
        if (resting | (damping >= 1e6)).all():
            break
    return _outcome(patches, parameters, cost, starts_px)


def _patches_around(
    image: np.ndarray,
    starts: np.ndarray,
    steps: np.ndarray,
    window_per_square: float,
    half_width_px: int,
) -> _Patches:
    """Pixels about each corner; weight 1 inside its window, 0 outside."""
    height, width = image.shape
    reach = half_width_px + 1
    dv, du = np.mgrid[-reach : reach + 1, -reach : reach + 1].reshape(2, -1)
    columns = np.floor(starts[:, :1]).astype(int) + du
    rows = np.floor(starts[:, 1:]).astype(int) + dv
    u = columns + 0.5 - starts[:, :1]
    v = rows + 0.5 - starts[:, 1:]
    squares = np.stack([u, v], -1) @ np.linalg.inv(steps)
    inside = (np.abs(squares) <= window_per_square).all(-1)
    inside &= np.maximum(np.abs(u), np.abs(v)) <= half_width_px
    inside &= (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
    values = image[np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)]
    return _Patches(values.astype(float), u, v, inside.astype(float))


def _first_guess(patches: _Patches, steps: np.ndarray) -> np.ndarray:
    """x, y, both edge directions, log blur, illumination a, gx, gy and contrast m."""
    count = np.maximum(patches.weight.sum(1), 1)
    mean = (patches.weight * patches.values).sum(1) / count
    direction = np.arctan2(steps[..., 1], steps[..., 0])
    parameters = np.zeros((len(steps), PARAMETERS))
    parameters[:, 2:4] = direction
    parameters[:, 4] = np.log(1.5)
    parameters[:, 5] = mean
    _, first, second = _edges(patches, parameters)
    shape = first * second * patches.weight
    contrast = (shape * patches.values).sum(1) / np.maximum((shape**2).sum(1), 1e-12)
    parameters[:, 8] = contrast / np.maximum(mean, 1e-12)
    return parameters


def _edges(
    patches: _Patches, parameters: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Signed distances from both edges over the blur, and the steps across them."""
    x, y, angle1, angle2, log_blur = parameters[:, :5].T[..., None]
    du, dv = patches.u_px - x, patches.v_px - y
    distance = np.stack(
        [dv * np.cos(angle) - du * np.sin(angle) for angle in (angle1, angle2)]
    ) / np.exp(log_blur)
    return distance, erf(distance[0]), erf(distance[1])


def _cost(patches: _Patches, parameters: np.ndarray) -> np.ndarray:
    _, first, second = _edges(patches, parameters)
    a, gx, gy, contrast = parameters[:, 5:].T[..., None]
    light = a + gx * patches.u_px + gy * patches.v_px
    residual = patches.values - light * (1 + contrast * first * second)
    return (patches.weight * residual**2).sum(1)


def _weighted_linear_model(
    patches: _Patches, parameters: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of the model by its parameters, and values minus model; weighted."""
    distance, first, second = _edges(patches, parameters)
    x, y, angle1, angle2, log_blur = parameters[:, :5].T[..., None]
    a, gx, gy, contrast = parameters[:, 5:].T[..., None]
    du, dv = patches.u_px - x, patches.v_px - y
    light = a + gx * patches.u_px + gy * patches.v_px
    slope = 2 / np.sqrt(np.pi) * np.exp(-(distance**2))
    by_first = light * contrast * second * slope[0]
    by_second = light * contrast * first * slope[1]
    blur = np.exp(log_blur)
    sin1, cos1 = np.sin(angle1), np.cos(angle1)
    sin2, cos2 = np.sin(angle2), np.cos(angle2)
    profile = 1 + contrast * first * second
    jacobian = np.stack(
        [
            (by_first * sin1 + by_second * sin2) / blur,
            -(by_first * cos1 + by_second * cos2) / blur,
            -by_first * (dv * sin1 + du * cos1) / blur,
            -by_second * (dv * sin2 + du * cos2) / blur,
            -by_first * distance[0] - by_second * distance[1],
            profile,
            profile * patches.u_px,
            profile * patches.v_px,
            light * first * second,
        ],
        -1,
    )
    weight = patches.weight
    residual = patches.values - light * profile
    return jacobian * weight[..., None], residual * weight


def _outcome(
    patches: _Patches, parameters: np.ndarray, cost: np.ndarray, starts: np.ndarray
) -> CornerFit:
    """Positions with the covariance of the fit, NaN where it did not settle."""
    jacobian, _ = _weighted_linear_model(patches, parameters)
    normal = np.einsum("npi,npj->nij", jacobian, jacobian)
    scale = 1 / np.sqrt(np.einsum("nii->ni", normal) + 1e-30)
    scaled = normal * scale[:, :, None] * scale[:, None, :]
    inverse = np.linalg.pinv(scaled, hermitian=True)
    inverse = inverse * scale[:, :, None] * scale[:, None, :]
    count = patches.weight.sum(1)
    noise = cost / np.maximum(count - PARAMETERS, 1)
    reach = np.sqrt(count) / 4
    settled = (count >= FEWEST_PIXELS) & (np.abs(parameters[:, 8]) > 0.02)
    settled &= np.linalg.norm(parameters[:, :2], axis=1) < np.maximum(reach, 1)
    bad = ~settled[:, None]
    highest = np.where(patches.weight > 0, patches.values, -np.inf).max(1)
    return CornerFit(
        points_px=np.where(bad, np.nan, starts + parameters[:, :2]),
        covariance_px2=np.where(
            bad[..., None], np.nan, inverse[:, :2, :2] * noise[:, None, None]
        ),
        contrast=parameters[:, 8],
        white=parameters[:, 5] * (1 + np.abs(parameters[:, 8])),
        highest=highest,
        blur_px=np.exp(parameters[:, 4]) / np.sqrt(2),
        settled=settled,
    )
