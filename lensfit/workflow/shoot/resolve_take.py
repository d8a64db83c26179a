"""Complete what a shoot leaves out: from headers, and from the code on a chart.

The shoot file counts first, since the person who wrote it could read the header, and
the lens' own scales are often more accurate than its electronics; where the two differ
by more than 2 % there is a note. A value in neither is an error only if the fit needs
it.

A take without a target is searched for the code of a lensfit chart. One sharp take is
enough: takes that name no target and show no code, because they are out of focus or
leave the code out of the frame, take the chart of the others, if those show only one.
"""

import math
from collections.abc import Container
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import final

from msgspec.structs import replace

from lensfit.chart.layout import pattern_description
from lensfit.chart.pattern import Pattern, make_pattern
from lensfit.detect.chart_code import read_chart_code
from lensfit.errors import ChartError, LensfitError, ShootError
from lensfit.io.image import read_photograph
from lensfit.io.metadata import CameraState
from lensfit.progress import Progress, silent
from lensfit.units import dioptres_from_mm
from lensfit.workflow.shoot.crew_notation import check_focal_length
from lensfit.workflow.shoot.shoot_records import Shoot, Take, Target

DISAGREEMENT = 0.02
FOCUS_DISAGREEMENT_DIOPTRES = 0.02
_LARGEST_STRETCH = 3.0
"""Of the sides of a photosite: squeezed pictures are stored with up to 2."""


@final
@dataclass(frozen=True)
class ResolvedTake:
    """Everything known about a photograph before it is looked at.

    Attributes
    ----------
    take, target : As the shoot file has them.
    image_path : Where the photograph lies.
    focal_length_mm : As on the barrel.
    f_number, focus_distance_mm : As on the barrel; None if not stated.
    sensor_size_mm : Width and height of what the photograph spans.
    notes : One sentence for each disagreement.
    """

    take: Take
    target: Target
    image_path: Path
    focal_length_mm: float
    f_number: float | None
    focus_distance_mm: float | None
    sensor_size_mm: tuple[float, float]
    notes: tuple[str, ...]


def resolve_take(
    shoot: Shoot, take: Take, header: CameraState, image_size_px: tuple[int, int]
) -> ResolvedTake:
    """Join a take with the header of its photograph.

    Parameters
    ----------
    header : From `lensfit.io.metadata.camera_state_from`.
    image_size_px : Width and height of the photograph, for a sensor height that
        nobody states (photosites are then square).

    Raises
    ------
    ShootError : Neither knows the focal length or the sensor's width, the two cannot
        go together, or the region of interest lies outside the photograph.
    """
    where = f"{shoot.path}: {take.image}"
    notes: list[str] = []
    for name in ("focal_length_mm", "f_number", "focus_distance_mm"):
        notes += _disagreement(name, getattr(take, name), getattr(header, name))
    focal_length_mm = take.focal_length_mm or header.focal_length_mm
    if focal_length_mm is None:
        raise ShootError(
            "neither the shoot file nor the image header knows the focal length",
            where=where,
            remedy="add focal_length_mm to its [[take]]",
        )
    size_mm, size_notes = _sensor_size(shoot, header, image_size_px, where)
    check_focal_length(focal_length_mm, size_mm[0], where)
    _check_roi(take, image_size_px, where)
    return ResolvedTake(
        take=take,
        target=shoot.target_of(take),
        image_path=shoot.image_path(take),
        focal_length_mm=focal_length_mm,
        f_number=take.f_number or header.f_number,
        focus_distance_mm=take.focus_distance_mm or header.focus_distance_mm,
        sensor_size_mm=size_mm,
        notes=(*notes, *size_notes),
    )


def _disagreement(name: str, said: float | None, header: float | None) -> list[str]:
    if said is None or header is None or _close(name, said, header):
        return []
    return [f"{name} is {said:g} in the shoot file and {header:g} in the image header"]


def _close(name: str, said: float, header: float) -> bool:
    if name == "focus_distance_mm":
        gap = abs(dioptres_from_mm(said) - dioptres_from_mm(header))
        if gap <= FOCUS_DISAGREEMENT_DIOPTRES:
            return True
    if math.isinf(said) or math.isinf(header):
        return said == header
    return abs(said - header) <= DISAGREEMENT * max(said, header)


