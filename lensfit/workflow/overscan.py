"""Overscan: the largest that a shot needs, and what a plate has and needs.

Between measured states the lens is interpolated, so that the largest need may lie
between them: each range is evaluated at its ends, at the measured states inside and at
steps between.

What a plate has and needs is read from its own header, as `apply` reads its camera.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lensfit.coords import Window
from lensfit.errors import ImageError, PresetError
from lensfit.exchange.stmaps import LARGEST_SIDE_PX
from lensfit.plate.apply_options import ApplyOptions
from lensfit.plate.camera.plate_camera import SPELT
from lensfit.plate.camera.plate_state import BLUR, SCALED
from lensfit.plate.camera.sources import StateOverrides
from lensfit.plate.frame.plate_lens import PlateLens
from lensfit.plate.frame.tight_window import known_window
from lensfit.plate.notes import topic_of
from lensfit.plate.pixel_shape import SQUARE, pixel_shape
from lensfit.plate.plate_file import plate_header, plate_views
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
from lensfit.rendering.render_stages import Switches
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
    for focal in _values_to_try(measured, question.focal_length_mm, np.linspace):
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
    return _values_to_try(measured, span, _evenly_in_dioptres)


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


def _values_to_try(
    measured: list[float], span: Span | None, between: Callable[..., Iterable[float]]
) -> list[float]:
    """Values at the ends of a range, at what was measured in it, and between."""
    low, high = span or (measured[0], measured[-1])
    inside = [low, *(m for m in measured if low < m < high), high]
    found = set(inside)
    for a, b in pairwise(inside):
        found.update(float(v) for v in [*between(a, b, _STEPS + 1)][1:-1])
    return sorted(found)


def _evenly_in_dioptres(low_mm: float, high_mm: float, count: int) -> list[float]:
    ends = dioptres_from_mm(low_mm), dioptres_from_mm(high_mm)
    if ends[0] == ends[1]:
        return [low_mm] * count
    steps = np.linspace(*ends, count)[1:-1]
    return [low_mm, *(MILLIMETRES_PER_METRE / d for d in steps), high_mm]


@dataclass(frozen=True)
class PlateOverscan:
    """What a plate has beyond its frame.

    Attributes
    ----------
    question : What it needs, at its own camera state.
    margins : Pixels that its data window has beyond its display window.
    empty : Whether it ends inside the frame on the left, top, right and bottom, and so
        is empty beyond and needs nothing there.
    stated_percent : `lens/overscan` of its header; None if it states none.
    notes : What was assumed of its camera state.
    """

    question: OverscanQuestion
    margins: Margins
    empty: tuple[bool, ...]
    stated_percent: float | None
    notes: tuple[str, ...]

    def suffices(self, needed: Margins) -> bool:
        """Whether the plate holds every pixel that is read."""
        sides = zip(self.empty, self.margins[:4], needed[:4], strict=True)
        return all(empty or has >= needs for empty, has, needs in sides)


def _empty_sides(data: Window, frame: Window) -> tuple[bool, ...]:
    """Whether a plate ends inside the frame: left, top, right and bottom."""
    known = known_window(data, frame)
    return tuple(a != b for a, b in zip(known, data, strict=True))


def _margins_of(data: Window, frame: Window) -> Margins:
    """Pixels of a data window beyond the frame."""
    return Margins(
        max(0, frame.x_min - data.x_min),
        max(0, frame.y_min - data.y_min),
        max(0, data.x_max - frame.x_max),
        max(0, data.y_max - frame.y_max),
    )


def _stated_aspect(header_aspect: float) -> float | None:
    """A header that says 1 may not have been asked (`plate.pixel_shape`)."""
    return None if header_aspect == SQUARE else header_aspect


def _no_blur_note(path: Path, lacking: list[str]) -> str:
    return (
        f"{path.name}: no {' and no '.join(lacking)} is known, so what depth of field "
        "reads is not counted (--f-number, --focus-distance-mm)"
    )


def overscan_of_plate(
    preset: Preset,
    path: Path,
    overrides: StateOverrides | None = None,
    knobs: Mapping[str, object] | None = None,
    *,
    scale_to_sensor: bool = False,
) -> PlateOverscan:
    """The overscan that a plate needs by its own header, and the one it has.

    Parameters
    ----------
    overrides : Camera state that counts in place of the header's.
    knobs : Knobs that the user set, by name.
    scale_to_sensor : Put the look on a camera that it was not measured on; the answer
        to the question says how.

    Raises
    ------
    ImageError : The plate cannot be read, or nobody states what the preset needs; or
        the f-number was overridden and nobody states a focus distance.
    """
    overrides = overrides or StateOverrides()
    first, *others = plate_views(plate_header(path), path)
    part = first.view.image.parts[0]
    frame, data = part.display_window, part.data_window
    # Fall-off and its f-number read no pixel.
    options = ApplyOptions(
        overrides=overrides,
        switches=Switches(falloff=False),
        knobs=knobs or {},
        again=True,  # a finished frame has the windows of its plate
        scale_to_sensor=scale_to_sensor,
    )
    lens = PlateLens(preset, options)
    if others:
        lens.notes.add(f"the overscan is that of view {first.view.name!r}")
    state = lens.noted_state(first.header, path)
    focal, f_number, focus = state.lens_key
    focal, focus = state.scaled.plate_state(focal, focus)
    if overrides.f_number is not None:
        state.require("focus_distance_mm", use="depth of field")
    elif lacking := [SPELT[name] for name in BLUR if name not in state.camera.known]:
        lens.notes.add(_no_blur_note(path, lacking))
        f_number = None
    size = frame.width, frame.height
    question = OverscanQuestion(
        size,
        state.sensor_width_mm * state.scaled.lengths,
        None if focal is None else (focal, focal),
        None if focus is None else (focus, focus),
        f_number,
        knobs=state.knobs,
        pixel_aspect=_stated_aspect(part.pixel_aspect),
        scale_to_sensor=scale_to_sensor,
    )
    beyond = _margins_of(data, frame)
    stated = state.camera.number("overscan_percent")
    notes = [note for note in lens.notes.said if topic_of(note) != SCALED]
    if stated and not any(beyond[:4]):
        notes.append(
            f"the header states {stated:g} % overscan, but no pixel lies beyond the "
            "display window: the whole picture is taken as the frame"
        )
    empty = _empty_sides(data, frame)
    return PlateOverscan(question, beyond, empty, stated, tuple(notes))
