"""Overscan for a shot: the largest that any state of the lens in a range needs.

Between measured states the lens is interpolated, so that the largest need may lie
between them: each range is evaluated at its ends, at the measured states inside and at
steps between.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lensfit.coords import Window
from lensfit.errors import ImageError, PresetError
from lensfit.exchange.stmaps import LARGEST_SIDE_PX
from lensfit.plate.pixel_shape import SQUARE, pixel_shape
from lensfit.preset.knobs import Knobs
from lensfit.preset.scaled_look import (
    UNSCALED,
    ScaledLook,
    scaled_look,
    spanned_width_note,
)
from lensfit.preset.schema import Preset
from lensfit.rendering.circle import Circle
from lensfit.rendering.filters import Filter
from lensfit.rendering.overscan import (
    CgCamera,
    Margins,
    cg_camera,
    margins_read,
    overscan_factor,
)
from lensfit.rendering.uv import Channel, PlateGeometry, SpannedWidth
from lensfit.units import MILLIMETRES_PER_METRE, dioptres_from_mm

if TYPE_CHECKING:
    from lensfit.lens import Lens

_STEPS = 4
"""Parts of the way between two states that are tried."""

Span = tuple[float, float]


@dataclass(frozen=True)
class OverscanQuestion:
    """What the CG is rendered for.

    Attributes
    ----------
    size_px : Width and height of the frame.
    sensor_width_mm : Width that it spans; the preset's own if None.
    focal_length_mm, focus_distance_mm : Ranges; None is all that was measured.
    f_number : For depth of field; None leaves it out.
    nearest_mm : Nearest object from the sensor; None counts what lies beyond focus.
    method : Filter of the warp.
    knobs : Adjustments of the lens; None keeps those of the preset.
    pixel_aspect : As pixels are displayed, where the user or a header states it.
    scale_to_sensor : Put the look on focal lengths and a sensor that it was not
        measured at (see `preset.scaled_look`).
    """

    size_px: tuple[int, int]
    sensor_width_mm: float | None = None
    focal_length_mm: Span | None = None
    focus_distance_mm: Span | None = None
    f_number: float | None = None
    nearest_mm: float | None = None
    method: Filter = "cubic"
    knobs: Knobs | None = None
    pixel_aspect: float | None = None
    scale_to_sensor: bool = False


class _LensState(NamedTuple):
    """One that is tried: as measured, and how it stands for the CG camera's."""

    focal_length_mm: float | None
    focus_distance_mm: float | None
    scaled: ScaledLook


@dataclass(frozen=True)
class OverscanPlan:
    """The answer.

    Attributes
    ----------
    margins, camera : Without depth of field.
    channels : Margins of each colour channel alone.
    factor : Of OpenLensIO.
    blur_px : Radius of the widest blur; None when no f-number was given or known.
    with_blur, blur_camera : What depth of field makes of margins and camera.
    states : How many states of the lens were tried.
    notes : Where the preset was stretched.
    """

    margins: Margins
    camera: CgCamera
    channels: dict[Channel, Margins]
    factor: float
    blur_px: float | None
    with_blur: Margins | None
    blur_camera: CgCamera | None
    states: int
    notes: tuple[str, ...]


def plan_overscan(preset: Preset, question: OverscanQuestion) -> OverscanPlan:
    """The overscan that a render needs, over all states requested.

    Raises
    ------
    PresetError : The preset does not reach a state, or nobody knows the focus distance
        of the depth of field.
    ImageError : The frame has no size, or the sensor none or one that the lens is not
        known over, or the f-number is none.
    """
    _check(question)
    display = Window.of_size(*question.size_px)
    measured_mm, sensor_mm = preset.camera.sensor_width_mm, question.sensor_width_mm
    sensor_mm = measured_mm if sensor_mm is None else sensor_mm
    states = _states(preset, question)
    widths_mm, width_notes = _widths_mm(states, sensor_mm, measured_mm)
    shape = pixel_shape(preset, display, widths_mm[0], SQUARE, question.pixel_aspect)
    cg_mm = SpannedWidth(sensor_mm, shape.ratio)
    none = Margins(0, 0, 0, 0)
    channels: dict[Channel, Margins] = {"r": none, "g": none, "b": none}
    factor, blur_px, blurred = 1.0, None, none
    notes: dict[str, None] = dict.fromkeys(_focus_notes(preset, question))
    for (focal, focus, scaled), width_mm in zip(states, widths_mm, strict=True):
        spanned_mm = SpannedWidth(width_mm, shape.ratio)
        notes |= dict.fromkeys(preset.select(focal, None, focus).notes)
        lens = preset.at(focal, question.f_number, focus, knobs=question.knobs)
        factor = max(factor, overscan_factor(lens, display, sensor_width_mm=spanned_mm))
        for channel in channels:
            found = _margins(lens, display, spanned_mm, question, channel)
            channels[channel] = channels[channel].joined(found)
        if question.f_number is not None:
            nearest = question.nearest_mm
            nearest = None if nearest is None else nearest / scaled.distances
            radius = _blur_px(lens, display, spanned_mm, nearest)
            blur_px = max(blur_px or 0.0, radius)
            found = _margins(lens, display, spanned_mm, question, None, radius)
            blurred = blurred.joined(found)
    all_channels = channels["r"].joined(channels["g"]).joined(channels["b"])
    return OverscanPlan(
        margins=all_channels,
        camera=_camera(all_channels, display, cg_mm),
        channels=channels,
        factor=factor,
        blur_px=blur_px,
        with_blur=None if blur_px is None else blurred,
        blur_camera=None if blur_px is None else _camera(blurred, display, cg_mm),
        states=len(states),
        notes=(*notes, *width_notes, *filter(None, (shape.note,))),
    )


