"""Keep pictures that are decoded from filling the memory, or the terminal.

A compressed file of a few megabytes can hold, or claim, tens of gigabytes of one value.
So before a picture is decoded, what it and the work on it take is computed from its
header, and compared with the memory that is there.

OpenEXR, OpenJPH, libpng and OpenCV write to the standard streams of the process when a
picture is damaged, and OpenEXR's binding to Python's own output, where ``--json``
results go. lensfit reports the fault itself, in one line. Whatever else is printed
meanwhile, by another thread, is passed on when the last picture is decoded.
"""

import ctypes
import os
import re
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from lensfit.errors import ImageError
from lensfit.memory import available_bytes

PHOTOGRAPH_BYTES_PER_PX = 24
"""Of the work on a photograph: its colours as float, twice."""
RASTER_BYTES_PER_SAMPLE = 12
"""Of PNG and TIFF, decoded: the code, and the light as float, twice."""


def refuse_beyond_memory(needed_bytes: int, path: Path | None = None) -> None:
    """Refuse a picture that would fill the memory, before it is decoded.

    Parameters
    ----------
    needed_bytes : Of all samples of the file, decoded, and of the work on them.
    path : The file; None where whoever asked names it.

    Raises
    ------
    ImageError : More than is available.
    """
    available = available_bytes()
    if available is not None and needed_bytes > available:
        raise ImageError(
            f"takes {_gib(needed_bytes)} GiB of memory when decoded, and "
            f"{_gib(available)} GiB are available",
            where=path,
            remedy="crop it, leave out channels, or use a machine with more memory",
        )


def _gib(count: int) -> str:
    return f"{count / 2**30:.3g}"


_LINE = re.compile(
    rb".*: \(EXR_ERR_\w+\) .*|ojph (?:error|warning|info) .*|libpng \w+: .*"
    rb"|\[ ?(?:FATAL|ERROR|WARN|INFO|DEBUG):\d+@[\d.]+\] .*|Corrupt JPEG data: .*"
)
_STREAMS = (1, 2)


@contextmanager
def silenced_libraries() -> Iterator[None]:
    """Keep what the decoding libraries print from being seen.

    What Python prints is filtered for this thread alone, what the process writes by
    line; pictures may be decoded by several threads at once.
    """
    this = threading.get_ident()
    with _lock:
        if not _threads:
            sys.stdout = _Filter(sys.stdout)
            _open_aside()
        _threads[this] = _threads.get(this, 0) + 1
    try:
        yield
    finally:
        with _lock:
            _threads[this] -= 1
            if not _threads[this]:
                del _threads[this]
            if not _threads:
                if isinstance(sys.stdout, _Filter):
                    sys.stdout = sys.stdout.stream
                _close_aside()


_lock = threading.Lock()
_threads: dict[int, int] = {}
_aside: list[tuple[int, int, IO[bytes]]] = []
"""A stream's number, its true end and what stands in its place, while there is such."""


class _Filter:
    """Standard output without what the decoding threads print."""

    def __init__(self, stream):
        self.stream = stream

    def write(self, text: str) -> int:
        if threading.get_ident() in _threads:
            return len(text)
        return self.stream.write(text)

    def __getattr__(self, name: str):
        return getattr(self.stream, name)


def _open_aside() -> None:
    _flush()
    for stream in _STREAMS:
        try:
            true = os.dup(stream)
        except OSError:
            continue  # a service may have none
        try:
            aside = tempfile.TemporaryFile()  # noqa: SIM115
        except OSError:
            os.close(true)
            return  # a full disk must not keep a picture from being read
        os.dup2(aside.fileno(), stream)
        _aside.append((stream, true, aside))


def _close_aside() -> None:
    _flush()
    while _aside:
        stream, true, aside = _aside.pop()
        os.dup2(true, stream)
        os.close(true)
        with aside, suppress(OSError):  # nobody may be listening any more
            aside.seek(0)
            for line in aside:
                if not _LINE.fullmatch(line.rstrip(b"\r\n")):
                    os.write(stream, line)


def _flush() -> None:
    """Have C's own buffers written where they belong."""
    with suppress(OSError, AttributeError, TypeError):  # not on Windows
        ctypes.CDLL(None).fflush(None)
