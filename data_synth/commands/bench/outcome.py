"""Options that benchmarks share, and how each says what it found and what failed."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from lensfit.cli._door import say_error
from lensfit.cli._terminal import console

SetsFolder = Annotated[
    Path, typer.Option("--data", help="Folder with real/ and oracle/")
]
OnlySet = Annotated[
    str | None, typer.Option("--only", help="Name of the one set to measure")
]
JsonFolder = Annotated[Path | None, typer.Option("--out", help="Folder for JSON")]
SmallFrames = Annotated[
    bool, typer.Option("--quick", help="Leave frames of 8 megapixels out")
]
AsJson = Annotated[bool, typer.Option("--json", help="Print the figures as JSON")]


def show(result: dict[str, Any], as_json: bool) -> None:
    """Machine, rows, times and notes; the exit code is 1 when something failed."""
    from data_synth.commands.bench.tables import bars_table

    if as_json:
        typer.echo(json.dumps(result))
    else:
        say_machine(result)
        console().print(bars_table(result["rows"]))
        print_profiles(result)
        for name, seconds in result.get("seconds", {}).items():
            typer.echo(f"{name}: {seconds:.0f} s")
        for note in result.get("notes", []):
            typer.echo(note)
    fail_if_any(result["errors"])


def say_machine(result: dict[str, Any]) -> None:
    """Processor, memory and versions, in a line."""
    from data_synth.bench.result import described

    typer.echo(described(result["machine"]))


def print_bars_and_curves(result: dict[str, Any]) -> None:
    """A row for each bar, then a table for each curve."""
    from data_synth.commands.bench.tables import bars_table, curve_tables

    screen = console()
    screen.print(bars_table(result["rows"]))
    for table in curve_tables(result["curves"]):
        screen.print()
        screen.print(table)
    print_profiles(result)


def print_profiles(result: dict[str, Any]) -> None:
    """Where the time goes and how far that is from the floor, where it was measured."""
    from data_synth.commands.bench.tables import profile_tables

    screen = console()
    for table in profile_tables(result):
        screen.print()
        screen.print(table)


def fail_if_any(errors: list[str]) -> None:
    """Say what failed; the exit code is then 1."""
    for line in errors:
        say_error(line)
    if errors:
        raise typer.Exit(1)
