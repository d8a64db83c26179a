"""Where the time of a frame goes: of an ideal lens, and of a preview of a fitted one.

Rays of an ideal lens are the same for every state of the camera. Those of a fitted lens
are made anew when a slider moves, so a preview pays for them with every picture.

Warp and blur stand beside the bytes that they cannot avoid. A warp reads every pixel
and a displacement for it once, and writes every pixel once. A frame with depth of field
reads colours and a distance and writes colours; that its rays read surfaces many times,
out of caches, is not counted.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from data_synth.bench.floor import Floor, Rates, best_seconds
from data_synth.bench.render.scenes import Scene, synthetic_scene
from data_synth.bench.result import Row
from data_synth.bench.sampler import sampled
from data_synth.bench.times import timed
from data_synth.bench.warp import SIZES, WarpTask, warp_task
from lensfit.coords import Window
from lensfit.preset.schema import Preset
from lensfit.preset.thin_lens import ThinCamera
from lensfit.rendering.uv import SourceMap
from lensfit.rendering.warp import warp

_TOLERANCE = 1e-3
_PREVIEW_TOLERANCE = 1e-2
_PREVIEW_SIZE = (480, 270)
_STEPS_OF_FOCUS = (1.0, 1.005, 1.01)
_FOCUS_OF_A_LENS = 40
"""In focal lengths, where the preset states none."""
_NEAREST, _FARTHEST = 0.6, 4.0
"""Depth of the scene of a preview, in focus distances."""
_FLOAT_BYTES = 4


class RenderProfile(NamedTuple):
    """Seconds by stage of each frame, distances from floors, rows without bars."""

    profiles: dict[str, dict[str, float]]
    floors: list[dict[str, Any]]
    rows: list[Row]


def render_profile(scene: Scene, rates: Rates, fitted: Preset | None) -> RenderProfile:
    """Of the plate through an ideal lens, and of previews of a fitted one."""
    _, times = timed(lambda: scene.render(_TOLERANCE))
    frame = sampled(lambda: scene.render(_TOLERANCE))
    floors = [
        warp_floor(warp_task(*SIZES["HD"]), rates).as_table() | {"set": "HD"},
        blur_floor(scene, times.steady_s, rates).as_table() | {"set": scene.name},
    ]
    profiles = {f"{scene.name}, a frame": frame.seconds}
    if fitted is None:
        return RenderProfile(profiles, floors, [])
    seconds, rows = _preview(fitted)
    return RenderProfile(profiles | {"a preview, focus moved": seconds}, floors, rows)


def _preview(fitted: Preset) -> tuple[dict[str, float], list[Row]]:
    """Pictures in this process, each with its own focus: the last one's stages, and
    their times."""
    entry = fitted.entries[0]
    focus_mm = entry.focus_distance_mm or math.inf
    if not math.isfinite(focus_mm):
        focus_mm = _FOCUS_OF_A_LENS * entry.focal_length_mm
    camera = ThinCamera(
        focal_length_mm=entry.focal_length_mm,
        f_number=2.0,
        focus_distance_m=focus_mm / 1000,
        sensor_width_mm=fitted.camera.sensor_width_mm,
        width_px=_PREVIEW_SIZE[0],
        height_px=_PREVIEW_SIZE[1],
    )
    plain = synthetic_scene(camera, *_PREVIEW_SIZE)
    near, far = (share * focus_mm for share in (_NEAREST, _FARTHEST))
    depth_mm = np.clip(plain.depth_mm, near, far)

    def frame(share: float) -> np.ndarray:
        scene = Scene(
            "preview",
            plain.rgb,
            depth_mm,
            plain.data_window,
            plain.display_window,
            fitted,
            share * focus_mm,
        )
        return scene.render(_PREVIEW_TOLERANCE)

    shares = iter(_STEPS_OF_FOCUS)
    _, times = timed(lambda: frame(next(shares)), len(_STEPS_OF_FOCUS) - 1)
    last = sampled(lambda: frame(next(shares)))
    width, height = _PREVIEW_SIZE
    what = f"{width} x {height} at {_PREVIEW_TOLERANCE:g}, focus moved, s"
    row = Row("fitted lens", what, times.steady_s, 1.0, 0.3, times.as_peers())
    return last.seconds, [row]


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
