"""Read files of unknown origin within bounds.

A file comes from another program, a card reader, a mail or a typing error: what is no
ordinary file, is larger than any of its kind or is no text is refused before it is
parsed, so that it costs one error line, not the machine.
"""

from pathlib import Path

from lensfit.errors import LensfitError


def refuse_pipe(
    path: Path, *, error: type[LensfitError], remedy: str | None = None
) -> None:
    """Refuse a folder, a pipe or a device, which nobody may wait for.

    Parameters
    ----------
    error : Raised, naming `path`; what is not there at all is left to whoever opens it.
    remedy : What to do about it.
    """
    if path.exists() and not path.is_file():
        raise error("is no ordinary file", where=path, remedy=remedy)


def read_beginning(
    path: Path,
    most_bytes: int,
    *,
    error: type[LensfitError],
    remedy: str | None = None,
) -> bytes:
    """The first bytes of a file, or all of it if it is shorter.

    Parameters
    ----------
    error : Raised, naming `path`, when it does not exist, is a folder, a pipe or a
        device (which may never end), or cannot be read.
    remedy : What to do about it.
    """
    try:
        refuse_pipe(path, error=error, remedy=remedy)
        with path.open("rb") as file:
            return file.read(most_bytes)
    except (OSError, ValueError) as reason:
        said = getattr(reason, "strerror", None) or reason
        raise error(f"cannot be read ({said})", where=path, remedy=remedy) from reason


def read_bounded(
    path: Path,
    most_bytes: int,
    *,
    error: type[LensfitError],
    remedy: str | None = None,
    too_large: str | None = None,
) -> bytes:
    """All that a file holds.

    Parameters
    ----------
    most_bytes : Of the file; no more is read.
    error : Raised as by `read_beginning`, and when there is more.
    remedy, too_large : What to do about the one, and about the other, if not the same.
    """
    content = read_beginning(path, most_bytes + 1, error=error, remedy=remedy)
    if len(content) > most_bytes:
        raise error(
            f"is larger than {most_bytes / 2**20:g} MiB, which no such file is",
            where=path,
            remedy=too_large or remedy,
        )
    return content


def utf8_text(
    content: bytes,
    path: Path,
    *,
    error: type[LensfitError],
    remedy: str | None = None,
) -> str:
    """What a file holds as text, without a byte order mark.

    Parameters
    ----------
    error : Raised, naming `path`, when it is no UTF-8 or holds NUL bytes.
    remedy : What to do about it.
    """
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as reason:
        what = f"is not text in UTF-8 (byte {reason.start})"
        raise error(what, where=path, remedy=remedy) from reason
    if "\0" in text:
        raise error("is not text (it holds NUL bytes)", where=path, remedy=remedy)
    return text
