"""The slow way, to judge the fast one by: a kernel of its own for every pixel.

`exact_block` spreads each pixel of one surface by the lens' kernel of that very place,
summed pixel by pixel: no grid of kernels, no levels, no tiles, nothing cut off. It
answers for a small block of output pixels at a time, since a kernel takes milliseconds.
"""

import numpy as np
from jaxtyping import Float, Float32

from lensfit.coords import Window
from lensfit.render.kernel_bank import KernelBank, KernelNeeds
from lensfit.render.plate_defocus import Defocus
from lensfit.render.uv import Channel

_TOGETHER = 96
_RAY_ERROR = 0.01


def exact_block(
    picture: Float32[np.ndarray, "height width"],
    radius_px: float,
    block: Window,
    defocus: Defocus,
    channel: Channel = "g",
) -> Float[np.ndarray, "rows columns"]:
    """A block of a picture whose one surface lies at a distance.

    Parameters
    ----------
    picture : One channel over the display window.
    radius_px : Of the circle of confusion, which stands for the distance.
    block : Pixels wanted, in the display window.
    """
    bank = exact_bank(defocus)
    level = defocus.levels.between(radius_px)
    middle = np.array([[block.x_min + block.width / 2, block.y_min + block.height / 2]])
    reach = bank.at(middle, level, (channel,)).shape[-1] // 2 + 1
    window = block.grown(reach, reach)
    sources = window.pixel_centres().reshape(-1, 2)
    light = np.zeros((block.height + 4 * reach, block.width + 4 * reach))
    known = np.zeros_like(light)
    for first in range(0, len(sources), _TOGETHER):
        points = sources[first : first + _TOGETHER]
        kernels = bank.at(points, level, (channel,))[:, 0]
        half = kernels.shape[-1] // 2
        for (x, y), kernel in zip(points, kernels, strict=True):
            column, row = int(x) - block.x_min, int(y) - block.y_min
            top, left = row + 2 * reach - half, column + 2 * reach - half
            at = np.s_[
                max(top, 0) : top + 2 * half + 1, max(left, 0) : left + 2 * half + 1
            ]
            part = kernel[max(-top, 0) :, max(-left, 0) :]
            part = part[: light[at].shape[0], : light[at].shape[1]]
            value = picture[
                np.clip(int(y), 0, picture.shape[0] - 1),
                np.clip(int(x), 0, picture.shape[1] - 1),
            ]
            light[at] += value * part
            known[at] += part
    inside = np.s_[
        2 * reach : 2 * reach + block.height, 2 * reach : 2 * reach + block.width
    ]
    return light[inside] / known[inside]


def exact_bank(defocus: Defocus) -> KernelBank:
    """Kernels as good as rays make them in reasonable time."""
    needs = KernelNeeds(2 * _RAY_ERROR, 1e-4)
    return KernelBank(
        defocus.lens, defocus.geometry, defocus.circle, defocus.levels, needs
    )
