"""Ctrl-C inside callbacks and finalisers, where Python drops it."""

import gc
import os
import signal
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Iterator

import pytest

from lensfit.cli._door import _follows_interrupt, interruptible

pytestmark = pytest.mark.skipif(
    not hasattr(signal, "setitimer"), reason="needs a timer"
)


HEARD_WITHIN_S = 1.0
"""What drops an interrupt goes on for so long, unless it ends it after all."""


@pytest.fixture(autouse=True)
def _heard() -> Iterator[None]:
    """A run in the background begins with Ctrl-C ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def interrupt_now(*_) -> None:
    os.kill(os.getpid(), signal.SIGINT)
    for _ in range(1000):  # the signal is handled between two steps
        pass


class Finalised:
    def __del__(self):
        interrupt_now()


def in_a_callback() -> None:
    gc.callbacks.append(interrupt_now)
    gc.collect()
    gc.callbacks.remove(interrupt_now)
    time.sleep(HEARD_WITHIN_S)


def in_a_finaliser() -> None:
    Finalised()
    time.sleep(HEARD_WITHIN_S)


class Interrupting(dict):
    def __delitem__(self, key):
        interrupt_now()


def in_a_weak_reference() -> None:
    known: weakref.WeakKeyDictionary[object, int] = weakref.WeakKeyDictionary()
    known.data = Interrupting()
    key = threading.Event()
    known[key] = 1
    del key
    time.sleep(HEARD_WITHIN_S)


EVERYWHERE = in_a_callback, in_a_finaliser, in_a_weak_reference, interrupt_now


@pytest.mark.parametrize("there", EVERYWHERE)
def test_it_is_raised_and_all_is_restored(there):
    before = signal.getsignal(signal.SIGALRM)
    with pytest.raises(KeyboardInterrupt), interruptible():
        there()
    assert interrupt_now not in gc.callbacks
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert signal.getsignal(signal.SIGALRM) is before


def test_what_others_chose_stays():
    def elsewhere() -> None:
        with interruptible():
            seen.append(signal.getsignal(signal.SIGINT))

    seen: list[object] = []
    thread = threading.Thread(target=elsewhere)
    thread.start()
    thread.join()
    assert seen == [signal.default_int_handler]
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with interruptible():
            assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_the_program_ends_in_one_line():
    """Though it would crash while Python is taken down, as threads of JAX do."""
    text = """
import atexit, gc, os, signal, time
atexit.register(os.abort)
from lensfit.cli import main
signal.signal(signal.SIGINT, signal.default_int_handler)
sent = []
def swallow(*_):
    if sent:
        return
    sent.append(True)
    os.kill(os.getpid(), signal.SIGINT)
    for _ in range(1000):
        pass
@main.app.command()
def collect():
    gc.callbacks.append(swallow)
    gc.collect()
    time.sleep(20)
main.main()
"""
    run = subprocess.run(
        [sys.executable, "-c", text, "collect"],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert run.returncode == 1
    assert run.stderr == "lensfit: error: interrupted\n"


def test_the_end_of_a_farms_task_is_an_interrupt():
    def end() -> None:
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(HEARD_WITHIN_S)

    for in_the_background in (False, True):
        if in_the_background:  # where Ctrl-C is ignored
            signal.signal(signal.SIGINT, signal.SIG_IGN)
        with pytest.raises(KeyboardInterrupt), interruptible():
            end()
    assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


def test_an_error_that_is_its_own_cause_follows_no_interrupt():
    error = ValueError("again")
    error.__cause__ = error
    assert not _follows_interrupt(error)
    error.__cause__ = KeyboardInterrupt()
    assert _follows_interrupt(error)
