"""Sizes in pixels as they are written on the command line: WIDTHxHEIGHT."""

import re

import typer


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
