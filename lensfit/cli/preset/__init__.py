"""`lensfit preset`: look into presets, keep them by name, change them on record."""

import typer

from lensfit.cli.preset.contents import diff, show, validate
from lensfit.cli.preset.foreign import import_lens, thin_lens
from lensfit.cli.preset.library import (
    default,
    edit,
    history,
    list_lenses,
    load,
    project,
    save,
)

app = typer.Typer(
    no_args_is_help=True,
    help="Look into presets, keep them by name and version, change them on record.",
)
for command in (show, validate, save, load, edit, history, diff, default, project):
    app.command()(command)
app.command("list")(list_lenses)
app.command("import")(import_lens)
app.command("thin-lens")(thin_lens)
