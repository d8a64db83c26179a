"""`lensfit preset diff`: two presets, key by key."""

import json
from typing import TYPE_CHECKING, Annotated

import typer

from lensfit.cli._console import say_line
from lensfit.cli.groups import takes_groups
from lensfit.cli.groups.library import PRESET_HELP, LibraryGroup

if TYPE_CHECKING:
    from lensfit.preset.library.diff import Difference


@takes_groups
def diff(
    a: Annotated[str, typer.Argument(help=PRESET_HELP)],
    b: Annotated[str, typer.Argument(help=PRESET_HELP)],
    library: LibraryGroup,
    as_json: Annotated[bool, typer.Option("--json", help="Print as JSON")] = False,
) -> None:
    """Print every key at which two presets differ.

    Numbers with their relative change, measured ones also in standard deviations where
    a preset states them. The same version of two levels: project:zeiss-50@v001 and
    sq010:zeiss-50@v001.

    Example: lensfit preset diff zeiss-50@v001 zeiss-50@v002 --library show
    """
    from lensfit.preset.library.diff import differences

    one, other = library.find(a), library.find(b)
    found = differences(one.preset, other.preset)
    if as_json:
        typer.echo(json.dumps([_plain(each) for each in found]))
        return
    say_line(f"{one.full_name} -> {other.full_name}")
    if not found:
        say_line("no difference")
    for difference in found:
        say_line(_line(difference))


def _plain(one: "Difference") -> dict[str, object]:
    """As JSON has it; a value that is not there is left out."""
    from lensfit.preset.library.key_path import MISSING

    return {k: v for k, v in one._asdict().items() if v is not MISSING}


def _line(one: "Difference") -> str:
    from lensfit.preset.library.found import value_text

    said = [f"{100 * one.relative:+.3g} %"] if one.relative is not None else []
    if one.deviations is not None:
        said.append(f"{one.deviations:+.2g} standard deviations")
    more = f" ({', '.join(said)})" if said else ""
    return f"{one.key}: {value_text(one.a)} -> {value_text(one.b)}{more}"
