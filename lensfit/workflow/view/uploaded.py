"""Photographs that a page hands over, written into the folder of a shoot.

A name is a plain file name of a photograph; nothing is ever replaced; a file appears
when the last of it is there.
"""

import os
import tempfile
from collections.abc import AsyncIterator
from pathlib import Path

from lensfit.errors import ImageError, OutputError
from lensfit.workflow.check.watched_folder import SUFFIXES

LARGEST_BYTES = 2**30
_LONGEST_NAME = 200


def photograph_path(folder: Path, name: str) -> Path:
    """Where a photograph of that name will lie.

    Raises
    ------
    ImageError : That is no name of a photograph, or there is one already.
    """
    is_plain = name == Path(name).name and "\\" not in name and name.isprintable()
    if not is_plain or name.startswith(".") or len(name) > _LONGEST_NAME:
        raise ImageError(f"{name[:80]!r} is no plain file name")
    if Path(name).suffix.lower() not in SUFFIXES:
        known = ", ".join(sorted(SUFFIXES))
        raise ImageError("is no photograph", where=name, remedy=f"give one of {known}")
    path = folder / name
    if path.exists():
        raise ImageError(
            "is there already", where=path, remedy="give the photograph another name"
        )
    return path


async def keep_photograph(path: Path, content: AsyncIterator[bytes]) -> None:
    """Write what arrives; nothing of it stays where it ends before its time.

    Raises
    ------
    OutputError : It cannot be written.
    """
    try:
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=".arriving.")
    except OSError as error:
        raise _cannot(path, error) from error
    try:
        with os.fdopen(handle, "wb") as file:
            async for piece in content:
                file.write(piece)
        os.chmod(temporary, 0o644)
        os.link(temporary, path)  # never in place of another
    except OSError as error:
        raise _cannot(path, error) from error
    finally:
        os.unlink(temporary)


def _cannot(path: Path, error: OSError) -> OutputError:
    return OutputError(f"cannot be written ({error.strerror})", where=path)
