"""`lensfit kit`: a set of lenses planned, checked and calibrated as one job."""

import typer

from lensfit.cli.kit.photographs import check, plan
from lensfit.cli.kit.results import calibrate, report, submit

app = typer.Typer(
    no_args_is_help=True,
    help="Plan, check and calibrate a kit of lenses as one job.",
)
for command in (plan, check, calibrate, report, submit):
    app.command()(command)
