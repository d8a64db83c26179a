"""A lens in Cycles, by its camera shader: how near, and the same frame by lensfit.

What Cycles shows through the shader is compared with the lens itself: a chart beside
`lens.project`, an even sky beside `lens.relative_illumination`, and luminous discs of a
pixel beside `lens.psf`. Diffraction, which rays do not have, is far below these pixels.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float

from data_synth.bench.cycles.same_frame import SameFrame, same_frame
from data_synth.bench.cycles.shaded_lens import (
    Cycles,
    ShadedLens,
    require_blender,
    shaded_lens,
)
from data_synth.bench.render.benchmark import psnr_db
from data_synth.bench.result import Row
from lensfit.atomic import write_bytes_atomic
from lensfit.exchange.export_request import WantedState
from lensfit.exchange.samples import ExchangeFrame
from lensfit.lens import Channel
from lensfit.preset.schema import Preset
from lensfit.progress import Progress, silent

_CHANNELS: tuple[Channel, ...] = ("r", "g", "b")
_CHART_SAMPLES, _SKY_SAMPLES, _LIGHT_SAMPLES = 400, 64, 8192
_DOT_PX, _NEAR_PX = 4, 12
_CELL_PX = 30
_LIGHT_PX, _FINER, _ROOM_PX = 25, 3, 9
_POINTS = 19
"""That stand for a disc."""
_GOLDEN_RAD = 2.4
_ROUNDS = 20


class Light(NamedTuple):
    """A luminous disc of a pixel's radius.

    Attributes
    ----------
    at : Where its centre lands, in halves of the frame.
    distance_mm : From the sensor.
    """

    at: tuple[float, float]
    distance_mm: float


def chart_error_px(seen: ShadedLens) -> float:
    """The farthest that a dot of a chart in focus lies from its projection, px."""
    frame, focus_mm = seen.frame, seen.focus_mm
    share = np.stack(np.meshgrid([-0.42, -0.21, 0, 0.21, 0.42], [-0.42, 0, 0.42]), -1)
    to_scene = focus_mm / seen.principal_mm
    dots = share.reshape(-1, 2) * frame.area_mm * to_scene
    radius = _DOT_PX * frame.pitch_mm * to_scene
    discs = [[*dot, focus_mm, radius] for dot in dots.tolist()]
    picture = seen.picture(samples=_CHART_SAMPLES, discs=discs)
    objects = np.column_stack([dots, np.full(len(dots), focus_mm + seen.pupil_mm)])
    apart = []
    for number, channel in enumerate(_CHANNELS):
        wanted = frame.px(np.asarray(seen.lens.project(objects, channel)))
        found = [_centroid(picture[..., number], at) for at in wanted]
        apart.append(np.linalg.norm(np.array(found) - wanted, axis=-1).max())
    return float(max(apart))


def _centroid(picture: np.ndarray, at: np.ndarray) -> Float[np.ndarray, "2"]:
    """Of the light about a point of a black picture."""
    left, top = (at - _NEAR_PX).astype(int)
    window = np.s_[top : top + 2 * _NEAR_PX, left : left + 2 * _NEAR_PX]
    rows, columns = np.mgrid[window] + 0.5
    light = picture[window]
    return np.array([(light * part).sum() for part in (columns, rows)]) / light.sum()


def fall_off_error(seen: ShadedLens) -> float:
    """The worst relative error of an even sky, over cells of 30 pixels."""
    frame = seen.frame
    columns, rows = (n // _CELL_PX for n in frame.size_px)
    used = np.s_[: rows * _CELL_PX, : columns * _CELL_PX]

    def cells(picture: np.ndarray) -> np.ndarray:
        return picture[used].reshape(rows, _CELL_PX, columns, _CELL_PX).mean((1, 3))

    picture = seen.picture(samples=_SKY_SAMPLES, sky=1.0)
    width, height = frame.size_px
    y, x = np.mgrid[0:height, 0:width] + 0.5
    at_mm = frame.mm(np.column_stack([x.ravel(), y.ravel()]))
    worst = 0.0
    for number, channel in enumerate(_CHANNELS):
        light = np.asarray(seen.lens.relative_illumination(at_mm, channel))
        wanted = cells(light.reshape(height, width))
        apart = cells(picture[..., number]) / wanted - 1
        worst = max(worst, float(np.abs(apart).max()))
    return worst


def light_error(seen: ShadedLens, light: Light) -> float:
    """Relative difference (L2) of a light's picture from that of its
    point-spread functions, of the worst colour."""
    frame = seen.frame
    centre, radius = _object_of(seen, light)
    landed = frame.px(np.array([light.at]) * frame.area_mm / 2)[0]
    corner = np.floor(landed).astype(int) - _LIGHT_PX // 2
    region = [*corner.tolist(), *(corner + _LIGHT_PX).tolist()]
    x, y, distance_mm = centre
    picture = seen.picture(
        samples=_LIGHT_SAMPLES,
        discs=[[x, y, distance_mm - seen.pupil_mm, radius]],
        region=region,
    )
    apart = []
    for number, wanted in enumerate(_expected(seen, centre, radius, corner)):
        found = picture[..., number] / picture[..., number].sum()
        wanted = wanted / wanted.sum()
        apart.append(np.linalg.norm(found - wanted) / np.linalg.norm(wanted))
    return float(max(apart))


def _object_of(seen: ShadedLens, light: Light) -> tuple[np.ndarray, float]:
    """Place of a light in the scene, from the sensor, and its radius; mm."""
    wanted_mm = np.array(light.at) * seen.frame.area_mm / 2
    to_scene = (light.distance_mm - seen.pupil_mm) / seen.principal_mm
    point = np.array([*wanted_mm * to_scene, light.distance_mm])
    for _ in range(_ROUNDS):
        landed = np.asarray(seen.lens.project(point[None]))[0]
        point[:2] += (wanted_mm - landed) * to_scene
    return point, seen.frame.pitch_mm * to_scene


def _expected(
    seen: ShadedLens, centre: np.ndarray, radius: float, corner: np.ndarray
) -> Iterator[np.ndarray]:
    """The light's picture in each colour: point-spread functions over its disc."""
    frame, fine_px = seen.frame, _LIGHT_PX * _FINER
    number = np.arange(_POINTS)
    turn, reach = _GOLDEN_RAD * number, radius * np.sqrt((number + 0.5) / _POINTS)
    points = np.tile(centre, (_POINTS, 1))
    points[:, :2] += np.stack([reach * np.cos(turn), reach * np.sin(turn)], -1)
    chief = np.asarray(seen.lens.project(points))
    room = _LIGHT_PX + _ROOM_PX
    kernels = np.asarray(
        seen.lens.psfs(
            chief,
            float(centre[2]),
            pixel_pitch_mm=frame.pitch_mm / _FINER,
            size_px=room * _FINER,
        )
    )
    for channel in range(len(_CHANNELS)):
        light = np.zeros((fine_px, fine_px))
        for place, kernel in zip(frame.px(chief), kernels[:, channel], strict=True):
            shift = np.round((place - corner - room / 2) * _FINER).astype(int)
            rows, columns = (np.arange(fine_px) - n for n in shift[::-1])
            light += kernel[np.ix_(rows, columns)]
        yield light.reshape(_LIGHT_PX, _FINER, _LIGHT_PX, _FINER).sum((1, 3))


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
