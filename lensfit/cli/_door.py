"""What every command shares: one-line errors and exit codes.

0 is done, 2 is wrong usage (the parser says it), 1 is anything else, with one line on
standard error that says what is wrong, where and what to do. `--debug`, anywhere on
the command line, gives the traceback instead.
"""

import errno
import inspect
import re
import sys
import traceback
import warnings
from collections.abc import Callable
from typing import Any, TextIO

import typer
from typer.core import TyperGroup

from lensfit.errors import LensfitError, sentence_of
from lensfit.printable import printable

DEBUG = "--debug"
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
