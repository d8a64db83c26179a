"""A smaller plate, for a quick look through the lens.

Blocks of pixels become one: colours are averaged, and of everything that may not be
mixed (depth, ids) the middle sample is taken. Blocks are counted from the corner of the
display window; incomplete blocks at its right and lower border are left out, so that
the frame may lose a part of a proxy's pixel there.
"""

from dataclasses import replace

import numpy as np

from lensfit.coords import Window
from lensfit.io.exr import ExrImage, ExrPart
from lensfit.plate.channels import colour_layers

MOST_PIXELS, MOST_PIXELS_OF_RAYS = 140_000, 60_000
"""Of an ideal lens, and of one whose blur is made of rays, which costs six times as
much a pixel."""
_MOST_FACTOR = 16


def proxy_factor(display: Window, most_pixels: int = MOST_PIXELS) -> int:
    """How many pixels of a plate lie along the side of one of its proxy; 1 where the
    plate is as small as a proxy."""
    factor = 1
    while display.area / factor**2 > most_pixels and factor < _MOST_FACTOR:
        factor *= 2
    return factor


def proxy_of(image: ExrImage, factor: int) -> ExrImage | None:
    """The plate with blocks of `factor` x `factor` pixels as one; None where a part has
    no whole block."""
    parts = [_smaller(part, factor) for part in image.parts]
    return None if None in parts else ExrImage(tuple(p for p in parts if p is not None))


def _smaller(part: ExrPart, factor: int) -> ExrPart | None:
    display, data = part.display_window, part.data_window
    low = [
        -(-(start - corner) // factor)
        for start, corner in zip(data[:2], display[:2], strict=True)
    ]
    high = [
        (end + 1 - corner) // factor - 1
        for end, corner in zip(data[2:], display[:2], strict=True)
    ]
    window = Window(*low, *high)
    if window.width < 1 or window.height < 1:
        return None
    left = low[0] * factor + display.x_min - data.x_min
    top = low[1] * factor + display.y_min - data.y_min
    rows = slice(top, top + window.height * factor)
    columns = slice(left, left + window.width * factor)
    mixed = {name for layer in colour_layers(part) for name in layer.names}
    channels = {
        name: (_mean if name in mixed else _middle)(samples[rows, columns], factor)
        for name, samples in part.channels.items()
    }
    size = Window.of_size(
        max(display.width // factor, 1), max(display.height // factor, 1)
    )
    return replace(part, channels=channels, data_window=window, display_window=size)


def _mean(samples: np.ndarray, factor: int) -> np.ndarray:
    rows, columns = (side // factor for side in samples.shape)
    blocks = samples.reshape(rows, factor, columns, factor).astype(np.float32)
    return blocks.mean(axis=(1, 3)).astype(samples.dtype)


def _middle(samples: np.ndarray, factor: int) -> np.ndarray:
    return np.ascontiguousarray(samples[factor // 2 :: factor, factor // 2 :: factor])
