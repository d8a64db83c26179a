"""`lensfit synth`: photographs by an exact ray tracer, with their truth."""

from typing import Any

import typer
from typer.core import TyperGroup

from data_synth.commands.synth.charts import charts
from data_synth.commands.synth.scene import scene


class _ChartsUnlessNamed(TyperGroup):
    """`lensfit synth LENS` photographs charts, as `lensfit synth charts LENS` does."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Put the command's name before the name of a lens or an option."""
        if not args or args[0] not in {*self.commands, *ctx.help_option_names}:
            args = ["charts", *args]
        return super().parse_args(ctx, args)


app = typer.Typer(
    cls=_ChartsUnlessNamed,
    help="""Photograph charts or a scene through a published lens, by exact ray tracing.

    `lensfit synth LENS` photographs charts; see `lensfit synth charts --help`.

    Example: lensfit synth nikkor_28 --out shoot --size 1280x960 --f-number 5.6
    """,
)
app.command()(charts)
app.command()(scene)
