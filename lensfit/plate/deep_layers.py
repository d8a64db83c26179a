"""A deep plate as layers, front to back: every sample that blurs separately is kept.

Samples of a pixel that blur alike are merged: they are composited, at the mean of their
inverse distances weighted by visible coverage. The k-th layer then holds the k-th
remaining sample of every pixel.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float32, Int

from lensfit.errors import ImageError
from lensfit.io.depth_channel import DepthMeaning, perpendicular_mm
from lensfit.io.exr_deep import DeepPart
from lensfit.rendering.layer_stack import LayerStack

Samples = tuple[
    Float32[np.ndarray, " samples"],
    Float32[np.ndarray, "samples 4"],
    Int[np.ndarray, " samples"],
]
"""Distance, colour, and which pixel, sorted by pixel and distance."""
_INFINITE = np.float32(np.inf)
_LEAST_SHOWN = np.float32(1e-6)


def deep_layers(
    part: DeepPart,
    meaning: DepthMeaning,
    slant: Float32[np.ndarray, "height width"] | float = 1.0,
    *,
    depth_channel: str | None = None,
    slab_of: Callable[[np.ndarray], np.ndarray] | None = None,
) -> LayerStack:
    """The layers of a deep plate.

    Parameters
    ----------
    part : With R, G, B (or Y), Z, and A unless every sample is opaque.
    meaning : What its Z says.
    slant : Length of the ray through each pixel to a plane at distance 1.
    depth_channel : Name of Z, if it has another one.
    slab_of : Number of the slab that distances (mm) lie in; those of one slab blur
        alike. None keeps every sample.

    Raises
    ------
    ImageError : It has no colour or no depth.
    """
    own = np.repeat(np.arange(part.counts.size), part.counts.ravel())
    slants = np.broadcast_to(slant, part.counts.shape).ravel()[own]
    depth = perpendicular_mm(_depth(part, depth_channel), meaning, slants)
    depth = np.where(np.isnan(depth), _INFINITE, depth)
    order = np.lexsort((depth, own))
    depth, rgba, own = depth[order], _colours(part)[order], own[order]
    if slab_of is not None and len(depth):
        depth, rgba, own = _joined((depth, rgba, own), slab_of(depth))
    rank = _rank_in(own)
    layers = int(rank.max(initial=0)) + 1
    size = part.counts.shape
    stack = np.zeros((layers, part.counts.size, 4), np.float32)
    away = np.full((layers, part.counts.size), _INFINITE)
    stack[rank, own], away[rank, own] = rgba, depth
    return LayerStack(stack.reshape(layers, *size, 4), away.reshape(layers, *size))


def _joined(samples: Samples, slab: np.ndarray) -> Samples:
    """One sample for each slab of each pixel."""
    depth, rgba, pixel = samples
    begins = np.ones(len(depth), bool)
    begins[1:] = (pixel[1:] != pixel[:-1]) | (slab[1:] != slab[:-1])
    group = np.cumsum(begins) - 1
    rank = _rank_in(group)
    joined = np.zeros((group[-1] + 1, 4), np.float32)
    weight = np.zeros(len(joined), np.float32)
    vergence = np.zeros(len(joined), np.float32)
    for k in range(int(rank.max()) + 1):
        at = rank == k
        into = group[at]
        shown = (1 - joined[into, 3:]) * rgba[at]
        share = shown[:, 3] + _LEAST_SHOWN
        joined[into] += shown
        weight[into] += share
        vergence[into] += share / depth[at]
    with np.errstate(divide="ignore"):
        return weight / vergence, joined, pixel[begins]


def _rank_in(group: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """Place of each in its group; groups are whole and in rising order."""
    return np.arange(len(group)) - np.searchsorted(group, group)


def _colours(part: DeepPart) -> Float32[np.ndarray, "samples 4"]:
    """Red, green, blue, alpha of every sample; opaque where there is no alpha."""
    total = int(part.counts.sum())
    rgba = np.ones((total, 4), np.float32)
    for names in (("R", "G", "B"), ("r", "g", "b"), ("Y", "Y", "Y")):
        if all(name in part.samples for name in names):
            for index, name in enumerate(names):
                rgba[:, index] = part.samples[name]
            break
    else:
        raise ImageError(
            "holds deep pixels without R, G, B",
            remedy=f"its channels are {', '.join(part.samples)}",
        )
    alpha = next((n for n in ("A", "a", "alpha") if n in part.samples), None)
    if alpha is not None:
        rgba[:, 3] = np.clip(part.samples[alpha], 0, 1)
    return rgba


def _depth(part: DeepPart, name: str | None) -> Float32[np.ndarray, " samples"]:
    """Middle of every sample."""
    name = name or "Z"
    if name not in part.samples:
        raise ImageError(
            f"holds deep pixels without {name}",
            remedy=f"its channels are {', '.join(part.samples)}",
        )
    front = part.samples[name].astype(np.float32)
    if name == "Z" and "ZBack" in part.samples:
        back = part.samples["ZBack"].astype(np.float32)
        return np.where(back > front, (front + back) / 2, front)
    return front
