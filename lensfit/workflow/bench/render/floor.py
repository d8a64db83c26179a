"""Warp and blur of a frame, beside the bytes and the operations they cannot avoid.

A warp reads every pixel and a displacement for it once, and writes every pixel once.
The blur transforms every tile of every level with its surroundings, some planes forth
and some back; filling, kernels' responses and laying over are not counted.
"""

from lensfit.coords import Window
from lensfit.render.defocus import levels_in
from lensfit.render.plan import transformed_planes
from lensfit.render.uv import SourceMap
from lensfit.render.warp import warp
from lensfit.workflow.bench.floor import Floor, Rates, best_seconds, fft_flops
from lensfit.workflow.bench.render.scenes import Scene
from lensfit.workflow.bench.warp import WarpTask

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


def blur_floor(scene: Scene, tolerance: float, seconds: float, rates: Rates) -> Floor:
    """Of a whole frame with depth of field.

    Parameters
    ----------
    seconds : Of the frame, in the steady state.
    """
    stages, output = scene.stages(tolerance), scene.display_window
    defocus = stages.defocus
    assert defocus is not None
    radius_px = defocus.circle.radius_px(scene.depth_mm)
    index = defocus.levels.index(radius_px)
    setup = defocus.setup(stages.window, levels_in(index, radius_px, defocus))
    planes = transformed_planes(radius_px, output, setup, defocus)
    needs = sum(2 * fft_flops(count, side) for side, count in planes.items())
    name = f"frame of {output.width} x {output.height}, its transforms"
    return Floor(name, needs, "flops", rates.fft_flops, seconds)