def _sensor_size(
    shoot: Shoot, header: CameraState, image_size_px: tuple[int, int], where: str
) -> tuple[tuple[float, float], list[str]]:
    camera = shoot.camera
    notes: list[str] = []
    for name in ("sensor_width_mm", "sensor_height_mm"):
        notes += _disagreement(name, getattr(camera, name), getattr(header, name))
    width_mm = camera.sensor_width_mm or header.sensor_width_mm
    height_mm = camera.sensor_height_mm
    if height_mm is None and camera.sensor_width_mm is None:
        height_mm = header.sensor_height_mm
    if width_mm is None:
        raise ShootError(
            "neither the shoot file nor the image header knows the sensor's width",
            where=where,
            remedy="add sensor_width_mm to [camera]",
        )
    aspect = image_size_px[1] / image_size_px[0]
    if height_mm is None:
        return (width_mm, width_mm * aspect), notes
    stretch = height_mm / width_mm / aspect
    if not 1 / _LARGEST_STRETCH <= stretch <= _LARGEST_STRETCH:
        raise ShootError(
            f"a sensor of {width_mm:g} x {height_mm:g} mm has no photographs of "
            f"{image_size_px[0]} x {image_size_px[1]} px",
            where=where,
            remedy="give sensor_width_mm and sensor_height_mm in millimetres",
        )
    if abs(stretch - 1) > DISAGREEMENT:
        notes.append(
            f"the sensor is {width_mm:g} x {height_mm:g} mm and the photograph "
            f"{image_size_px[0]} x {image_size_px[1]} px, so photosites are not square"
        )
    return (width_mm, height_mm), notes


def _check_roi(take: Take, image_size_px: tuple[int, int], where: str) -> None:
    if take.roi is None:
        return
    width, height = image_size_px
    if take.roi[2] > width or take.roi[3] > height:
        raise ShootError(
            f"roi = {list(take.roi)} reaches beyond the photograph of "
            f"{width} x {height} px",
            where=where,
            remedy="write [x0, y0, x1, y1] in pixels, left top right bottom",
        )


_THREADS = 2


def with_identified_charts(shoot: Shoot, progress: Progress = silent) -> Shoot:
    """A shoot whose takes name their targets, as far as charts say.

    A photograph that cannot be read keeps its take as it is; whoever uses the take says
    why it fails.
    """
    asking = [take for take in shoot.takes if take.target is None]
    if not asking:
        return shoot
    with ThreadPoolExecutor(_THREADS) as pool:
        jobs = [pool.submit(_chart_of, shoot, take) for take in asking]
        patterns = []
        for done, job in enumerate(jobs, 1):
            patterns.append(job.result())
            progress("charts", done, len(jobs))
    seen = list(dict.fromkeys(p for p in patterns if p is not None))
    if not seen:
        return shoot
    targets = dict(shoot.targets)
    names = {pattern: _new_name(pattern, targets) for pattern in seen}
    common = names[seen[0]] if len(seen) == 1 else None
    chosen = {
        take.image: names[pattern] if pattern is not None else common
        for take, pattern in zip(asking, patterns, strict=True)
    }
    takes = tuple(
        replace(take, target=take.target or chosen[take.image]) for take in shoot.takes
    )
    notes = tuple(
        f"the chart was read from its code: {', '.join(pattern_description(p))}; its "
        "sizes are as printed at 100 %"
        for p in seen
    )
    return replace(shoot, targets=targets, takes=takes, notes=shoot.notes + notes)


def target_of_pattern(pattern: Pattern, name: str) -> Target:
    """A chart as a shoot file states it."""
    size = (pattern.columns, pattern.rows)
    checker = pattern.kind == "checkerboard"
    return Target(
        name=name,
        kind=pattern.kind,
        pitch_mm=pattern.pitch_mm,
        hole_diameter_mm=pattern.mark_mm if pattern.kind == "dot-grid" else None,
        line_width_mm=pattern.mark_mm if pattern.kind == "line-grid" else None,
        polarity=None if checker else pattern.polarity,
        squares=size if checker else None,
        marks=None if checker else size,
    )


def pattern_of_target(target: Target) -> Pattern | None:
    """The lensfit chart that a target may be; None if it is none."""
    size = target.squares if target.kind == "checkerboard" else target.marks
    if size is None or target.kind in ("circle-grid", "charuco"):
        return None
    across = min(target.pitch_xy_mm)
    mark = target.hole_diameter_mm or target.line_width_mm or across / 10
    try:
        return make_pattern(
            target.kind, target.polarity or "bright", across, mark, *size
        )
    except ChartError:
        return None


def _chart_of(shoot: Shoot, take: Take) -> Pattern | None:
    try:
        return read_chart_code(
            read_photograph(shoot.image_path(take), take.encoding, shoot.camera.mosaic)
        )
    except (LensfitError, ValueError):
        return None


def _new_name(pattern: Pattern, targets: dict[str, Target]) -> str:
    """Add the chart to the targets under a name of its own."""
    name = free_name(pattern.kind, targets)
    targets[name] = target_of_pattern(pattern, name)
    return name


def free_name(wanted: str, taken: Container[str]) -> str:
    """The name itself, or numbered if it is taken."""
    name, k = wanted, 2
    while name in taken:
        name, k = f"{wanted}-{k}", k + 1
    return name