def _camera(margins: Margins, display: Window, spanned_mm: SpannedWidth) -> CgCamera:
    """The camera, whose film back is as high as its pixels are."""
    camera = cg_camera(margins, display, spanned_mm)
    width_mm, height_mm = camera.sensor_mm
    return replace(camera, sensor_mm=(width_mm, height_mm / spanned_mm.pixel_shape))


def _focus_notes(preset: Preset, question: OverscanQuestion) -> Iterator[str]:
    """A note that the preset's only focus distance is used for depth of field."""
    if question.f_number is None or question.focus_distance_mm is not None:
        return
    measured = {entry.focus_distance_mm for entry in preset.entries}
    if None in measured:
        raise PresetError(
            "the preset knows no focus distance, which depth of field needs",
            remedy="give --focus-distance-mm",
        )
    if len(measured) == 1:
        yield (
            f"no focus distance is given; the preset's only one, {measured.pop():g} "
            "mm, is used for depth of field (--focus-distance-mm states another)"
        )


def _check(question: OverscanQuestion) -> None:
    width, height = question.size_px
    if not (0 < width <= LARGEST_SIDE_PX and 0 < height <= LARGEST_SIDE_PX):
        raise ImageError(
            f"a frame of {width} x {height} is none",
            remedy=f"give a size of up to {LARGEST_SIDE_PX} on a side",
        )
    stop = question.f_number
    if stop is not None and not 0 < stop < math.inf:
        raise ImageError(
            f"f/{stop:g} is no f-number", remedy="give one above zero with --f-number"
        )


def _margins(
    lens: "Lens",
    display: Window,
    spanned_mm: SpannedWidth,
    question: OverscanQuestion,
    channel: Channel | None,
    blur_px: float = 0.0,
) -> Margins:
    return margins_read(
        lens,
        display,
        channels=None if channel is None else (channel,),
        sensor_width_mm=spanned_mm,
        method=question.method,
        # In the higher of both counts, where pixels are not square.
        blur_px=blur_px * max(1.0, spanned_mm.pixel_shape),
    )


def _blur_px(
    lens: "Lens", display: Window, spanned_mm: SpannedWidth, nearest_mm: float | None
) -> float:
    """Radius of the circle of confusion of the sky, and of the nearest object."""
    geometry = PlateGeometry.of(lens, display, spanned_mm)
    depths = [math.inf]
    if nearest_mm is not None:
        depths.append(nearest_mm - float(lens.entrance_pupil_offset_mm))
        if not depths[1] > 0:
            raise PresetError(
                f"an object {nearest_mm:g} mm from the sensor lies inside the lens",
                remedy="give a larger --nearest-mm",
            )
    radii = Circle.of(lens, geometry).radius_px(np.array(depths, np.float32))
    return float(np.abs(radii).max())


def _states(preset: Preset, question: OverscanQuestion) -> list[_LensState]:
    """Focal lengths and focus distances to be tried."""
    measured = sorted({e.focal_length_mm for e in preset.entries})
    found = []
    for focal in _tried(measured, question.focal_length_mm, np.linspace):
        scaled = UNSCALED
        if question.scale_to_sensor:
            scaled = scaled_look(preset, focal, question.sensor_width_mm)
        stands, _ = scaled.measured_state(focal, None)
        found += [
            _LensState(stands, focus, scaled)
            for focus in _focus_tried(preset, question.focus_distance_mm, scaled)
        ]
    return found


def _focus_tried(
    preset: Preset, span: Span | None, scaled: ScaledLook
) -> Iterable[float | None]:
    """Focus distances of the measured lens."""
    entries = preset.entries
    measured = sorted({d for e in entries if (d := e.focus_distance_mm) is not None})
    if span is not None:
        low, high = span
        span = low / scaled.distances, high / scaled.distances
    elif len(entries) == len({e.focal_length_mm for e in entries}):
        return [None]
    return _tried(measured, span, _between_in_dioptres)


def _widths_mm(
    states: list[_LensState], sensor_mm: float, photographed_mm: float
) -> tuple[list[float], list[str]]:
    """What the frame spans of the photographed sensor in each state, and notes.

    Raises
    ------
    ImageError : The lens is not known that far out, and not scaled to it.
    """
    looks = [note for one in states if (note := one.scaled.note) is not None]
    notes = looks[:1] + looks[-1:]
    if len(looks) < len(states):
        notes += filter(None, [spanned_width_note(sensor_mm, photographed_mm)])
    widths = [
        sensor_mm if one.scaled == UNSCALED else one.scaled.measured_width_mm
        for one in states
    ]
    return widths, list(dict.fromkeys(notes))


def _tried(
    measured: list[float], span: Span | None, between: Callable[..., Iterable[float]]
) -> list[float]:
    """Values at the ends of a range, at what was measured in it, and between."""
    low, high = span or (measured[0], measured[-1])
    inside = [low, *(m for m in measured if low < m < high), high]
    found = set(inside)
    for a, b in pairwise(inside):
        found.update(float(v) for v in [*between(a, b, _STEPS + 1)][1:-1])
    return sorted(found)


def _between_in_dioptres(low_mm: float, high_mm: float, count: int) -> list[float]:
    ends = dioptres_from_mm(low_mm), dioptres_from_mm(high_mm)
    if ends[0] == ends[1]:
        return [low_mm] * count
    steps = np.linspace(*ends, count)[1:-1]
    return [low_mm, *(MILLIMETRES_PER_METRE / d for d in steps), high_mm]
