"""Read and check a shoot file.

A shoot file (TOML) names one lens, one camera, the targets and the takes
(`lensfit.workflow.shoot.shoot_records` lists the keys). Every error that can be found
before a picture is opened is found here. Values that picture headers contain may be
left out; `lensfit.workflow.shoot.resolve_take` joins the two.

The draft of `lensfit inspect --write-shoot` is valid as it stands, and marks what only
the photographer knows by a comment: an unconfirmed field still says TODO. Readers of
TOML drop comments, so the text itself is searched.
"""

import math
import re
from collections.abc import Collection
from pathlib import Path
from typing import Any

from lensfit._strict import (
    LARGEST_TOML_BYTES,
    array_table_place,
    convert_strictly,
    did_you_mean,
    non_finite_numbers,
    read_toml_tables,
)
from lensfit.bounded import read_bounded, utf8_text
from lensfit.errors import ShootError
from lensfit.io.transfer import ENCODINGS
from lensfit.workflow.shoot.crew_notation import check_focal_length, plain_form
from lensfit.workflow.shoot.shoot_records import (
    Camera,
    LensName,
    Shoot,
    ShootFile,
    Take,
    Target,
)

_TABLE = re.compile(r"\s*\[+\s*([A-Za-z_]+)\s*\]+")
_KEY = re.compile(r"\s*([A-Za-z_]+)\s*=(.*)")
_QUOTED = re.compile(r"\"(?:\\.|[^\"\\])*\"|'[^']*'")
_LISTED: tuple[str, ...] = ("target", "take")


def unconfirmed_fields(text: str) -> tuple[str, ...]:
    """The keys in use whose comment still says TODO, as "[[target]] 1, pitch_mm"
    or "lens.name".

    Parameters
    ----------
    text : A shoot file that was read without complaint.
    """
    found: list[str] = []
    table = ""
    counts: dict[str, int] = dict.fromkeys(_LISTED, 0)
    for line in text.splitlines():
        header, key = _TABLE.match(line), _KEY.match(line)
        if header:
            table = f"{header[1]}."
            if header[1] in counts:
                counts[header[1]] += 1
                table = f"[[{header[1]}]] {counts[header[1]]}, "
        elif key:
            _, _, comment = _QUOTED.sub("", key[2]).partition("#")
            if "TODO" in comment:
                found.append(table + key[1])
    return tuple(found)


def notes_of_draft(keys: tuple[str, ...]) -> tuple[str, ...]:
    """One sentence that names the unconfirmed keys; nothing if there are none."""
    if not keys:
        return ()
    named = "; ".join(keys)
    return (
        f"taken as drafted, as their lines still say TODO: {named}. Put in what is "
        "true and remove the TODO",
    )


__all__ = ["Camera", "LensName", "Shoot", "Take", "Target", "load_shoot"]

_SOURCE = '"lensfit inspect IMAGES --write-shoot" drafts a shoot file'
_MEND = "give a shoot file in TOML, as the README describes"
_ONLY_FOR = {
    "hole_diameter_mm": ("dot-grid", "circle-grid"),
    "line_width_mm": ("line-grid",),
    "asymmetric": ("circle-grid",),
    "squares": ("checkerboard", "charuco"),
    "dictionary": ("charuco",),
    "marker_ratio": ("charuco",),
    "marks": ("dot-grid", "line-grid"),
}
_NEEDED_BY = {"charuco": ("squares", "dictionary")}


def load_shoot(path: str | Path, images: str | Path | None = None) -> Shoot:
    """Read and check a shoot file; the photographs themselves are not opened.

    Parameters
    ----------
    path : A TOML file as the README describes.
    images : Folder that the photographs' paths count from; the shoot file's own if
        None.

    Raises
    ------
    ShootError : The file cannot be read, is not TOML, has an unknown key or a value
        out of range, or contradicts itself. The sentence names the key.
    """
    path = Path(path)
    data = read_toml_tables(
        path,
        error=ShootError,
        source=_SOURCE,
        mend=_MEND,
    )
    return shoot_of(data, _text(path), path, images)


def shoot_of(
    data: dict[str, Any], text: str, path: Path, images: str | Path | None = None
) -> Shoot:
    """The same from what a file holds.

    Parameters
    ----------
    data : As TOML has it.
    text : The file with its comments.

    Raises
    ------
    ShootError : As `load_shoot`.
    """
    data, notes = plain_form(data, path)
    for key, value in non_finite_numbers(data):
        if not (key.endswith(".focus_distance_mm") and value == math.inf):
            raise ShootError(
                f"{array_table_place(key)}: {value} is no finite number", where=path
            )
    tables = convert_strictly(
        data, ShootFile, error=ShootError, where=path, place=array_table_place
    )
    _check_names_are_readable(tables, path)
    unconfirmed = unconfirmed_fields(text)
    targets = _targets_by_name(tables.target, path)
    _check_takes(tables.take, targets, tables.camera, path)
    return Shoot(
        path=path,
        lens=tables.lens,
        camera=tables.camera,
        targets=targets,
        takes=tuple(tables.take),
        notes=_unused_target_notes(tables) + notes + notes_of_draft(unconfirmed),
        images=None if images is None else Path(images),
        unconfirmed=unconfirmed,
    )


