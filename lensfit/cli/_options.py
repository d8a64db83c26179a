"""Options of several commands: accuracy settings, levels of a verdict, sizes in pixels.

Accuracy settings are described in `lensfit.fitting.wavefront.effort`, which is not
imported for the help alone. From the level that an option requires follows the exit
code. Sizes are written WIDTHxHEIGHT.
"""

import re
from collections.abc import Callable, Mapping
from typing import Annotated, Any

import typer

from lensfit.cli._door import one_of, say_error
from lensfit.preset.verdict_levels import LEVELS, is_at_least

EFFORTS = ("fastest", "fast", "normal", "best")
EFFORT_HELP = " | ".join(EFFORTS)
EFFORTS_OR_NONE = ("none", *EFFORTS)
EFFORT_OR_NONE_HELP = (
    "Speed against error of the blur; none leaves it out: "
    + " | ".join(EFFORTS_OR_NONE)
)
EffortOption = Annotated[
    str, typer.Option(help=EFFORT_OR_NONE_HELP, callback=one_of(EFFORTS_OR_NONE))
]


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


def size_px(text: str | None) -> tuple[int, int] | None:
    """Width and height as they are written on the command line.

    Raises
    ------
    typer.BadParameter : It is no size.
    """
    if text is None:
        return None
    try:
        width, height = (int(part) for part in text.lower().split("x"))
    except ValueError:
        raise typer.BadParameter(
            f"{text!r} is no size; write it as 4096x3072", param_hint="--size"
        ) from None
    return width, height


def photograph_size_px(size: str) -> tuple[int, int]:
    """Width and height of photographs that are to be taken.

    Raises
    ------
    typer.BadParameter : It is no size, or none of 16 to 8192 px a side.
    """
    match = re.fullmatch(r"(\d+)x(\d+)", size)
    if not match or not all(16 <= int(n) <= 8192 for n in match.groups()):
        raise typer.BadParameter(
            f"--size {size}: give WIDTHxHEIGHT, 16 to 8192 px each"
        )
    return int(match[1]), int(match[2])
