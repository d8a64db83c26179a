"""What every command shares: one-line errors, exit codes, Ctrl-C that ends the run.

0 is done, 2 is wrong usage (the parser says it), 1 is anything else, with one line on
standard error that says what is wrong, where and what to do. `--debug`, anywhere on
the command line, gives the traceback instead.

Python drops what is raised inside a callback of its garbage collector (JAX has one), of
a weak reference or inside a finaliser: it prints "Exception ignored" and the job goes
on. There an interrupt waits a moment and tries again. Threads of libraries may then be
in the middle of a program, and crash while Python is taken down around them: an
interrupted run ends without that. SIGTERM, with which farms end a task, is heard in the
same way: files that are half written are taken care of.
"""

import errno
import gc
import inspect
import itertools
import os
import re
import signal
import sys
import threading
import traceback
import warnings
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, TextIO

import typer
from typer.core import TyperGroup

from lensfit.errors import LensfitError, sentence_of
from lensfit.printable import printable

DEBUG, OUT = "--debug", "--out"
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EIO)


class DoorGroup(TyperGroup):
    """A command group whose commands fail in one line, and whose help fills lines."""

    def __init__(self, *args: Any, **kwargs: Any):
        super().__init__(*args, **kwargs)
        _fill_lines(self)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Accept `--debug` after the command too, where one adds it to rerun."""
        options = args[: args.index("--")] if "--" in args else args
        if DEBUG in options:
            args = [DEBUG, *(a for a in options if a != DEBUG), *args[len(options) :]]
        # Else the results would lie in the working folder: a variable that is not set.
        if f"{OUT}=" in args or (OUT, "") in itertools.pairwise(args):
            raise typer.BadParameter("is empty; give a folder or file", param_hint=OUT)
        return super().parse_args(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        """Run the command; say in one line why it failed, if it did."""
        debug = bool(ctx.params.get("debug"))
        if not debug:
            # Deprecations inside libraries are for developers, not for users.
            warnings.simplefilter("ignore")
        try:
            return super().invoke(ctx)
        except (Exception, KeyboardInterrupt) as error:
            if _is_the_parsers(error):
                raise
            if debug:
                traceback.print_exc(file=sys.stderr)
            else:
                say_error(_line(error))
            raise typer.Exit(1) from error
        finally:
            if ctx.parent is None and "jax" in sys.modules:
                _say_cache_note()


def say_error(line: str) -> None:
    """Print one line on standard error, the way every failure looks."""
    typer.echo(f"lensfit: error: {printable(line)}", err=True)


def say_note(line: str) -> None:
    """Print a remark on standard error: something to know, not a failure."""
    typer.echo(f"lensfit: note: {printable(line)}", err=True)


def _say_cache_note() -> None:
    """Of commands that compile: why each run of them does so anew."""
    from lensfit._jax import cache_note

    if (note := cache_note()) is not None:
        say_note(note)


def one_of(choices: tuple[str, ...]) -> Callable[[str], str]:
    """A check that an option is one of a few words."""

    def check(value: str) -> str:
        if value not in choices:
            raise typer.BadParameter(f"{value!r} is not one of {', '.join(choices)}")
        return value

    return check


def each_of(
    choices: tuple[str, ...],
) -> Callable[[list[str] | None], list[str] | None]:
    """The same for an option that may be repeated."""
    check = one_of(choices)

    def check_each(values: list[str] | None) -> list[str] | None:
        for value in values or []:
            check(value)
        return values

    return check_each


def _fill_lines(command: Any) -> None:
    """Let the terminal break the help's lines, not the source; examples keep theirs."""
    text = inspect.cleandoc(command.help or "")
    command.help = re.sub(r"(?<!\n)\n(?!\n|Example: )", " ", text)
    for one in getattr(command, "commands", {}).values():
        _fill_lines(one)


def _is_the_parsers(error: BaseException) -> bool:
    """Exits, usage errors and closed pipes have their own way out."""
    if isinstance(error, BrokenPipeError):
        return _is_closed(sys.stdout)
    return hasattr(error, "exit_code") or isinstance(error, (typer.Abort, EOFError))


def _is_closed(stream: TextIO) -> bool:
    """Whether nobody reads it any more, as after ``| head``."""
    try:
        stream.write("\n")  # what was written before may be forgotten already
        stream.flush()
    except (OSError, ValueError):
        return True
    return False


def _line(error: BaseException) -> str:
    if isinstance(error, LensfitError):
        return str(error)
    if isinstance(error, KeyboardInterrupt):
        return "interrupted"
    if isinstance(error, OSError) and error.errno in _FULL and not error.filename:
        return (
            f"standard output cannot be written ({error.strerror}); give it a file "
            "or a device with room"
        )
    return f"{sentence_of(error)}; run again with --debug for the traceback"


_AGAIN_S = 0.02
_WEAK = {
    kind.__init__.__code__.co_filename
    for kind in (weakref.WeakKeyDictionary, weakref.WeakSet)
}
"""Where the callbacks of weak references stand."""
_USUAL = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL}
"""Signals that end a run, and what handles them where nobody has chosen."""


@contextmanager
def interruptible() -> Iterator[None]:
    """Raise KeyboardInterrupt where it is heard, as long as this context lasts.

    Only in the main thread, which alone may handle signals, and only for signals that
    nobody has chosen otherwise for: a run in the background ignores Ctrl-C.
    """
    usual = [n for n, handler in _USUAL.items() if signal.getsignal(n) is handler]
    is_main = threading.current_thread() is threading.main_thread()
    if not (usual and is_main and hasattr(signal, "setitimer")):
        yield
        return
    alarm = signal.signal(signal.SIGALRM, _interrupt)
    for number in usual:
        signal.signal(number, _interrupt)
    try:
        yield
    except SystemExit as end:
        if _follows_interrupt(end):
            _end_at_once(end)
        raise
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        for number in usual:
            signal.signal(number, _USUAL[number])
        signal.signal(signal.SIGALRM, alarm)


def _interrupt(_number: int, frame: FrameType | None) -> None:
    if _is_unheard(frame):
        signal.setitimer(signal.ITIMER_REAL, _AGAIN_S)
    else:
        raise KeyboardInterrupt


def _follows_interrupt(error: BaseException | None) -> bool:
    seen: set[int] = set()
    while error is not None and id(error) not in seen:
        if isinstance(error, KeyboardInterrupt):
            return True
        seen.add(id(error))  # an error may be raised from itself
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
