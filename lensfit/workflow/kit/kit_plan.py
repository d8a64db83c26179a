"""The plan of a kit's photographs: every view with slate, exposure and expected blur.

The chart stands still; at every focus mark each stop is photographed, and at the end of
each focal length the chart is tilted. So distortion and breathing are measured at every
mark, and the blur on both sides of focus. Light on the sensor goes as
``1 / (N (1 + m))^2``, with m the magnification at which the lens is focused.
"""

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any, final

from lensfit.chart.chart_camera import (
    blur_mm,
    distance_of_magnification_mm,
    magnification_at,
)
from lensfit.errors import ShootError
from lensfit.units import dioptres_from_mm
from lensfit.workflow.kit.kit_file import FocusMark, Kit, KitLens

TILT_DEG = 20.0
_WAYS = ("left", "right", "up", "down")
_FAR_MM = 1e7
"""Stands for infinity, where a lens is its focal length from the sensor."""
_LEAST_COVERED = 0.95


@final
@dataclass(frozen=True)
class KitView:
    """One photograph to take.

    Attributes
    ----------
    slate : What the clapper, or the camera's file name, says.
    image : Name of the file.
    mark : Focus mark as engraved.
    target_distance_mm : Of the standing chart; None of a tilted one, which is fitted.
    tilted : Which way the chart is turned by `TILT_DEG`; None for square.
    exposure_stops : More light than the lens' first view needs, to be as bright.
    shutter_s : Exposure time, where the chart was metered.
    blur_px : Diameter of a point's disc; None where the photographs' size is unknown.
    overlapping : Dots run into each other.
    """

    slate: str
    image: str
    focal_length_mm: float
    f_number: float
    mark: str
    focus_distance_mm: float
    target_distance_mm: float | None
    tilted: str | None
    exposure_stops: float
    shutter_s: float | None
    blur_px: float | None
    overlapping: bool


@final
@dataclass(frozen=True)
class LensPlan:
    """The views of a lens.

    Attributes
    ----------
    folder : Of its photographs, from the kit file.
    target_distance_mm : Of the chart at every focal length.
    seconds : That the crew will take.
    notes : What to know before.
    """

    folder: str
    lens: KitLens
    target: str
    target_distance_mm: tuple[float, ...]
    views: tuple[KitView, ...]
    seconds: float
    notes: tuple[str, ...]


def kit_plan(kit: Kit) -> list[LensPlan]:
    """The plan of every lens, in the order of the kit file.

    Raises
    ------
    ShootError : A chart's distance is neither stated nor follows from its size.
    """
    return [lens_plan(kit, folder) for folder in kit.lenses]


def lens_plan(kit: Kit, folder: str) -> LensPlan:
    """The plan of one lens.

    Raises
    ------
    ShootError : As `kit_plan`.
    """
    lens = kit.lenses[folder]
    settings = [one for f in lens.focal_lengths_mm for one in _settings(kit, lens, f)]
    views = tuple(
        _view(kit, lens, f"{folder}_v{number:02d}", *setting)
        for number, setting in enumerate(settings, 1)
    )
    first = views[0]
    views = tuple(
        replace(v, exposure_stops=v.exposure_stops - first.exposure_stops)
        for v in views
    )
    exposures = sum(view.shutter_s or 0.0 for view in views)
    return LensPlan(
        folder=folder,
        lens=lens,
        target=kit.target_of(lens).name,
        target_distance_mm=tuple(
            _target_distance_mm(kit, lens, f) for f in lens.focal_lengths_mm
        ),
        views=views,
        seconds=kit.pace.per_lens_s + len(views) * kit.pace.per_view_s + exposures,
        notes=tuple(_notes(kit, lens, views)),
    )


def plan_as_json(plans: list[LensPlan]) -> dict[str, Any]:
    """The plan in types that JSON knows; infinity is "inf"."""
    lenses = [asdict(plan) for plan in plans]
    for lens in lenses:
        for one in [*lens["views"], *lens["lens"].focus_marks]:
            if isinstance(one, dict) and math.isinf(one["focus_distance_mm"]):
                one["focus_distance_mm"] = "inf"
        record: KitLens = lens.pop("lens")
        lens |= {
            "name": record.name,
            "serial": record.serial,
            "lens_set": record.lens_set,
        }
    return {
        "schema": "lensfit.kit_plan.1",
        "views": sum(len(plan.views) for plan in plans),
        "seconds": sum(plan.seconds for plan in plans),
        "lenses": lenses,
    }


