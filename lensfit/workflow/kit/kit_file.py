"""Read a kit file (TOML) strictly: every error names its key and a remedy.

A kit has a camera, charts, and lenses with their stops and marks. Lengths are
millimetres; distances are from the sensor plane, as on the barrel. Values under
`[defaults]` hold for every lens that does not state them itself.
"""

import math
from collections.abc import Mapping
from itertools import combinations
from pathlib import Path, PurePosixPath
from typing import Annotated, Any

from msgspec import Meta, Struct

from lensfit._strict import (
    array_table_place,
    convert_strictly,
    non_finite_numbers,
    read_toml_tables,
)
from lensfit.errors import ShootError
from lensfit.preset.library.levels import slug_of
from lensfit.workflow.shoot.crew_notation import check_focal_length, length_mm
from lensfit.workflow.shoot.shoot_file import check_names
from lensfit.workflow.shoot.shoot_records import (
    FNumber,
    Name,
    PositiveFloat,
    Squeeze,
    Target,
)

Count = Annotated[int, Meta(ge=0, le=8)]
Pixels = Annotated[int, Meta(ge=16, le=100_000)]


class KitCamera(Struct, frozen=True, forbid_unknown_fields=True):
    """The body that every lens of the kit is photographed with.

    Attributes
    ----------
    sensor_width_mm, sensor_height_mm : Of the area that photographs span.
    image_size_px : Width and height of the photographs; without it no blur can be
        planned.
    mosaic : As in a shoot file.
    """

    sensor_width_mm: PositiveFloat
    sensor_height_mm: PositiveFloat | None = None
    model: str | None = None
    image_size_px: tuple[Pixels, Pixels] | None = None
    mosaic: str | None = None


class Metered(Struct, frozen=True, forbid_unknown_fields=True):
    """The exposure that suits the chart, as metered at one f-number at infinity.

    Attributes
    ----------
    shutter_s : Exposure time.
    """

    f_number: FNumber
    shutter_s: PositiveFloat
    iso: PositiveFloat | None = None


class Pace(Struct, frozen=True, forbid_unknown_fields=True):
    """How long a crew takes, beside the exposures.

    Attributes
    ----------
    per_view_s : To set ring and iris, slate and shoot.
    per_lens_s : To change the lens, frame the chart and check the first view.
    """

    per_view_s: PositiveFloat = 40.0
    per_lens_s: PositiveFloat = 300.0


class FocusMark(Struct, frozen=True):
    """A mark of the focus scale.

    Attributes
    ----------
    engraved : As the barrel has it, 4'11" or 1.5 m.
    distance_mm : What that is; may be infinite.
    """

    engraved: str
    distance_mm: float


class KitLens(Struct, frozen=True, forbid_unknown_fields=True):
    """One lens, and what is photographed of it.

    Attributes
    ----------
    lens_set : The set it belongs to, whose lenses should match.
    folder : Of its photographs, from the kit file; made from name and serial if None.
    focal_lengths_mm : One of a prime; those to photograph of a zoom.
    f_numbers : At every mark, widest first.
    focus_marks : At which the standing chart is photographed.
    target : Name of the chart; the only one if None.
    target_distance_mm : Where it stands; where its pattern fills the frame if None.
    tilted_views : Of the chart turned by `TILT_DEG`, for each focal length; without
        them the focal length cannot be told from the chart's distance.
    file_format : Ending of the photographs' names.
    """

    name: Name
    focal_lengths_mm: Annotated[list[PositiveFloat], Meta(min_length=1)]
    f_numbers: Annotated[list[FNumber], Meta(min_length=1)]
    focus_marks: Annotated[list[FocusMark], Meta(min_length=1)]
    serial: str | None = None
    lens_set: str | None = None
    folder: Name | None = None
    target: Name | None = None
    target_distance_mm: PositiveFloat | None = None
    tilted_views: Count = 1
    anamorphic_squeeze: Squeeze | None = None
    encoding: Name | None = None
    file_format: Name = ".exr"

    @property
    def title(self) -> str:
        """Name and serial number, for people."""
        return f"{self.name} s/n {self.serial}" if self.serial else self.name


class KitFile(Struct, frozen=True, forbid_unknown_fields=True):
    """The tables of a kit file, under their own names."""

    camera: KitCamera
    lens: Annotated[list[KitLens], Meta(min_length=1)]
    name: str = "Lens kit"
    target: list[Target] = []
    exposure: Metered | None = None
    pace: Pace = Pace()


