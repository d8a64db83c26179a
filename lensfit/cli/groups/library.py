"""The library on the command line: where presets are looked up by name."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from lensfit.preset.library.layers import FoundPreset
    from lensfit.preset.library.levels import Level

PRESET_HELP = (
    "Preset: a file, or a lens of the library as NAME, NAME@v002 or LEVEL:NAME@v002"
)


@dataclass(frozen=True)
class LibraryGroup:
    """Where lenses have names."""

    library: Annotated[
        Path | None,
        typer.Option(
            help="Deepest folder whose lenses are known by name: a shot, a sequence or "
            "a project; the user's own if left out",
            envvar="LENSFIT_LIBRARY",
        ),
    ] = None

    def find(self, preset: str) -> "FoundPreset":
        """What a path or a name means; remarks on it go to standard error."""
        from lensfit.cli._door import say_note
        from lensfit.preset.library.layers import find_preset

        found = find_preset(preset, self.library)
        for note in found.notes:
            say_note(note)
        return found

    def file(self, preset: str) -> "tuple[Path, FoundPreset | None]":
        """The file that a path or a name means, and what it was put together from
        where later edits around it would change that. A plain file is not looked into.
        """
        from lensfit.preset.library.levels import LENSES

        path = Path(preset)
        if path.is_file() and path.absolute().parent.parent.name != LENSES:
            return path, None
        found = self.find(preset)
        return found.path, found if len(found.parts) > 1 else None

    def levels(self) -> "tuple[Level, ...]":
        """Nearest first."""
        from lensfit.preset.library.levels import levels_of

        return levels_of(self.library)


def user_name(stated: str | None) -> str:
    """Who it is, for the record.

    Raises
    ------
    LensfitError : Neither was it stated nor does the system know.
    """
    import getpass

    from lensfit.errors import LensfitError

    if stated is not None:
        return stated
    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError) as error:
        raise LensfitError(
            "the system does not know who you are", remedy="say it with --who"
        ) from error
