"""A deep plate as layers, front to back.

The k-th layer holds the k-th sample of every pixel. A pixel with more samples than
there are layers has those joined that are closest in inverse distance, which is what
blur knows: one over the other, at the mean of their distances weighed by what each
shows.
"""

import numpy as np
from jaxtyping import Float32, Int

from lensfit.errors import ImageError
from lensfit.io.depth import DepthMeaning, perpendicular_mm
from lensfit.io.exr_deep import DeepPart
from lensfit.render.layer_stack import LayerStack

MOST_LAYERS = 8
_INFINITE = np.float32(np.inf)


def deep_layers(
    part: DeepPart,
    meaning: DepthMeaning,
    slant: Float32[np.ndarray, "height width"] | float = 1.0,
    *,
    depth_channel: str | None = None,
    most_layers: int = MOST_LAYERS,
) -> LayerStack:
    """The layers of a deep plate.

    Parameters
    ----------
    part : With R, G, B (or Y), Z, and A unless every sample is opaque.
    meaning : What its Z says.
    slant : Length of the ray through each pixel to a plane at distance 1.
    depth_channel : Name of Z, if it has another one.
    most_layers : As many at most.

    Raises
    ------
    ImageError : It has no colour or no depth.
    """
    own = np.repeat(np.arange(part.counts.size), part.counts.ravel())
    slants = np.broadcast_to(slant, part.counts.shape).ravel()[own]
    depth = perpendicular_mm(_depth(part, depth_channel), meaning, slants)
    depth = np.where(np.isnan(depth), _INFINITE, depth)
    rgba = _colours(part)
    order = np.lexsort((depth, own))
    depth, rgba = depth[order], rgba[order]
    counts = part.counts.ravel()
    while counts.max(initial=0) > most_layers:
        depth, rgba, counts = _joined(depth, rgba, counts, most_layers)
    rank = np.arange(len(depth)) - np.repeat(np.cumsum(counts) - counts, counts)
    pixel = np.repeat(np.arange(counts.size), counts)
    layers = max(int(counts.max(initial=0)), 1)
    size = part.counts.shape
    stack = np.zeros((layers, counts.size, 4), np.float32)
    away = np.full((layers, counts.size), _INFINITE)
    stack[rank, pixel], away[rank, pixel] = rgba, depth
    return LayerStack(stack.reshape(layers, *size, 4), away.reshape(layers, *size))


def _joined(
    depth: Float32[np.ndarray, " samples"],
    rgba: Float32[np.ndarray, "samples 4"],
    counts: Int[np.ndarray, " pixels"],
    most: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """One pair of samples less in every pixel that has too many."""
    pixel = np.repeat(np.arange(counts.size), counts)
    with np.errstate(divide="ignore"):
        vergence = 1 / depth
    gap = np.append(vergence[:-1] - vergence[1:], 0)
    last = np.append(pixel[:-1] != pixel[1:], True)
    pairs = np.flatnonzero(~last & (counts[pixel] > most))
    order = pairs[np.lexsort((gap[pairs], pixel[pairs]))]
    front = order[np.unique(pixel[order], return_index=True)[1]]
    a, b = rgba[front], rgba[front + 1]
    shown = (1 - a[:, 3:]) * b
    weight = np.stack([a[:, 3], shown[:, 3]], -1) + np.float32(1e-6)
    near, far = vergence[front], vergence[front + 1]
    mean = (weight[:, 0] * near + weight[:, 1] * far) / weight.sum(-1)
    rgba, depth = rgba.copy(), depth.copy()
    rgba[front] = a + shown
    with np.errstate(divide="ignore"):
        depth[front] = 1 / mean
    fewer = counts.copy()
    fewer[pixel[front]] -= 1
    return np.delete(depth, front + 1), np.delete(rgba, front + 1, 0), fewer


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
