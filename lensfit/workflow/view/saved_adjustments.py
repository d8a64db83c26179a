"""Save adjustments: to a shot's settings file, or as an edit of a lens of the library.

The rest of a settings file is not changed; one that is written in a way that
`lensfit.workflow.shoot.toml_lines` does not understand is left alone. An edit has knobs
alone, with who, when and why.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from lensfit.atomic import write_text_atomic
from lensfit.errors import PresetError, SettingsError
from lensfit.plate.camera.settings import load_settings
from lensfit.preset.library.edit import Author, RequestedEdit, edit_preset
from lensfit.workflow.shoot.toml_lines import with_keys
from lensfit.workflow.view.lens_adjustments import (
    LensAdjustments,
    number_text,
    whole_if_it_is,
)

Tables = Mapping[str, Mapping[str, float]]


class SavedSettings(NamedTuple):
    """What became of a settings file.

    Attributes
    ----------
    changed : Whether it is another one now.
    notes : What is said where it does not suffice.
    """

    changed: bool
    notes: list[str]


def save_settings(path: Path, changes: Tables) -> bool:
    """Set keys of a settings file, which is made if it is not there; whole or not.

    False where it says so already, and stays untouched.

    Parameters
    ----------
    changes : Table, key and value.

    Raises
    ------
    SettingsError : The file is malformed, or is written so that its keys cannot be set.
    OutputError : It cannot be written.
    """
    old = ""
    if path.is_file():
        load_settings(path)  # what is malformed is refused in its own words
        old = path.read_text(encoding="utf-8")
    new = changed_text(old, changes, path)
    if new == old:
        return False
    write_text_atomic(path, new)
    return True


def changed_text(old: str, changes: Tables, path: Path) -> str:
    """The text of a settings file with other values.

    Raises
    ------
    SettingsError : Its keys cannot be set line by line.
    """
    text = old
    for table, values in changes.items():
        plain = {key: whole_if_it_is(value) for key, value in values.items()}
        changed = with_keys(text, table, plain)
        if changed is None:
            lines = "; ".join(
                f"{k} = {number_text(v)}"
                for t in changes.values()
                for k, v in t.items()
            )
            raise SettingsError(
                "is written so that its keys cannot be set one by one",
                where=path,
                remedy=f"set them by hand: {lines}",
            )
        text = changed
    return text


class LibraryLens(NamedTuple):
    """A lens as the library knows it.

    Attributes
    ----------
    name : Without its version: an edit is made to the one in use.
    library : The level that is edited; the user's own if None.
    """

    name: str
    library: Path | None


def save_edit(
    shelved: LibraryLens | None, wanted: LensAdjustments, author: Author
) -> str:
    """The full name of the version that the knobs are saved as.

    Parameters
    ----------
    shelved : None for a preset outside a library.

    Raises
    ------
    PresetError : It is in no library, no knob is adjusted, or the edit cannot be made.
    OutputError : The level cannot be written.
    """
    if shelved is None:
        raise PresetError(
            "the preset is a file outside a library, where nothing is on record",
            remedy='put it there with "lensfit preset save", and view it by its name',
        )
    wishes = [
        RequestedEdit(name, whole_if_it_is(v)) for name, v in wanted.knobs.items()
    ]
    if not wishes:
        raise PresetError(
            "no knob is adjusted; f-number and focus are of the shot, not of the lens",
            remedy="save these to the shot",
        )
    return edit_preset(shelved.name, wishes, author, library=shelved.library).full_name
