"""The shoot of a lens of a kit: its planned views, with the photographs found for them.

In a folder with its own ``shoot.toml`` that file counts. Elsewhere photographs are the
views of their own slate; as cameras number their files themselves, those with other
names are the first view still missing whose lens settings are in their headers.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import final

import msgspec
from msgspec.structs import replace

from lensfit.errors import LensfitError, ShootError
from lensfit.io.image import camera_state_of, read_photograph
from lensfit.io.metadata import CameraState
from lensfit.workflow.check.photographs import SUFFIXES, view_of_photograph
from lensfit.workflow.kit.kit_file import Kit
from lensfit.workflow.kit.kit_plan import KitView, lens_plan
from lensfit.workflow.shoot.shoot_file import load_shoot
from lensfit.workflow.shoot.shoot_records import Camera, LensName, Shoot, Take

SHOOT_FILE = "shoot.toml"


@final
@dataclass(frozen=True)
class LensShoot:
    """What was photographed of a lens.

    Attributes
    ----------
    planned : The shoot with every view of the plan.
    photographs : File of each view that is there, by the view's planned name.
    beside : Photographs in the folder that are no view.
    """

    folder: str
    planned: Shoot
    photographs: Mapping[str, Path]
    beside: tuple[str, ...]

    @property
    def missing(self) -> tuple[str, ...]:
        """Views that were not photographed."""
        names = (take.image for take in self.planned.takes)
        return tuple(name for name in names if name not in self.photographs)

    def shoot(self) -> Shoot:
        """The views that are there, under their files' names.

        Raises
        ------
        ShootError : There is none.
        """
        base = self.planned.images or self.planned.path.parent
        if not self.photographs:
            raise ShootError(
                "no view of the plan was photographed",
                where=base,
                remedy="put the photographs there, under the names of the plan",
            )
        takes = tuple(
            replace(take, image=_beside(self.photographs[take.image], base))
            for take in self.planned.takes
            if take.image in self.photographs
        )
        notes = self.planned.notes
        if self.missing:
            count = f"{len(self.missing)} of {len(self.planned.takes)} planned views"
            notes += (f"{count} are missing: {', '.join(self.missing[:8])}",)
        return replace(self.planned, takes=takes, notes=notes)


def lens_shoot(kit: Kit, folder: str) -> LensShoot:
    """Which views of a lens are there.

    Raises
    ------
    ShootError : The folder's own shoot file, or the plan, is wrong.
    """
    place = kit.folder_of(folder)
    own = place / SHOOT_FILE
    planned = load_shoot(own) if own.exists() else planned_shoot(kit, folder)
    found = {
        take.image: planned.image_path(take)
        for take in planned.takes
        if planned.image_path(take).exists()
    }
    if not own.exists():
        found |= _otherwise_named_photographs(planned, _photographs(place), found)
    taken = {path.resolve() for path in found.values()}
    files = _photographs(place)
    beside = tuple(path.name for path in files if path.resolve() not in taken)
    return LensShoot(folder, planned, found, beside)


def planned_shoot(kit: Kit, folder: str) -> Shoot:
    """The shoot as the kit file plans it.

    Raises
    ------
    ShootError : The plan cannot be made.
    """
    lens, camera = kit.lenses[folder], kit.camera
    target = kit.target_of(lens)
    return Shoot(
        path=kit.path,
        images=kit.folder_of(folder),
        lens=LensName(lens.name, lens.serial),
        camera=msgspec.convert(
            {
                "model": camera.model,
                "sensor_width_mm": camera.sensor_width_mm,
                "sensor_height_mm": camera.sensor_height_mm,
                "mosaic": camera.mosaic,
            },
            Camera,
        ),
        targets={target.name: target},
        takes=tuple(
            _take(view, target.name, lens.anamorphic_squeeze, lens.encoding)
            for view in lens_plan(kit, folder).views
        ),
    )


def _take(
    view: KitView, target: str, squeeze: float | None, encoding: str | None
) -> Take:
    return Take(
        image=view.image,
        target=target,
        focal_length_mm=view.focal_length_mm,
        f_number=view.f_number,
        focus_distance_mm=view.focus_distance_mm,
        target_distance_mm=view.target_distance_mm,
        anamorphic_squeeze=squeeze,
        encoding=encoding,
    )


def _otherwise_named_photographs(
    planned: Shoot, files: Iterable[Path], found: Mapping[str, Path]
) -> dict[str, Path]:
    """Views whose photographs have another ending, or a camera's own number."""
    matched = dict(found)
    taken = {path.resolve() for path in found.values()}
    left = [path for path in files if path.resolve() not in taken]
    for by_header in (False, True):
        for path in list(left):
            if len(matched) == len(planned.takes):
                return matched
            header = _header(path, planned) if by_header else None
            take = view_of_photograph(planned, path, header, matched)
            if take is not None and take.image not in matched:
                matched[take.image] = path
                left.remove(path)
    return matched


def _header(path: Path, planned: Shoot) -> CameraState | None:
    try:
        return camera_state_of(read_photograph(path, planned.takes[0].encoding))
    except LensfitError:
        return None


def _photographs(folder: Path) -> list[Path]:
    """In the order of their names, as cameras number them."""
    if not folder.is_dir():
        return []
    return sorted(
        path
        for path in folder.iterdir()
        if path.suffix.lower() in SUFFIXES and not path.name.startswith(".")
    )


def _beside(path: Path, base: Path) -> str:
    return path.relative_to(base).as_posix() if path.is_relative_to(base) else str(path)
