"""Save adjusted knobs as an edit of a lens of the library: who, when and why."""

from pathlib import Path
from typing import NamedTuple

from lensfit.errors import PresetError
from lensfit.preset.library.edit import Author, RequestedEdit, edit_preset
from lensfit.workflow.view.lens_adjustments import LensAdjustments, whole_if_it_is


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
