"""The folder of a calibration's results: checked, then written all at once.

Everything of one lens lies together, and a second run replaces it. The results of two
lenses in one folder would be the preset of one beside UV maps and overlays of both.

The results are an atomic output set (`lensfit.atomic_set`): a map beside a preset, or
an overlay in a report, is always of the same run. Files that the earlier report names
and the new run did not write are removed; nothing else is, since a folder of results
may hold its owner's files too.

A run that fails leaves the earlier results alone. Pictures of the points that it
detected show why it failed, so they are kept in a folder whose name says so, and the
error names it; the next run replaces them.
"""

import json
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from lensfit.atomic_set import atomic_output_set, move_all, taken_back_if_empty
from lensfit.errors import LensfitError, OutputError, PresetError
from lensfit.preset.schema import Preset
from lensfit.preset.store import load_preset
from lensfit.report.wipe import MODEL_PICTURES
from lensfit.workflow.shoot.shoot_records import Shoot

PRESET = "preset.json"
OVERLAYS = "overlays"
FOLDERS = (OVERLAYS, "stmaps", "model", "blur")
FAILED = "overlays_failed"
"""Of a run that ended in an error; beside a report they must not pass for its own."""
_ANOTHER = "choose another --out, or remove the folder first"


def results_folder(out_dir: str | Path, shoot: Shoot) -> Path:
    """The folder for the results of a shoot, made if it is missing.

    Parameters
    ----------
    out_dir : May hold an earlier calibration of the same lens, which is replaced.

    Raises
    ------
    OutputError : It cannot be made or written, or holds another lens or camera.
    """
    folder = Path(out_dir)
    _require_same_lens(folder / PRESET, shoot)
    for written in (folder, *map(folder.joinpath, (*FOLDERS, FAILED))):
        if written == folder or written.exists():
            require_writable_folder(written)
    return folder


def require_writable_folder(folder: Path) -> None:
    """Make a folder, before seconds or hours go into what could not be kept.

    Raises
    ------
    OutputError : It cannot be made or written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise OutputError(
            f"the folder cannot be written ({error.strerror})",
            where=folder,
            remedy="choose another --out",
        ) from error


def _require_same_lens(path: Path, shoot: Shoot) -> None:
    """What nobody stated, then or now, is no difference."""
    if not path.exists():
        return
    try:
        found = load_preset(path)
    except PresetError as error:
        raise OutputError(
            f"holds a {PRESET} that cannot be read", where=path.parent, remedy=_ANOTHER
        ) from error
    for what, was, is_now in _compared_identities(found, shoot):
        if None not in (was, is_now) and was != is_now:
            raise OutputError(
                f'holds the calibration of {what} "{was}", and this is "{is_now}"',
                where=path.parent,
                remedy=_ANOTHER,
            )


def _compared_identities(
    found: Preset, shoot: Shoot
) -> list[tuple[str, str | None, str | None]]:
    return [
        ("the lens", found.lens.name, shoot.lens.name),
        ("the lens of serial", found.lens.serial, shoot.lens.serial),
        ("a lens on the camera", found.camera.model, shoot.camera.model),
    ]


REPORT = "report.json"
_LAST = (PRESET, "report.html", REPORT)


@contextmanager
def atomic_results(out_dir: str | Path, shoot: Shoot) -> Iterator[Path]:
    """A folder to write the results of a shoot to; they move on if the block ends well.

    If it ends in a `LensfitError`, overlays move to ``out_dir/overlays_failed``; if in
    anything else, as Ctrl-C, nothing does.

    Parameters
    ----------
    out_dir : May hold an earlier calibration of the same lens, which is replaced.

    Raises
    ------
    LensfitError : The folder cannot be made or written, or holds another lens or
        camera; or that of the block.
    """
    with taken_back_if_empty(Path(out_dir)):
        folder = results_folder(out_dir, shoot)
        replaces = [*files_of_report(folder / REPORT), *_failed_overlays(folder)]
        with atomic_output_set(folder, last=_LAST, replaces=replaces) as made:
            try:
                yield made
            except LensfitError as error:
                remedy = error.remedy
                if _keep_overlays(made, folder):
                    seen = f"the detected points are drawn in {folder / FAILED}"
                    remedy = f"{remedy}; {seen}" if remedy else seen
                where = _final_place(error.where, made, folder)
                raise type(error)(error.what, where=where, remedy=remedy) from error


def _final_place(
    where: str | Path | None, made: Path, folder: Path
) -> str | Path | None:
    """A file of the hidden folder by the name that it would have had."""
    if where is None or not Path(where).is_relative_to(made):
        return where
    return folder / Path(where).relative_to(made)


def files_of_report(path: Path) -> list[Path]:
    """UV maps and pictures that a report names, relative to its folder.

    Only such as a calibration writes, in folders that it makes; none if there is no
    report, or it cannot be read.
    """
    try:
        report = json.loads(path.read_text(encoding="utf-8"))
        if not report["schema"].startswith("lensfit.report."):
            return []
        named = [Path(name) for name in _names(report) if isinstance(name, str)]
    except (OSError, ValueError, TypeError, LookupError, AttributeError):
        return []
    return [name for name in named if _is_own(name)]


def _names(report: dict[str, Any]) -> list[Any]:
    takes = report.get("takes") or []
    names = [take.get("overlay") for take in takes]
    for modelled in [take.get("modelled") or {} for take in takes]:
        names += [modelled.get(key) for key in MODEL_PICTURES]
    for blur in report.get("blur") or []:
        names += [take.get("picture") for take in blur.get("takes") or []]
    return names + list((report.get("files") or {}).get("stmaps") or [])


def _is_own(name: Path) -> bool:
    """A report from elsewhere may name anything."""
    parts = name.parts
    return len(parts) == 2 and parts[0] in FOLDERS and parts[1] != ".."


def _failed_overlays(folder: Path) -> list[Path]:
    """Of the run before, if that failed."""
    return [Path(FAILED, path.name) for path in (folder / FAILED).glob("*.png")]


def _keep_overlays(made: Path, folder: Path) -> bool:
    """Move the overlays of a run that fails to where they belong: whether any were."""
    earlier = [Path(path.name) for path in _failed_overlays(folder)]
    drawn = any((made / OVERLAYS).glob("*.png"))
    move_all(made / OVERLAYS, folder / FAILED, replaces=earlier)
    return drawn
