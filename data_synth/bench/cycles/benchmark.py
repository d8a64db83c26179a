"""A lens in Cycles, by its camera shader: how near, and the same frame by lensfit."""

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from data_synth.bench.cycles.against_lens import (
    Light,
    chart_error_px,
    fall_off_error,
    light_error,
)
from data_synth.bench.cycles.cycles_picture import Cycles, require_blender
from data_synth.bench.cycles.same_frame import SameFrame, same_frame
from data_synth.bench.cycles.shaded_lens import ShadedLens, shaded_lens
from data_synth.bench.render.benchmark import psnr_db
from data_synth.bench.rows import Row
from lensfit.atomic import write_bytes_atomic
from lensfit.exchange.export_request import WantedState
from lensfit.exchange.samples import ExchangeFrame
from lensfit.preset.schema import Preset
from lensfit.progress import Progress, silent

CHART_BAR_PX, LIGHT_BAR, FALL_OFF_BAR = 0.05, 0.1, 0.01
PICTURE = "cycles.jpg"
_WIDTH_PX, _ROW_PX = 400, 30
"""Of the frame that is compared with the lens: cells of the fall-off fill it."""
_FRAME_PX = (480, 270)
_STOPPED_DOWN = 4.0
"""Of the f-number: coma moves a dot's centroid off its chief ray."""
_FINE = 8
"""Pixels of a light in focus for each of the others."""
_STEPS = 4
_FRAME_SAMPLES = 512
"""Of a pixel of the frame, twice."""
_GAIN, _GREY, _GAMMA, _QUALITY = 4.0, 0.5, 2.2, 88


def bench_cycles(
    preset: Preset,
    state: WantedState,
    python: str,
    out_dir: str | Path | None = None,
    *,
    progress: Progress = silent,
) -> list[Row]:
    """Chart, lights, fall-off and a frame.

    Parameters
    ----------
    state : Of the lens; the chart is photographed stopped down.
    python : Interpreter that has `bpy`.
    out_dir : Folder for the pictures of the frame, side by side; none if None.

    Raises
    ------
    LensfitError : Blender does not run, or the preset does not reach the state.
    """
    require_blender(python)
    camera, width_mm = preset.camera, preset.camera.sensor_width_mm
    height = int(_WIDTH_PX * camera.sensor_height_mm / width_mm / _ROW_PX)
    small = Cycles(python, ExchangeFrame((_WIDTH_PX, height * _ROW_PX), width_mm))
    rows: list[Row] = []
    progress("Cycles", 0, _STEPS)
    with shaded_lens(preset, _chart_state(preset, state), small) as seen:
        what = f"worst of 15 dots, f/{seen.state[1]:g}, px"
        rows.append(Row("chart", what, chart_error_px(seen), CHART_BAR_PX))
    progress("Cycles", 1, _STEPS)
    with shaded_lens(preset, state, small) as seen:
        rows += _light_rows(seen)
        progress("Cycles", 2, _STEPS)
        what = f"even sky, f/{seen.state[1]:g}, relative"
        rows.append(Row("fall-off", what, fall_off_error(seen), FALL_OFF_BAR))
    progress("Cycles", 3, _STEPS)
    frame = Cycles(python, ExchangeFrame(_FRAME_PX, width_mm))
    with shaded_lens(preset, state, frame) as seen:
        found = same_frame(seen, _FRAME_SAMPLES)
    progress("Cycles", _STEPS, _STEPS)
    if out_dir is not None:
        write_bytes_atomic(Path(out_dir) / PICTURE, side_by_side(found))
    return [*rows, frame_row(found)]


def _chart_state(preset: Preset, state: WantedState) -> WantedState:
    stop = preset.at(*state).f_number
    return state if stop is None else state._replace(f_number=stop * _STOPPED_DOWN)


def _light_rows(seen: ShadedLens) -> Iterator[Row]:
    """In focus on finer pixels, which resolve it; behind the focus and before it."""
    focus_mm = seen.focus_mm + seen.pupil_mm
    fine = seen.on_finer_pixels(_FINE)
    lights = {
        f"in focus, {_FINE} times finer": (fine, Light((0.5, 0.6), focus_mm)),
        "1.3 times the focus distance": (seen, Light((0.6, 0.5), 1.3 * focus_mm)),
        ".85 times the focus distance": (seen, Light((0.5, -0.6), 0.85 * focus_mm)),
    }
    for where, (lens, light) in lights.items():
        yield Row("light", f"{where}, relative L2", light_error(lens, light), LIGHT_BAR)


def frame_row(found: SameFrame) -> Row:
    """PSNR of what `lensfit apply` makes of the flat plate; no bar is stated."""
    others = {
        "its layers": found.by_layers,
        "no defocus": found.sharp,
        "the plate": found.plate,
    }
    peers = {name: psnr_db(one, found.by_cycles) for name, one in others.items()}
    peers["a frame without fault"] = found.noise_db
    value = psnr_db(found.by_apply, found.by_cycles)
    return Row("frame", "lensfit apply, PSNR, dB", value, peers=peers, least=True)


def side_by_side(found: SameFrame) -> bytes:
    """JPEG: by Cycles, by `lensfit apply`; below them the plate, and four times the
    difference of both on grey."""
    cycles, ours, plate = (
        np.clip(one, 0, 1) for one in (found.by_cycles, found.by_apply, found.plate)
    )
    apart = np.clip(_GREY + _GAIN * (ours - cycles), 0, 1)
    shown = [one ** (1 / _GAMMA) for one in (cycles, ours, plate)] + [apart]
    sheet = np.vstack([np.hstack(shown[:2]), np.hstack(shown[2:])])
    pixels = np.ascontiguousarray(np.round(255 * sheet).astype(np.uint8)[..., ::-1])
    _, buffer = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return buffer.tobytes()