def _settings(
    kit: Kit, lens: KitLens, focal_mm: float
) -> Iterator[tuple[float, float, FocusMark, float, str | None]]:
    """Focal length, f-number, mark, chart's distance and tilt of every view."""
    target_mm = _target_distance_mm(kit, lens, focal_mm)
    for mark in lens.focus_marks:
        for stop in lens.f_numbers:
            yield focal_mm, stop, mark, target_mm, None
    sharpest = min(
        lens.focus_marks,
        key=lambda one: abs(
            dioptres_from_mm(one.distance_mm) - dioptres_from_mm(target_mm)
        ),
    )
    for k in range(lens.tilted_views):
        way = _WAYS[k % len(_WAYS)]
        yield focal_mm, lens.f_numbers[-1], sharpest, target_mm, way


def _view(
    kit: Kit,
    lens: KitLens,
    slate: str,
    focal_mm: float,
    stop: float,
    mark: FocusMark,
    target_mm: float,
    tilted: str | None,
) -> KitView:
    focus_mm = min(mark.distance_mm, _FAR_MM)
    widened = stop * (1 + magnification_at(focal_mm, focus_mm))
    metered, blur_px, overlapping = kit.exposure, None, False
    if kit.camera.image_size_px is not None:
        pixel_mm = kit.camera.sensor_width_mm / kit.camera.image_size_px[0]
        blur_px = blur_mm(focal_mm, stop, focus_mm, target_mm) / pixel_mm
        px_per_mm = magnification_at(focal_mm, target_mm) / pixel_mm
        target = kit.target_of(lens)
        room_px = (min(target.pitch_xy_mm) - (target.hole_diameter_mm or 0)) * px_per_mm
        overlapping = blur_px > room_px
    return KitView(
        slate=slate,
        image=f"{slate}{lens.file_format}",
        focal_length_mm=focal_mm,
        f_number=stop,
        mark=mark.engraved,
        focus_distance_mm=mark.distance_mm,
        target_distance_mm=None if tilted else target_mm,
        tilted=tilted,
        exposure_stops=2 * math.log2(widened),
        shutter_s=metered and metered.shutter_s * (widened / metered.f_number) ** 2,
        blur_px=blur_px,
        overlapping=overlapping,
    )


def _target_distance_mm(kit: Kit, lens: KitLens, focal_mm: float) -> float:
    """As stated, else where the chart's pattern fills the frame.

    Raises
    ------
    ShootError : Neither is known.
    """
    if lens.target_distance_mm is not None:
        return lens.target_distance_mm
    parts = _frame_over_pattern(kit, lens)
    if parts is None:
        raise ShootError(
            "does not say where the chart stands",
            where=f"{kit.path}: {lens.title}",
            remedy="state target_distance, or marks (columns and rows) and "
            "sensor_height_mm, from which it follows",
        )
    return round(distance_of_magnification_mm(focal_mm, min(max(parts), 1.0)), -1)


def _frame_over_pattern(kit: Kit, lens: KitLens) -> tuple[float, float] | None:
    """Sides of the sensor over those of the chart's pattern; None where unknown."""
    target, camera = kit.target_of(lens), kit.camera
    marks = target.marks or target.squares
    height_mm = camera.sensor_height_mm
    if height_mm is None and camera.image_size_px is not None:
        across, down = camera.image_size_px
        height_mm = camera.sensor_width_mm * down / across
    if marks is None or height_mm is None:
        return None
    width_mm = camera.sensor_width_mm * (lens.anamorphic_squeeze or 1.0)
    pitch = target.pitch_xy_mm
    return (
        width_mm / ((marks[0] - 1) * pitch[0]),
        height_mm / ((marks[1] - 1) * pitch[1]),
    )


def _notes(kit: Kit, lens: KitLens, views: tuple[KitView, ...]) -> Iterator[str]:
    together = [view for view in views if view.overlapping]
    if together:
        worst = max(together, key=lambda view: view.blur_px or 0.0)
        yield (
            f"dots run into each other on {len(together)} of {len(views)} views, most "
            f"at f/{worst.f_number:g} focused at {worst.mark}: leave such marks out, "
            "move the chart for them, or take a larger pitch"
        )
    if not lens.tilted_views:
        yield (
            "no view is tilted: the focal length cannot be told from the chart's "
            "distance"
        )
    parts = _frame_over_pattern(kit, lens)
    for focal_mm in lens.focal_lengths_mm if parts else ():
        assert parts is not None
        target_mm = _target_distance_mm(kit, lens, focal_mm)
        magnification = magnification_at(focal_mm, target_mm)
        covered = min(magnification / part for part in parts)
        if covered < _LEAST_COVERED:
            yield (
                f"at {focal_mm:g} mm the chart covers {covered:.0%} of the frame from "
                f"{target_mm:.0f} mm: move it nearer, or shift it into the corners"
            )