def _check_names_are_readable(tables: ShootFile, path: Path) -> None:
    """Refuse names of nothing that can be seen, or that no file can have."""
    named = {"lens, name": tables.lens.name}
    named |= {f"[[target]] {k}, name": t.name for k, t in enumerate(tables.target, 1)}
    named |= {f"[[take]] {k}, image": t.image for k, t in enumerate(tables.take, 1)}
    for place, text in named.items():
        if not text.strip() or any(ord(sign) < 32 for sign in text):
            raise ShootError(
                "is blank or has a control character",
                where=f"{path}: {place}",
                remedy="write it in letters and digits",
            )


def _text(path: Path) -> str:
    """The file with its comments, which the reader of TOML drops."""
    content = read_bounded(path, LARGEST_TOML_BYTES, error=ShootError, remedy=_SOURCE)
    return utf8_text(content, path, error=ShootError, remedy=_MEND)


def _targets_by_name(targets: list[Target], path: Path) -> dict[str, Target]:
    named: dict[str, Target] = {}
    for number, target in enumerate(targets, 1):
        where = f"{path}: [[target]] {number}"
        if target.name in named:
            raise ShootError(
                f'a second target is named "{target.name}"',
                where=where,
                remedy="give every target a name of its own",
            )
        _check_target(target, where)
        named[target.name] = target
    return named


def _check_target(target: Target, where: str) -> None:
    for key, kinds in _ONLY_FOR.items():
        if getattr(target, key) is not None and target.kind not in kinds:
            raise ShootError(
                f"{key} has no meaning for a {target.kind}",
                where=where,
                remedy=f"leave it out, or say kind = {_or(kinds)}",
            )
    for key in _NEEDED_BY.get(target.kind, ()):
        if getattr(target, key) is None:
            raise ShootError(f'a {target.kind} needs "{key}"; add it', where=where)
    for key in ("hole_diameter_mm", "line_width_mm"):
        size = getattr(target, key)
        if size is not None and size >= min(target.pitch_xy_mm):
            raise ShootError(
                f"{key} = {size:g} is not smaller than pitch_mm = "
                f"{min(target.pitch_xy_mm):g}",
                where=where,
                remedy="both are millimetres on the target",
            )


def _check_takes(
    takes: list[Take], targets: dict[str, Target], camera: Camera, path: Path
) -> None:
    seen: dict[Path, int] = {}
    for number, take in enumerate(takes, 1):
        where = f"{path}: [[take]] {number} ({take.image})"
        image = (path.parent / take.image).resolve()
        if image in seen:
            raise ShootError(
                f"is the photograph of [[take]] {seen[image]} again",
                where=where,
                remedy="keep one take for each photograph",
            )
        seen[image] = number
        check_names(take.target, take.encoding, targets, where)
        _check_roi(take, where)
        if take.focal_length_mm is not None and camera.sensor_width_mm is not None:
            check_focal_length(take.focal_length_mm, camera.sensor_width_mm, where)
        _check_distances(take, where)


def check_names(
    target: str | None, encoding: str | None, targets: Collection[str], where: str
) -> None:
    """Refuse a target that the file does not have, or an encoding that nothing reads.

    Raises
    ------
    ShootError : One of them is unknown.
    """
    if target is not None and target not in targets:
        raise ShootError(
            f'no target is named "{target}"',
            where=where,
            remedy=did_you_mean(target, list(targets)),
        )
    if encoding is not None and encoding not in ENCODINGS:
        raise ShootError(
            f'encoding "{encoding}" is unknown',
            where=where,
            remedy=did_you_mean(encoding, list(ENCODINGS)),
        )


def _check_roi(take: Take, where: str) -> None:
    if take.roi is None:
        return
    x0, y0, x1, y1 = take.roi
    if x0 < 0 or y0 < 0 or x1 <= x0 or y1 <= y0:
        raise ShootError(
            f"roi = {list(take.roi)} is no box inside the image",
            where=where,
            remedy="write [x0, y0, x1, y1] in pixels, left top right bottom",
        )


def _check_distances(take: Take, where: str) -> None:
    """A distance shorter than the focal length is nearly always in metres."""
    for key in ("focus_distance_mm", "target_distance_mm"):
        distance = getattr(take, key)
        if None not in (distance, take.focal_length_mm) and (
            distance <= take.focal_length_mm
        ):
            raise ShootError(
                f"{key} = {distance:g} is not beyond the focal length "
                f"{take.focal_length_mm:g} mm",
                where=where,
                remedy="distances are from the sensor, in millimetres",
            )


def _unused_target_notes(tables: ShootFile) -> tuple[str, ...]:
    used = {take.target for take in tables.take}
    return tuple(
        f'target "{target.name}" is in no take'
        for target in tables.target
        if target.name not in used
    )


def _or(words: tuple[str, ...]) -> str:
    return " or ".join(f'"{word}"' for word in words)