class Kit(Struct, frozen=True):
    """A kit file that does not contradict itself.

    Attributes
    ----------
    path : The file; folders of lenses count from where it lies.
    lenses : By folder, in the order of the file.
    """

    path: Path
    name: str
    camera: KitCamera
    targets: dict[str, Target]
    lenses: dict[str, KitLens]
    exposure: Metered | None
    pace: Pace

    def target_of(self, lens: KitLens) -> Target:
        """The chart of a lens."""
        return self.targets[lens.target or next(iter(self.targets))]

    def folder_of(self, key: str) -> Path:
        """Where the photographs of a lens lie."""
        return self.path.parent / key


_SOURCE = "give a kit file in TOML, as notebooks/guide/kit.md describes"
_SAME_MARK = 0.01
"""Relative difference below which two marks are one: 4'11" is 1.5 m, and a ring is not
set more finely."""
_OF_ONE_LENS = ("name", "serial", "folder")
_TARGET_LENGTHS = ("pitch_mm", "hole_diameter_mm", "line_width_mm")


def load_kit(path: str | Path) -> Kit:
    """Read and check a kit file; no photograph is opened.

    Raises
    ------
    ShootError : The file cannot be read, is not TOML, has an unknown key or a value out
        of range, or contradicts itself. The sentence names the key.
    """
    path = Path(path)
    data = read_toml_tables(path, error=ShootError, source=_SOURCE, mend=_SOURCE)
    data = _plain_form(data, path)
    for key, value in non_finite_numbers(data):
        if not key.endswith(".distance_mm"):
            raise ShootError(
                f"{array_table_place(key)}: {value} is no finite number", where=path
            )
    tables = convert_strictly(
        data, KitFile, error=ShootError, where=path, place=array_table_place
    )
    targets = _named_targets(tables.target, path)
    lenses: dict[str, KitLens] = {}
    for number, lens in enumerate(tables.lens, 1):
        where = f"{path}: [[lens]] {number} ({lens.name})"
        folder = lens.folder or slug_of(lens.name, lens.serial)
        _check_folder(folder, lenses, where)
        _check_lens(lens, targets, tables.camera.sensor_width_mm, where)
        lenses[folder] = lens
    return Kit(
        path=path,
        name=tables.name,
        camera=tables.camera,
        targets=targets,
        lenses=lenses,
        exposure=tables.exposure,
        pace=tables.pace,
    )


def _plain_form(data: Mapping[str, Any], path: Path) -> dict[str, Any]:
    """Defaults put into every lens, and lengths as millimetres."""
    data = dict(data)
    defaults = data.pop("defaults", {})
    if not isinstance(defaults, Mapping):
        raise ShootError("should be a table", where=f"{path}: [defaults]")
    for key in _OF_ONE_LENS:
        if key in defaults:
            raise ShootError(f"{key} belongs to one lens", where=f"{path}: [defaults]")
    lenses = data.get("lens")
    if isinstance(lenses, list) and all(isinstance(one, Mapping) for one in lenses):
        data["lens"] = [
            _plain_lens(_without_rivals(defaults, one) | one, f"{path}: [[lens]] {k}")
            for k, one in enumerate(lenses, 1)
        ]
    targets = data.get("target")
    if isinstance(targets, list) and all(isinstance(one, Mapping) for one in targets):
        data["target"] = [
            _with_lengths(dict(one), _TARGET_LENGTHS, f"{path}: [[target]] {k}")
            for k, one in enumerate(targets, 1)
        ]
    return data


def _without_rivals(defaults: Mapping[str, Any], lens: Mapping[str, Any]) -> dict:
    """The defaults without what the lens says under another key."""
    rivals = [
        ("focal_length_mm", "focal_lengths_mm"),
        ("target_distance", "target_distance_mm"),
    ]
    said = {key for pair in rivals if set(pair) & lens.keys() for key in pair}
    return {key: value for key, value in defaults.items() if key not in said}


