"""`lensfit preset list`, `save`, `load`, ...: presets kept by name and version.

`project` marks where a library's levels end, `default` the version that is used when
none is named; `edit` makes a new version, `history` prints all of them.
"""

import json
from pathlib import Path
from typing import Annotated

import typer

from lensfit.cli._terminal import console, say_line
from lensfit.cli.groups import takes_groups
from lensfit.cli.groups.library import PRESET_HELP, LibraryGroup, user_name
from lensfit.printable import printable


def project(
    folder: Annotated[Path, typer.Argument(help="Folder of the whole project")],
    who: Annotated[str | None, typer.Option(help="Who marks it")] = None,
) -> None:
    """Mark a folder as a project: folders below are its sequences and shots.

    A preset that is looked up in a shot is then also found in its sequence and in the
    project, and the nearest level wins, key by key.

    Example: lensfit preset project show
    """
    from lensfit.preset.library.levels import mark_project

    new = mark_project(folder, user_name(who))
    say_line(f"{folder}: {'is a project now' if new else 'was a project already'}")


@takes_groups
def list_lenses(
    library: LibraryGroup,
    as_json: Annotated[bool, typer.Option("--json", help="Print as JSON")] = False,
) -> None:
    """Print the lenses of a library with their versions, nearest level first.

    Example: lensfit preset list --library show/sq010
    """
    from lensfit.preset.library.catalogue import catalogue

    levels = library.levels()
    rows = catalogue(levels)
    if as_json:
        typer.echo(json.dumps([row._asdict() for row in rows]))
        return
    if not rows:
        say_line(f"{levels[0].lenses}: no lens yet")
        return
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False, header_style="bold")
    # What has to be typed elsewhere is whole.
    for name in ("lens", "level"):
        table.add_column(name, no_wrap=True)
    for name in ("versions", "in use", "default", ""):
        table.add_column(name, overflow="fold")
    for row in rows:
        span = " to ".join(dict.fromkeys(row.versions[:1] + row.versions[-1:]))
        what = row.fault or (row.lens or "") + (
            ", change set" if row.change_set else ""
        )
        cells = (row.slug, row.level, span, row.in_use or "-", row.marked or "-", what)
        table.add_row(*(Text(printable(cell)) for cell in cells))
    console().print(table)


