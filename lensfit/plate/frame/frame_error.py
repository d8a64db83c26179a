"""An error with the frame that it happened at."""

from pathlib import Path

from lensfit.errors import LensfitError


def error_at_frame(error: LensfitError, path: Path) -> LensfitError:
    """The error, named after the frame; it keeps its kind where it had no other place.

    Parameters
    ----------
    path : Of the frame.
    """
    if error.where is None:
        return type(error)(error.what, where=path, remedy=error.remedy)
    if Path(error.where) == path:
        return error
    what = f"{error.where}: {error.what}"
    return LensfitError(what, where=path, remedy=error.remedy)
