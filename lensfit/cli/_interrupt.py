"""Ctrl-C that always ends the run.

Python drops what is raised inside a callback of its garbage collector (JAX has one), of
a weak reference or inside a finaliser: it prints "Exception ignored" and the job goes
on. There the interrupt waits a moment and tries again. Threads of libraries may then be
in the middle of a program, and crash while Python is taken down around them: an
interrupted run ends without that.
"""

import gc
import os
import signal
import sys
import threading
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_AGAIN_S = 0.02
_WEAK = {
    kind.__init__.__code__.co_filename
    for kind in (weakref.WeakKeyDictionary, weakref.WeakSet)
}
"""Where the callbacks of weak references stand."""


@contextmanager
def interruptible() -> Iterator[None]:
    """Raise KeyboardInterrupt where it is heard, as long as this context lasts.

    Only in the main thread, which alone may handle signals, and only where nobody has
    chosen otherwise: a run in the background ignores Ctrl-C.
    """
    python_s = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    is_main = threading.current_thread() is threading.main_thread()
    if not (python_s and is_main and hasattr(signal, "setitimer")):
        yield
        return
    alarm = signal.signal(signal.SIGALRM, _interrupt)
    signal.signal(signal.SIGINT, _interrupt)
    try:
        yield
    except SystemExit as end:
        if _follows_interrupt(end):
            _end_at_once(end)
        raise
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        signal.signal(signal.SIGALRM, alarm)


def _interrupt(_number: int, frame: FrameType | None) -> None:
    if _is_unheard(frame):
        signal.setitimer(signal.ITIMER_REAL, _AGAIN_S)
    else:
        raise KeyboardInterrupt


def _follows_interrupt(error: BaseException | None) -> bool:
    while error is not None:
        if isinstance(error, KeyboardInterrupt):
            return True
        error = error.__cause__ or error.__context__
    return False


def _end_at_once(end: SystemExit) -> None:
    """With what was printed, and the exit code; files were taken care of before."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(end.code if isinstance(end.code, int) else 1)


def _is_unheard(frame: FrameType | None) -> bool:
    """Whether Python drops what is raised here."""
    callbacks = {getattr(callback, "__code__", None) for callback in gc.callbacks}
    while frame is not None:
        code = frame.f_code
        weak = code.co_filename in _WEAK
        if weak or code in callbacks or code.co_name == "__del__":
            return True
        frame = frame.f_back
    return False
