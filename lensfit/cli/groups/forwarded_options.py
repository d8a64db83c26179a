"""The options of one command as another command takes them and hands them on.

What is handed on is read from the command itself, so that an option added to it cannot
be forgotten on the way.
"""

import functools
import inspect
from collections.abc import Callable, Sequence
from enum import Enum
from pathlib import Path
from typing import Any

import typer

from lensfit.plate.farm.job import HandedOption


def hands_on(
    other: Callable[..., None], *, except_for: Sequence[str], files: Sequence[str] = ()
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """A command that takes the options of `other` too.

    It receives those that were given, ready to be handed on, as its parameter `handed`,
    and the values of all, as `other` would receive them, as `taken`.

    Parameters
    ----------
    other : A command, as typer runs it.
    except_for : Parameters of `other` that are not taken over.
    files : Parameters that name files, though `other` takes them as text.
    """
    theirs = [
        p
        for name, p in inspect.signature(other).parameters.items()
        if name not in except_for
    ]

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        own = [
            p.replace(kind=inspect.Parameter.KEYWORD_ONLY)
            for name, p in inspect.signature(command).parameters.items()
            if name not in ("handed", "taken")
        ]

        @functools.wraps(command)
        def run(**given: Any) -> None:
            values = {p.name: given.pop(p.name) for p in theirs}
            named = {n: Path(values[n]) for n in files if values[n] is not None}
            values |= named
            handed = handed_options(other, values)
            command(**given, handed=handed, taken=values)

        # typer reads the one, and the types of the other
        parameters = [*own, *(p.replace(kind=own[0].kind) for p in theirs)]
        run.__signature__ = inspect.Signature(parameters)  # pyright: ignore[reportAttributeAccessIssue]
        run.__annotations__ = {p.name: p.annotation for p in parameters}
        return run

    return decorate


def handed_options(
    command: Callable[..., None], values: dict[str, Any]
) -> tuple[HandedOption, ...]:
    """Options that give `command` these values; those of its own defaults need none.

    Parameters
    ----------
    values : By parameter of `command`, as typer passes them.
    """
    found: list[HandedOption] = []
    for option in _parameters_as_typed(command):
        if option.name in values:
            found += _handed_options(option, values[option.name])
    return tuple(found)


def _parameters_as_typed(command: Callable[..., None]) -> list[Any]:
    """What the parser knows of the options: their words, and how many values follow."""
    alone = typer.Typer(add_completion=False)
    alone.command()(command)
    return list(typer.main.get_command(alone).params)


def _handed_options(option: Any, value: Any) -> list[HandedOption]:
    words = [w for w in option.opts if w.startswith("--")]
    if value is None or value == option.default:
        return []
    if option.is_flag:
        return [HandedOption((words if value else option.secondary_opts)[0], ())]
    each = value if option.multiple else [value]
    return [
        HandedOption(words[0], tuple(_plain(v) for v in _as_list(one))) for one in each
    ]


def _as_list(value: Any) -> Sequence[Any]:
    return value if isinstance(value, (list, tuple)) else [value]


def _plain(value: Any) -> str | int | float | Path:
    return value.value if isinstance(value, Enum) else value
