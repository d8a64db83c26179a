"""Join the values of a take: those of the shoot file, completed by the header.

The shoot file counts first, since the person who wrote it could read the header, and
the lens' own scales are often more accurate than its electronics; where the two differ
by more than 2 % there is a note. A value in neither is an error only if the fit needs
it.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import final

from lensfit.errors import ShootError
from lensfit.io.metadata import CameraState
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
