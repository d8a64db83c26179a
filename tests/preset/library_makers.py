"""Libraries for tests: a project with a sequence and a shot, and saves into it."""

from pathlib import Path

from preset_makers import make_entry, make_preset

from lensfit.preset.library.edit import (
    Author,
    Kept,
    RequestedEdit,
    edit_preset,
    keep_preset,
)
from lensfit.preset.library.layers import FoundPreset
from lensfit.preset.library.levels import levels_of, mark_project
from lensfit.preset.schema import Preset

SLUG = "smc-takumar-50-1-4_1234567"
ENTRY = "entries[focal_length_mm=50,focus_distance_mm=2000]"
SQUEEZE = f"{ENTRY}.distortion.squeeze"


def make_show(folder: Path) -> tuple[Path, Path, Path]:
    """Folders of a marked project, a sequence and a shot."""
    shot = folder / "show" / "sq010" / "sh0020"
    shot.mkdir(parents=True)
    mark_project(folder / "show", "ana")
    return folder / "show", shot.parent, shot


def keep(
    library: Path,
    preset: Preset | None = None,
    *,
    default: bool = False,
    note: str = "",
) -> Kept:
    """Save a preset at a level."""
    preset = preset or make_preset(make_entry())
    return keep_preset(
        preset, levels_of(library)[0], who="ana", note=note, default=default
    )


def change(
    library: Path, key: str, value: object, *, name: str = SLUG, unlock: bool = False
) -> FoundPreset:
    """One edit at a level."""
    wishes = [RequestedEdit(key, value)]
    author = Author("bo", "by the look of it")
    return edit_preset(name, wishes, author, library=library, unlock=unlock)
