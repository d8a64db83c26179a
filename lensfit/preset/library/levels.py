"""Levels of a library: the shot first, then its sequence, then the project.

Any folder may be a level; its presets lie under ``lenses/LENS/``. From the folder that
is named, parents are levels too, up to one that is marked as a project (it holds
``lenses/project.json``). Without such a mark the named folder stands alone: a stray
folder higher up never takes part.
"""

import os
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from lensfit.atomic import claim, written_aside
from lensfit.errors import OutputError, PresetError

LENSES = "lenses"
ENVIRONMENT = "LENSFIT_LIBRARY"
_PROJECT = "project.json"


class Level(NamedTuple):
    """One folder of presets.

    Attributes
    ----------
    folder : Absolute; holds `lenses`.
    label : "project", "sq010", "sq010/sh0020"; "library" for one that stands alone.
    """

    folder: Path
    label: str

    @property
    def lenses(self) -> Path:
        """The folder of folders of lenses."""
        return self.folder / LENSES

    def shelf_folder(self, slug: str) -> Path:
        """The folder of one lens, which may not exist yet.

        Raises
        ------
        PresetError : A symbolic link leads out of the level.
        """
        folder = self.lenses / slug
        check_inside(self.folder, folder)
        return folder

    def slugs(self) -> list[str]:
        """Folders of lenses, in order."""
        from lensfit.preset.library.versions import is_slug

        try:
            found = sorted(os.listdir(self.lenses))
        except OSError:
            return []
        return [n for n in found if is_slug(n) and (self.lenses / n).is_dir()]


def check_inside(folder: Path, path: Path) -> None:
    """Refuse a path that links take out of a folder.

    Raises
    ------
    PresetError : `path` really lies outside `folder`.
    """
    root, real = os.path.realpath(folder), os.path.realpath(path)
    if os.path.commonpath([root, real]) != root:
        raise PresetError(
            "is or lies behind a symbolic link that leads out of the library",
            where=path,
            remedy="put the presets themselves there",
        )


def library_folder(named: Path | None = None) -> Path:
    """The named folder, or that of the environment, or the user's own."""
    if named is None and os.environ.get(ENVIRONMENT):
        named = Path(os.environ[ENVIRONMENT])
    if named is not None:
        return named
    import platformdirs

    return Path(platformdirs.user_data_dir("lensfit", appauthor=False))


def levels_of(library: Path | None = None) -> tuple[Level, ...]:
    """The levels of a library, nearest first.

    Parameters
    ----------
    library : The deepest level; see `library_folder` if None.

    Raises
    ------
    PresetError : A folder was named and is none.
    """
    nearest = Path(os.path.abspath(library_folder(library)))
    named = library is not None or os.environ.get(ENVIRONMENT)
    if named and not nearest.is_dir():
        raise PresetError(
            "is no folder",
            where=nearest,
            remedy=f"name a library with --library or {ENVIRONMENT}; to begin one, "
            'make the folder and mark that of a project with "lensfit preset project"',
        )
    above = [nearest]
    for folder in (nearest, *nearest.parents):
        if (folder / LENSES / _PROJECT).is_file():
            return tuple(Level(one, _label(one, folder)) for one in above)
        if folder.parent != folder:
            above.append(folder.parent)
    return (Level(nearest, "library"),)


def _label(folder: Path, project: Path) -> str:
    return "project" if folder == project else folder.relative_to(project).as_posix()


def mark_project(folder: Path, who: str) -> bool:
    """Make a folder the root of a project; False if it is one already.

    Raises
    ------
    OutputError : It is no folder, or cannot be written.
    """
    from lensfit.preset.store import to_json_text

    if not folder.is_dir():
        raise OutputError("is no folder", where=folder, remedy="make it first")
    path = folder / LENSES / _PROJECT
    check_inside(folder, path)
    said = {"schema": "lensfit.project.1", "who": who, "when": now()}
    with written_aside(path, to_json_text(said).encode()) as temporary:
        return claim(temporary, path)


def now() -> str:
    """Date and time, ISO 8601, UTC."""
    return datetime.now(UTC).isoformat(timespec="seconds")
