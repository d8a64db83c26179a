"""Outputs appear whole or not at all.

Everything lensfit writes goes first to a temporary file in the *same folder* and
is then renamed over its final name, which POSIX and Windows do in one step. A killed
job leaves the old file, or nothing, never half of a new one; the temporary file that it
may leave behind says whose it is, and `remove_abandoned` takes it away.
"""

import hashlib
import os
import socket
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Lock

from lensfit.errors import OutputError


@contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """A temporary path beside `path`; renamed to it when the block ends well.

    The temporary name keeps the suffix of `path`, since image writers choose their
    format by it, and starts with a dot. If the block raises, it is removed.

    Parameters
    ----------
    path : Where the result belongs; its folder is made if missing.

    Raises
    ------
    OutputError : The folder cannot be made or written, or the rename fails.
    """
    path = Path(path)
    temporary = _reserve(path)
    try:
        yield temporary
        _give_ordinary_permissions(temporary)
        try:
            os.replace(temporary, path)
        except OSError as error:
            raise _cannot_write(path, error) from error
    finally:
        temporary.unlink(missing_ok=True)


def write_text_atomic(path: str | Path, text: str) -> None:
    """Write `text` as UTF-8 with Unix line ends; whole or not at all."""
    write_bytes_atomic(path, text.encode("utf-8"))


def write_bytes_atomic(path: str | Path, content: bytes) -> None:
    """Write `content`; whole or not at all.

    Raises
    ------
    OutputError : The file cannot be written.
    """
    with atomic_path(path) as temporary:
        try:
            temporary.write_bytes(content)
        except OSError as error:
            raise _cannot_write(Path(path), error) from error


def remove_abandoned(path: str | Path) -> None:
    """Remove temporary files of `path` whose process, on this machine, is no more."""
    path = Path(path)
    start, own = f".{path.stem}.{_machine()}-", f".{path.stem}.{_owner()}."
    if not path.parent.is_dir():
        return
    for found in path.parent.iterdir():
        if not found.name.startswith(start) or found.name.startswith(own):
            continue
        process = found.name[len(start) :].split(".")[0]
        if process.isdigit() and not _is_alive(int(process)):
            found.unlink(missing_ok=True)


def _machine() -> str:
    return hashlib.sha256(socket.gethostname().encode()).hexdigest()[:8]


def _owner() -> str:
    return f"{_machine()}-{os.getpid()}"


def _is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True  # it is another user's
    return True


def _reserve(path: Path) -> Path:
    """An empty temporary file in the folder of `path`."""
    if path.is_dir():
        raise OutputError(
            "a folder of that name is in the way",
            where=path,
            remedy="name another output file",
        )
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(
            dir=path.parent, prefix=f".{path.stem}.{_owner()}.", suffix=path.suffix
        )
        os.close(handle)
    except OSError as error:
        raise _cannot_write(path, error) from error
    return Path(name)


_one_at_a_time = Lock()
"""The mask can only be read by setting it, for the whole process."""


def _give_ordinary_permissions(path: Path) -> None:
    """mkstemp makes files private; outputs follow the user's umask instead."""
    with _one_at_a_time:
        umask = os.umask(0)
        os.umask(umask)
    # The writer may have failed to make the file at all: os.replace then says so.
    if path.exists():
        path.chmod(0o666 & ~umask)


def _cannot_write(path: Path, error: OSError) -> OutputError:
    return OutputError(
        f"cannot be written ({error.strerror or error})",
        where=path,
        remedy="check that the folder exists, is writable and has room",
    )
