"""Ctrl-C that always ends the run.

Python drops what is raised inside a callback of its garbage collector (JAX has one) or
inside a finaliser: it prints "Exception ignored" and the job goes on. There the
interrupt waits a moment and tries again.
"""

import gc
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_AGAIN_S = 0.02


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
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        signal.signal(signal.SIGALRM, alarm)


def _interrupt(_number: int, frame: FrameType | None) -> None:
    if _is_unheard(frame):
        signal.setitimer(signal.ITIMER_REAL, _AGAIN_S)
    else:
        raise KeyboardInterrupt


def _is_unheard(frame: FrameType | None) -> bool:
    """Whether Python drops what is raised here."""
    callbacks = {getattr(callback, "__code__", None) for callback in gc.callbacks}
    while frame is not None:
        if frame.f_code in callbacks or frame.f_code.co_name == "__del__":
            return True
        frame = frame.f_back
    return False
