"""The record of each lens of a kit beside its results, by which a run resumes.

The record holds a fingerprint of all that a calibration reads. A lens whose record has
the same fingerprint, and whose results exist, is done; one that failed is tried again,
since the cause may be gone.
"""

import hashlib
import json
from pathlib import Path
from typing import Any

import msgspec

from lensfit import __version__
from lensfit.atomic import write_text_atomic
from lensfit.workflow.calibration.results_folder import PRESET, REPORT
from lensfit.workflow.shoot.shoot_records import Shoot

RECORD = "kit_lens.json"
_SCHEMA = "lensfit.kit_lens.1"


def fingerprint(shoot: Shoot, effort: str) -> str:
    """Of the shoot as stated, its photographs and how they are calibrated.

    Photographs count by name, size and time of their last change: to read all of them
    would take as long as to find their dots.
    """
    stated = {
        "version": __version__,
        "effort": effort,
        "lens": msgspec.to_builtins(shoot.lens),
        "camera": msgspec.to_builtins(shoot.camera),
        "targets": msgspec.to_builtins(list(shoot.targets.values())),
        "takes": [repr(take) for take in shoot.takes],
        "files": [_stamp(shoot.image_path(take)) for take in shoot.takes],
    }
    text = json.dumps(stated, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:24]


def write_record(
    folder: Path, made_of: str, failed: str | None, facts: dict[str, Any] | None
) -> None:
    """Keep what became of a lens.

    Raises
    ------
    OutputError : The folder cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    record = {
        "schema": _SCHEMA,
        "fingerprint": made_of,
        "failed": failed,
        "facts": facts,
    }
    write_text_atomic(folder / RECORD, json.dumps(record, indent=1))


def read_record(folder: Path) -> dict[str, Any] | None:
    """The record of a lens; None where there is none that can be read."""
    try:
        record = json.loads((folder / RECORD).read_text(encoding="utf-8"))
        return record if record["schema"] == _SCHEMA else None
    except (OSError, ValueError, TypeError, LookupError):
        return None


def is_done(folder: Path, made_of: str) -> bool:
    """Whether the results of this very shoot are there."""
    record = read_record(folder)
    if record is None or record["fingerprint"] != made_of or record["failed"]:
        return False
    return all((folder / name).is_file() for name in (PRESET, REPORT))


def _stamp(path: Path) -> list[Any]:
    try:
        found = path.stat()
    except OSError:
        return [path.name]
    return [path.name, found.st_size, found.st_mtime_ns]
