"""Write outputs whole or not at all.

Everything lensfit writes goes first to a temporary file in the *same folder* and
is then renamed over its final name, which POSIX and Windows do in one step. A killed
job leaves the old file, or nothing, never half of a new one; the name of the temporary
file that it may leave behind holds its owner, and `remove_abandoned` removes it.

A file that must never replace another (a numbered version) is linked to its name
instead: of many writers, on many machines, the file system lets exactly one succeed.
"""

import errno
import hashlib
import os
import shutil
import socket
import tempfile
from collections.abc import Callable, Iterator
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
            raise cannot_write(path, error) from error
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
            raise cannot_write(Path(path), error) from error


def write_folder_summary(path: str | Path, summary: Callable[[], str]) -> None:
    """Write what a folder holds, while other processes may be adding to it.

    Each looks again after it has written, and writes again if the folder has changed.
    So the last to write has seen what every other one had added, without a lock, which
    not every file system of a farm has.

    Parameters
    ----------
    summary : Text of the folder as it is at the moment of the call.

    Raises
    ------
    OutputError : The file cannot be written.
    """
    text, written = summary(), None
    while text != written:
        write_text_atomic(path, text)
        text, written = summary(), text


@contextmanager
def written_aside(path: str | Path, content: bytes) -> Iterator[Path]:
    """`content` in a temporary file beside `path`, on the disk; removed afterwards.

    Parameters
    ----------
    path : Where the result may belong; its folder is made if missing.

    Raises
    ------
    OutputError : It cannot be written.
    """
    path = Path(path)
    temporary = _reserve(path)
    try:
        try:
            with temporary.open("wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            _give_ordinary_permissions(temporary)
        except OSError as error:
            raise cannot_write(path, error) from error
        yield temporary
    finally:
        temporary.unlink(missing_ok=True)


def claim(temporary: Path, path: Path) -> bool:
    """Give a file written aside its name, unless that is taken: whether it now has it.

    One of any number of writers gets the name, also on NFS, where an answer may be
    lost: two links of the temporary file prove success. Where there are no links, an
    empty file takes the name first; a crash just then leaves it, and the name is spent.

    Raises
    ------
    OutputError : The folder cannot be written.
    """
    try:
        try:
            os.link(temporary, path)
        except FileExistsError:
            return _is_same(temporary, path)
        except OSError as error:
            if _is_same(temporary, path):
                return True
            if error.errno not in _NO_LINKS:
                raise
            os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
            os.replace(temporary, path)
    except FileExistsError:
        return False
    except OSError as error:
        raise cannot_write(path, error) from error
    sync_folder(path.parent)
    return True


_NO_LINKS = (
    errno.EPERM,
    errno.ENOTSUP,
    errno.EOPNOTSUPP,
    errno.ENOSYS,
    errno.EINVAL,
    errno.EMLINK,
)
"""What file systems without hard links answer."""


def _is_same(temporary: Path, path: Path) -> bool:
    try:
        return os.path.samestat(os.lstat(temporary), os.lstat(path))
    except OSError:
        return False


def sync_folder(folder: Path) -> None:
    """Have the names in a folder survive a power cut, where the system can."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:
        return  # Windows opens no folders
    try:
        os.fsync(handle)
    except OSError:
        return
    finally:
        os.close(handle)


def remove_abandoned(path: str | Path) -> None:
    """Remove temporary files (or folders) of `path` whose process is no more.

    Those of other machines stay: nobody here knows whether they are at work.
    """
    path = Path(path)
    start, own = f".{path.stem}.{_machine()}-", f".{path.stem}.{owner()}."
    if not path.parent.is_dir():
        return
    for found in path.parent.iterdir():
        if not found.name.startswith(start) or found.name.startswith(own):
            continue
        process = found.name[len(start) :].split(".")[0]
        if not process.isdigit() or _is_alive(int(process)):
            continue
        if found.is_dir():
            shutil.rmtree(found, ignore_errors=True)
        else:
            found.unlink(missing_ok=True)


def _machine() -> str:
    return hashlib.sha256(socket.gethostname().encode()).hexdigest()[:8]


def owner() -> str:
    """Whose a temporary name is: this process on this machine."""
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
            dir=path.parent, prefix=f".{path.stem}.{owner()}.", suffix=path.suffix
        )
        os.close(handle)
    except OSError as error:
        raise cannot_write(path, error) from error
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


def cannot_write(path: Path, error: OSError) -> OutputError:
    """The error to raise where the system refuses to write `path`."""
    if isinstance(error, FileExistsError | NotADirectoryError):
        for folder in (path, *path.parents):
            if folder.exists() and not folder.is_dir():
                return OutputError("is a file", where=folder, remedy="give a folder")
    return OutputError(
        f"cannot be written ({error.strerror or error})",
        where=path,
        remedy="check that the folder exists, is writable and has room",
    )
