"""Keep the output of libraries that decode a damaged picture off the terminal.

OpenEXR, OpenJPH, libpng and OpenCV write to the standard streams of the process, and
OpenEXR's binding to Python's own output, where ``--json`` results go. lensfit reports
the fault itself, in one line. Whatever else is printed meanwhile, by another thread, is
passed on when the last picture is decoded.
"""

import ctypes
import os
import re
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import IO

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
