"""Save adjustments to a settings file without changing the rest of it.

A file written in a way that `lensfit.workflow.shoot.toml_lines` does not understand is
left alone.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from lensfit.atomic import write_text_atomic
from lensfit.errors import SettingsError
from lensfit.plate.camera.settings import load_settings
from lensfit.workflow.shoot.toml_lines import with_keys
from lensfit.workflow.view.lens_adjustments import number_text, whole_if_it_is

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
