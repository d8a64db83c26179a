"""How far a point-spread function is from the true one, after the best shift.

Relative L2, |shifted model - truth| / |truth| over whole pixels. The shift is a real
one of any fraction of a pixel: a phase ramp on the finely sampled model, which is then
summed to pixels, found by damped Gauss-Newton from where the centroids meet. Where the
light lands is judged by chief rays and lateral colour; this is the shape alone.
"""

import numpy as np
from jaxtyping import Float

STEPS = 12
CLOSE_ENOUGH = 1e-3
"""Samples; a smaller step changes nothing."""


def psf_error(
    truth: Float[np.ndarray, "size size"],
    model: Float[np.ndarray, "size size"],
    subpixels: int = 1,
) -> float:
    """Relative L2 of the model's shape; 1 for a model without light.

    Parameters
    ----------
    truth, model : Samples, `subpixels` of them to a pixel; each is scaled to sum to 1.
    """
    error, _ = best_shift(truth, model, subpixels)
    return error


def best_shift(
    truth: Float[np.ndarray, "size size"],
    model: Float[np.ndarray, "size size"],
    subpixels: int = 1,
) -> tuple[float, Float[np.ndarray, "2"]]:
    """The relative L2 and the shift of the model (rows, columns, in samples) for it."""
    total = float(model.sum())
    if not np.isfinite(model).all() or total <= 0:
        return 1.0, np.zeros(2)
    target = whole_pixels(truth / truth.sum(), subpixels)
    size = len(truth)
    waves = np.fft.rfft2(model / total)
    ramps = (
        -2j * np.pi * np.fft.fftfreq(size)[:, None],
        -2j * np.pi * np.fft.rfftfreq(size)[None, :],
    )

    def residual(shift):
        moved = waves * np.exp(ramps[0] * shift[0] + ramps[1] * shift[1])
        return moved, _back(moved, size, subpixels) - target

    start = centroid(truth) - centroid(model)
    norm, shift = _polished(residual, ramps, start, size, subpixels)
    return norm / float(np.linalg.norm(target)), shift


def _polished(residual, ramps, shift, size: int, subpixels: int):
    """Damped Gauss-Newton: the least norm of the residual, and its shift."""
    moved, gap = residual(shift)
    norm, damping = float(np.linalg.norm(gap)), 1e-3
    for _ in range(STEPS):
        slopes = np.stack(
            [_back(moved * ramp, size, subpixels).ravel() for ramp in ramps], -1
        )
        normal = slopes.T @ slopes
        normal += damping * np.diag(np.diag(normal) + 1e-30)
        step = -np.linalg.solve(normal, slopes.T @ gap.ravel())
        trial, trial_gap = residual(shift + step)
        trial_norm = float(np.linalg.norm(trial_gap))
        if trial_norm < norm:
            shift, moved, gap, norm = shift + step, trial, trial_gap, trial_norm
            damping /= 5
            if np.abs(step).max() < CLOSE_ENOUGH:
                break
        else:
            damping *= 10
    return norm, shift


def _back(waves, size: int, subpixels: int):
    return whole_pixels(np.fft.irfft2(waves, s=(size, size)), subpixels)


def whole_pixels(
    samples: Float[np.ndarray, "size size"], subpixels: int
) -> Float[np.ndarray, "pixels pixels"]:
    """Summed over `subpixels` x `subpixels` samples."""
    count = len(samples) // subpixels
    return samples.reshape(count, subpixels, count, subpixels).sum(axis=(1, 3))


def centroid(samples: Float[np.ndarray, "size size"]) -> Float[np.ndarray, "2"]:
    """Mean row and column of the light."""
    steps = np.arange(len(samples))
    rows, columns = samples.sum(axis=1), samples.sum(axis=0)
    return np.array([rows @ steps, columns @ steps]) / samples.sum()
