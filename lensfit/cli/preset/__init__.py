"""`lensfit preset`: look into presets, keep them by name, change them on record."""

import typer

from lensfit.cli.preset.default import default
from lensfit.cli.preset.diff import diff
from lensfit.cli.preset.edit import edit
from lensfit.cli.preset.history import history
from lensfit.cli.preset.import_lens import import_lens
from lensfit.cli.preset.list_lenses import list_lenses
from lensfit.cli.preset.load import load
from lensfit.cli.preset.project import project
from lensfit.cli.preset.save import save
from lensfit.cli.preset.show import show
from lensfit.cli.preset.thin_lens import thin_lens
from lensfit.cli.preset.validate import validate

app = typer.Typer(
    no_args_is_help=True,
    help="Look into presets, keep them by name and version, change them on record.",
)
for command in (show, validate, save, load, edit, history, diff, default, project):
    app.command()(command)
app.command("list")(list_lenses)
app.command("import")(import_lens)
app.command("thin-lens")(thin_lens)