@takes_groups
def save(
    preset: Annotated[str, typer.Argument(help="preset.json")],
    library: LibraryGroup,
    default: Annotated[
        bool,
        typer.Option("--default", help="Use this version when none is named"),
    ] = False,
    note: Annotated[str, typer.Option(help="What it is, for the record")] = "",
    who: Annotated[str | None, typer.Option(help="Who saves it")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Say it as JSON")] = False,
) -> None:
    """Save a preset as the next version of its lens; nothing is ever overwritten.

    The lens' folder is named after the lens and its serial number. Without --library
    (or LENSFIT_LIBRARY) the user's own library is used.

    Example: lensfit preset save takumar_50/preset.json --library show --default
    """
    from lensfit.cli._door import say_note
    from lensfit.preset.library.edit import keep_preset
    from lensfit.preset.library.levels import levels_of, library_folder, version_name
    from lensfit.preset.library.shelf import Shelf

    found = library.find(preset)
    if library.library is None:
        library_folder().mkdir(parents=True, exist_ok=True)
    level = levels_of(library.library)[0]
    kept = keep_preset(
        found.taken_out(user_name(who)) if found.parts else found.preset,
        level,
        who=user_name(who),
        note=note,
        default=default,
    )
    if as_json:
        said = {"path": str(kept.path), "lens": kept.slug}
        typer.echo(json.dumps(said | {"version": version_name(kept.number)}))
    else:
        say_line(kept.path)
    in_use = Shelf(level, kept.slug).in_use()
    if in_use != kept.number:
        say_note(
            f"{version_name(in_use)} is in use when no version is named; mark the new "
            f"one with: lensfit preset default {kept.slug}@{version_name(kept.number)}"
        )


@takes_groups
def load(
    preset: Annotated[str, typer.Argument(help=PRESET_HELP)],
    library: LibraryGroup,
    out: Annotated[Path, typer.Option("--out", help="Preset to write")],
    who: Annotated[str | None, typer.Option(help="Who takes it out")] = None,
) -> None:
    """Write a preset of a library, with all edits in it, to a file.

    The file records the versions and edits it was put together from.

    Example: lensfit preset load zeiss-50@v002 --library show/sq010 --out zeiss.json
    """
    from lensfit.preset.store import save_preset

    found = library.find(preset)
    save_preset(found.taken_out(user_name(who)), out)
    say_line(f"{out}: {found.full_name}, {found.preset.lens.name}")


@takes_groups
def default(
    lens: Annotated[str, typer.Argument(help="NAME@v002 of the library")],
    library: LibraryGroup,
    who: Annotated[str | None, typer.Option(help="Who marks it")] = None,
) -> None:
    """Mark a version as the one that is used when none is named.

    Later edits of the marked version are used too; mark it again to go back.

    Example: lensfit preset default zeiss-50@v001 --library show
    """
    from lensfit.errors import PresetError
    from lensfit.preset.library.edit import mark_default
    from lensfit.preset.library.layers import lens_in
    from lensfit.preset.library.levels import version_name
    from lensfit.preset.library.shelf import Shelf

    name, _, requested = lens.partition("@")
    levels = library.levels()
    shelf = Shelf(levels[0], lens_in(levels, name))
    if not shelf.numbers:
        raise PresetError("holds no version", where=shelf.folder)
    if not requested:
        raise PresetError(f"say which version: {shelf.slug}@v001")
    number = shelf.number(requested)
    mark_default(shelf, number, user_name(who))
    typer.echo(f"{shelf.slug}: {version_name(number)} is used when none is named")


@takes_groups
def edit(
    lens: Annotated[str, typer.Argument(help="NAME or NAME@v002 of the library")],
    library: LibraryGroup,
    why: Annotated[str, typer.Option(help="Reason, for the record")],
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", help="KEY=VALUE; repeat for more", metavar="KEY=VALUE"),
    ] = None,
    drop: Annotated[
        list[str] | None,
        typer.Option(help="KEY to give back to the preset beneath", metavar="KEY"),
    ] = None,
    who: Annotated[str | None, typer.Option(help="Who edits")] = None,
    unlock: Annotated[
        bool, typer.Option("--unlock", help="Change measured values too")
    ] = False,
    pin: Annotated[
        bool,
        typer.Option(
            "--pin", help="Stand on the outer version now in use, whatever comes later"
        ),
    ] = False,
) -> None:
    """Change keys of a lens at the level of --library; who, when and why are recorded.

    A new version is made; the level holds only what differs from the levels around it.
    Keys are names joined by dots, members of lists by what they are, or the name of a
    knob. Measured values are locked.

    Example: lensfit preset edit zeiss-50 --library show/sq010 --set coma_gain=0.5
    --why "too strong on faces"
    """
    from lensfit.cli._door import say_note
    from lensfit.preset.library.edit import (
        Author,
        RequestedEdit,
        edit_preset,
        requested_edit_of_text,
    )

    wishes = [requested_edit_of_text(text) for text in settings or ()]
    wishes += [RequestedEdit(key, drop=True) for key in drop or ()]
    found = edit_preset(
        lens,
        wishes,
        Author(user_name(who), why),
        library=library.library,
        unlock=unlock,
        pin=pin,
    )
    for note in found.notes:
        say_note(note)
    say_line(found.path)
    for override in found.overrides:
        if override.part == found.parts[0]:
            say_line(str(override))


@takes_groups
def history(
    lens: Annotated[str, typer.Argument(help="NAME of the library")],
    library: LibraryGroup,
    as_json: Annotated[bool, typer.Option("--json", help="Print as JSON")] = False,
) -> None:
    """Print every version of a lens at every level: who made it, when and why.

    A star marks the version of each level that is in use.

    Example: lensfit preset history zeiss-50 --library show/sq010/sh0020
    """
    from lensfit.preset.library.catalogue import history as events_of
    from lensfit.preset.library.layers import lens_in
    from lensfit.preset.library.shelf import shelves_of

    levels = library.levels()
    events = events_of(shelves_of(levels, lens_in(levels, lens.partition("@")[0])))
    if as_json:
        typer.echo(json.dumps([event._asdict() for event in events]))
        return
    for event in events:
        star = "*" if event.in_use else " "
        by = f" by {event.who}" if event.who else ""
        said = f"{star} {event.level} {event.version}  {event.when}{by}"
        for line in (said, *(f"    {what}" for what in event.what)):
            say_line(line)
