"""What Cycles shows through a lens' shader, beside the lens itself.

A chart beside `lens.project`, an even sky beside `lens.relative_illumination`, and
luminous discs of a pixel beside `lens.psf`. Diffraction, which rays do not have, is far
below these pixels.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from data_synth.bench.cycles.shaded_lens import ShadedLens
from lensfit.lens import Channel

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
