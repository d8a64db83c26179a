"""The levels of a verdict as an option, and the exit code that follows from one."""

from collections.abc import Callable, Mapping
from typing import Annotated, Any

import typer

from lensfit.cli._door import one_of, say_error
from lensfit.preset.verdict import LEVELS, is_at_least

__all__ = ["LEVELS", "RequireOption", "one_of_or_none", "require_level"]


def one_of_or_none(choices: tuple[str, ...]) -> Callable[[str | None], str | None]:
    """A check that an option is one of a few words, or absent."""
    check = one_of(choices)
    return lambda value: None if value is None else check(value)


RequireOption = Annotated[
    str | None,
    typer.Option(
        help="Exit with 1 if the verdict is lower: " + " | ".join(LEVELS),
        callback=one_of_or_none(LEVELS),
    ),
]


def require_level(verdict: Mapping[str, Any], wanted: str | None) -> None:
    """Exit with 1, and one line that says why, if a verdict is below a level."""
    level = str(verdict.get("level"))
    if wanted is None or is_at_least(level, wanted):  # pyright: ignore[reportArgumentType]
        return
    say_error(f"the verdict is {level}, below {wanted}: {verdict.get('headline')}")
    raise typer.Exit(1)
