"""Warp and blur of a frame, beside the bytes and the operations they cannot avoid.

A warp reads every pixel and a displacement for it once, and writes every pixel once.
A frame with depth of field reads colours and a distance and writes colours; that its
rays read surfaces many times, out of caches, is not counted.
"""

from data_synth.bench.floor import Floor, Rates, best_seconds
from data_synth.bench.render.scenes import Scene
from data_synth.bench.warp import WarpTask
from lensfit.coords import Window
from lensfit.rendering.uv import SourceMap
from lensfit.rendering.warp import warp

_FLOAT_BYTES = 4


def warp_bytes(pixels: int, channels: int) -> float:
    """Read colours and a map of two numbers, write colours, all float32."""
    return float(_FLOAT_BYTES * pixels * (2 * channels + 2))


def warp_floor(task: WarpTask, rates: Rates) -> Floor:
    """Of lensfit's cubic filter on a picture of four channels."""
    height, width, channels = task.pixels.shape
    window = Window.of_size(width, height)
    source = SourceMap(window, task.moved_px)
    seconds = best_seconds(
        lambda: warp(task.pixels, window, source, method="cubic", alpha_channel=3)
    )
    needs = warp_bytes(width * height, channels)
    return Floor("warp", needs, "bytes", rates.bytes, seconds)


def blur_floor(scene: Scene, seconds: float, rates: Rates) -> Floor:
    """Of a whole frame with depth of field.

    Parameters
    ----------
    seconds : Of the frame, in the steady state.
    """
    output = scene.display_window
    pixels = output.width * output.height
    needs = warp_bytes(pixels, 4) + _FLOAT_BYTES * pixels
    name = f"frame of {output.width} x {output.height}"
    return Floor(name, needs, "bytes", rates.bytes, seconds)
