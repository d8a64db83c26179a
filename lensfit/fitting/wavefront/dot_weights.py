"""Weights of the cells of a photograph: inverse variance times a robust weight.

The variance of a cell is read noise, shot noise (proportional to light, its factor
estimated from the residuals of a fit), and a small share of the dot's own peak, which
stands for the model's own error. Without the last a bright, sharp dot would dominate
every blurred one. A dot whose misfit is much larger than that of the others in its
photograph loses weight (IRLS with Cauchy's loss). A clipped cell is at least as bright
as recorded: it counts only where the model is darker than that.
"""

import itertools

import numpy as np
from jaxtyping import Float
from scipy.optimize import nnls

from lensfit.fitting.wavefront.dot_arrays import show_edges
from lensfit.fitting.wavefront.dot_data import DotData

MODEL_SHARE = 0.02
_OF_EDGES = 0.2
"""Errors of a blur nearly cancel across an edge, which is the sum of many points."""
_LEAST_SHARE = 1e-4
_CAUCHY = 3.0
_BINS = 12


def initial_weights(
    dot_data: DotData, share: float
) -> Float[np.ndarray, "dots 3 rows columns"]:
    """Before any fit: read noise and a share of every dot's peak."""
    usable = dot_data.valid & ~dot_data.clipped
    return usable / _floor(dot_data, share)[..., None, None]


def robust_weights(
    dot_data: DotData,
    residual: Float[np.ndarray, "dots 3 rows columns"],
    background: Float[np.ndarray, "dots 3"],
    share: float,
) -> Float[np.ndarray, "dots 3 rows columns"]:
    """Weights from the residuals of a fit, photograph minus model."""
    noise = noise_variances(dot_data, residual, background)
    variance = noise + _missed_variance(dot_data, share)[..., None, None]
    dark = dot_data.clipped & (residual > 0)
    usable = dot_data.valid & (~dot_data.clipped | dark)
    weight = usable / variance
    return weight * _cauchy_weight(dot_data, residual, weight)[..., None, None]


def noise_variances(
    dot_data: DotData,
    residual: Float[np.ndarray, "dots 3 rows columns"],
    background: Float[np.ndarray, "dots 3"],
) -> Float[np.ndarray, "dots 3 rows columns"]:
    """Read noise and shot noise of every cell, from the residuals of a fit."""
    modelled = dot_data.light - residual
    signal = np.abs(modelled - background[..., None, None])
    found = np.empty_like(signal)
    for k in range(len(dot_data.photographs)):
        mine = dot_data.take == k
        shot = _shot_factor(residual[mine], signal[mine], dot_data.valid[mine])
        read = dot_data.read_noise[mine][..., None, None] ** 2
        found[mine] = read + shot * signal[mine]
    return found


def missed_factor(dot_data: DotData) -> Float[np.ndarray, " dots"]:
    """How much a model misses of each contrast, over what it misses of a dot."""
    return np.where(show_edges(dot_data.dots), _OF_EDGES, 1.0)


def relative_misfit(
    dot_data: DotData,
    residual: Float[np.ndarray, "dots 3 rows columns"],
    background: Float[np.ndarray, "dots 3"],
) -> Float[np.ndarray, "dots 3"]:
    """Relative L2 error of every dot's image; NaN for a channel without cells."""
    use = dot_data.valid & ~dot_data.clipped
    signal = (dot_data.light - background[..., None, None]) * use
    square = np.sum(signal**2, (-2, -1))
    error = np.sum((residual * use) ** 2, (-2, -1))
    return np.sqrt(error / np.where(square > 0, square, np.nan))


def _floor(dot_data: DotData, share: float) -> Float[np.ndarray, "dots 3"]:
    """Variance of a cell without light: read noise, and the model's error."""
    return dot_data.read_noise**2 + _missed_variance(dot_data, share)


def _missed_variance(dot_data: DotData, share: float) -> Float[np.ndarray, "dots 3"]:
    """Of the model's error, a share of the contrast of a dot or an edge."""
    flat = dot_data.light.reshape(*dot_data.light.shape[:2], -1)
    peak = np.abs(flat - np.median(flat, -1, keepdims=True)).max(-1)
    missed = missed_factor(dot_data)[:, None] * peak
    missed = np.maximum(missed, _LEAST_SHARE * max(float(flat.max()), 1e-12))
    return (share * missed) ** 2


def _shot_factor(residual, signal, valid) -> float:
    """Variance per unit of light, from medians of squares over bins of light."""
    square, light = residual[valid] ** 2, signal[valid]
    edges = np.quantile(light, np.linspace(0, 1, _BINS + 1))
    rows = []
    for low, high in itertools.pairwise(edges):
        inside = (light >= low) & (light <= high)
        if inside.sum() > 20:
            rows.append((np.mean(light[inside]), np.median(square[inside]) / 0.455))
    if len(rows) < 3:
        return 0.0
    mean, variance = np.array(rows).T
    scale = max(float(variance.max()), 1e-30)
    design = np.stack([np.ones_like(mean), mean, mean**2], -1)
    size = np.maximum(np.abs(design).max(0), 1e-30)
    found, _ = nnls(design / size, variance / scale)
    return float(found[1] / size[1] * scale)


def _cauchy_weight(dot_data: DotData, residual, weight) -> np.ndarray:
    """Robust weight of every dot and channel: misfit over its photograph's median."""
    count = np.maximum(np.sum(weight > 0, (-2, -1)), 1)
    misfit = np.sqrt(np.sum(weight * residual**2, (-2, -1)) / count)
    cauchy_weight = np.ones_like(misfit)
    for k in range(len(dot_data.photographs)):
        mine = dot_data.take == k
        usual = np.median(misfit[mine], 0, keepdims=True)
        ratio = misfit[mine] / np.maximum(usual, 1e-12)
        cauchy_weight[mine] = 1 / (1 + (np.maximum(ratio - 1, 0) / _CAUCHY) ** 2)
    return cauchy_weight
