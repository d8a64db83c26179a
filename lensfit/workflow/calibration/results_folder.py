"""The folder of a calibration's results: checked to be writable and of the same lens.

Everything of one lens lies together, and a second run replaces it. The results of two
lenses in one folder would be the preset of one beside UV maps and overlays of both.
"""

import tempfile
from pathlib import Path

from lensfit.errors import OutputError, PresetError
from lensfit.preset.schema import Preset
from lensfit.preset.store import load_preset
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
    for what, was, is_now in _compared(found, shoot):
        if None not in (was, is_now) and was != is_now:
            raise OutputError(
                f'holds the calibration of {what} "{was}", and this is "{is_now}"',
                where=path.parent,
                remedy=_ANOTHER,
            )


def _compared(found: Preset, shoot: Shoot) -> list[tuple[str, str | None, str | None]]:
    return [
        ("the lens", found.lens.name, shoot.lens.name),
        ("the lens of serial", found.lens.serial, shoot.lens.serial),
        ("a lens on the camera", found.camera.model, shoot.camera.model),
    ]
