"""`lensfit kit`: a set of lenses planned, checked and calibrated as one job."""

import typer

from lensfit.cli.kit.calibrate import calibrate
from lensfit.cli.kit.check import check
from lensfit.cli.kit.plan import plan
from lensfit.cli.kit.report import report
from lensfit.cli.kit.submit import submit

app = typer.Typer(
    no_args_is_help=True,
    help="Plan, check and calibrate a kit of lenses as one job.",
)
for command in (plan, check, calibrate, report, submit):
    app.command()(command)