def _plain_lens(lens: dict[str, Any], where: str) -> dict[str, Any]:
    lens = _with_lengths(lens, ("target_distance_mm",), where)
    if "focal_length_mm" in lens:
        if "focal_lengths_mm" in lens:
            raise ShootError(
                "states both focal_length_mm and focal_lengths_mm", where=where
            )
        lens["focal_lengths_mm"] = [lens.pop("focal_length_mm")]
    marks = lens.get("focus_marks")
    if isinstance(marks, list):
        lens["focus_marks"] = [_focus_mark(one, where) for one in marks]
    return lens


def _focus_mark(engraved: Any, where: str) -> dict[str, Any]:
    if not isinstance(engraved, str):
        raise ShootError(
            f"focus mark {engraved!r} names no unit",
            where=where,
            remedy='write them as engraved: "4\'11\\"", "1.5 m", "inf"',
        )
    distance_mm = length_mm(engraved, "focus_marks", where)
    return {"engraved": engraved, "distance_mm": distance_mm}


def _with_lengths(table: dict[str, Any], keys: tuple[str, ...], where: str) -> dict:
    """Lengths that were written with their unit, in millimetres."""
    for key in keys:
        short = key.removesuffix("_mm")
        if short in table:
            if key in table:
                raise ShootError(f"states both {short} and {key}", where=where)
            if not isinstance(table[short], str):
                raise ShootError(
                    f"{short} = {table[short]!r} names no unit",
                    where=where,
                    remedy=f'write {short} = "1.5 m" or {key} = 1500',
                )
            table[key] = table.pop(short)
        if isinstance(table.get(key), str):
            table[key] = length_mm(table[key], key, where)
    return table


def _named_targets(targets: list[Target], path: Path) -> dict[str, Target]:
    named: dict[str, Target] = {}
    for target in targets:
        if target.name in named:
            raise ShootError(
                f'a second target is named "{target.name}"',
                where=path,
                remedy="give every target a name of its own",
            )
        named[target.name] = target
    if not named:
        raise ShootError(
            "names no chart", where=path, remedy="add [[target]], as in a shoot file"
        )
    return named


def _check_folder(folder: str, taken: Mapping[str, KitLens], where: str) -> None:
    pure = PurePosixPath(folder)
    if pure.is_absolute() or ".." in pure.parts or "\\" in folder:
        raise ShootError(
            f'folder = "{folder}" leaves the folder of the kit file',
            where=where,
            remedy="name a folder beside the kit file",
        )
    if folder.casefold() in {one.casefold() for one in taken}:
        raise ShootError(
            f'has the folder "{folder}" of another lens',
            where=where,
            remedy="state serial, or a folder of its own",
        )


def _check_lens(
    lens: KitLens, targets: Mapping[str, Target], sensor_width_mm: float, where: str
) -> None:
    if lens.target is None and len(targets) > 1:
        raise ShootError(
            "does not say which chart is photographed",
            where=where,
            remedy=f"state target: {', '.join(targets)}",
        )
    check_names(lens.target, lens.encoding, targets, where)
    _check_marks_differ(lens, where)
    for focal_mm in lens.focal_lengths_mm:
        check_focal_length(focal_mm, sensor_width_mm, where)
        distances = [mark.distance_mm for mark in lens.focus_marks]
        nearest = min([*distances, lens.target_distance_mm or math.inf])
        if nearest <= 4 * focal_mm:
            raise ShootError(
                f"{nearest:g} mm is nearer than a lens of {focal_mm:g} mm focuses",
                where=where,
                remedy="distances are from the sensor: at least four focal lengths",
            )


def _check_marks_differ(lens: KitLens, where: str) -> None:
    """Refuse a setting that is listed twice: its photographs would be taken twice, and
    measured marks would be those of both."""
    marks = [(mark.engraved, mark.distance_mm) for mark in lens.focus_marks]
    stops = [(f"{stop:g}", stop) for stop in lens.f_numbers]
    focals = [(f"{focal:g}", focal) for focal in lens.focal_lengths_mm]
    for key, settings, same in (
        ("focus_marks", marks, _SAME_MARK),
        ("f_numbers", stops, 0.0),
        ("focal_lengths_mm", focals, 0.0),
    ):
        for (one, its), (other, others) in combinations(settings, 2):
            if not math.isclose(its, others, rel_tol=same):
                continue
            twice = f"{key} lists {one} twice"
            if one != other:
                twice = f"{key} lists {one} and {other}, which are one mark"
            raise ShootError(twice, where=where, remedy="keep one of them")
