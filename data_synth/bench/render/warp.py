"""The warp against `cv2.remap`: a frame with alpha through a map that bends."""

import cv2
import numpy as np

from data_synth.bench.rows import Row
from data_synth.bench.times import best
from lensfit.coords import Window
from lensfit.rendering.buffers import aligned_empty
from lensfit.rendering.uv import SourceMap
from lensfit.rendering.warp import warp


def warp_row(width: int, height: int) -> Row:
    """Seconds of one warp over those of `cv2.remap`, cubic, on the same pixels."""
    window = Window.of_size(width, height)
    y, x = np.mgrid[:height, :width].astype(np.float32)
    u, v = (x - width / 2) / width, (y - height / 2) / width
    bend = 0.04 * (u * u + v * v)
    moved = aligned_empty((2, height, width))
    moved[0], moved[1] = bend * u * width, bend * v * width
    pixels = aligned_empty((height, width, 4))
    pixels[:] = np.random.default_rng(0).random((height, width, 4), np.float32)
    source = SourceMap(window, moved)
    at_x, at_y = x + moved[0], y + moved[1]
    border = cv2.BORDER_CONSTANT
    _, theirs, _ = best(
        lambda: cv2.remap(pixels, at_x, at_y, cv2.INTER_CUBIC, borderMode=border)
    )
    warp(pixels, window, source, alpha_channel=3)
    _, ours, _ = best(lambda: warp(pixels, window, source, alpha_channel=3))
    peers = {"lensfit, s": ours, "cv2.remap, s": theirs}
    return Row(
        "uhd", "warp, times cv2.remap cubic", ours / theirs, bar=1.3, peers=peers
    )
