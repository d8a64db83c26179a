"""What a chart shows and what it is drawn on, on the command line."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from lensfit.cli._door import one_of

if TYPE_CHECKING:
    from lensfit.chart.layout import Wanted
    from lensfit.workflow.chart import SheetWish

KINDS = ("dot-grid", "line-grid", "checkerboard")
_PANEL = "Chart"


def _polarity(value: str | None) -> str | None:
    return value if value is None else one_of(("bright", "dark"))(value)


@dataclass(frozen=True)
class ChartGroup:
    """A chart as it is asked for; what is left out is chosen to suit the sheet."""

    kind: Annotated[
        str,
        typer.Option(
            help=" | ".join(KINDS), callback=one_of(KINDS), rich_help_panel=_PANEL
        ),
    ] = "dot-grid"
    paper: Annotated[
        str | None,
        typer.Option(
            help="A0 to A4, Letter, Tabloid, or WxH in mm; A3 by default",
            rich_help_panel=_PANEL,
        ),
    ] = None
    portrait: Annotated[
        bool,
        typer.Option(
            "--portrait/--landscape", help="Paper upright", rich_help_panel=_PANEL
        ),
    ] = False
    screen: Annotated[
        str | None,
        typer.Option(help="WxH in px, in place of paper", rich_help_panel=_PANEL),
    ] = None
    pixel_pitch_mm: Annotated[
        float | None,
        typer.Option(
            help="Of the screen: width of its lit area / pixels across",
            rich_help_panel=_PANEL,
        ),
    ] = None
    margin_mm: Annotated[
        float | None,
        typer.Option(help="Kept free all around", rich_help_panel=_PANEL),
    ] = None
    pitch_mm: Annotated[
        float | None,
        typer.Option(help="Of dots or lines; side of a square", rich_help_panel=_PANEL),
    ] = None
    hole_diameter_mm: Annotated[
        float | None, typer.Option(help="Of a dot", rich_help_panel=_PANEL)
    ] = None
    line_width_mm: Annotated[
        float | None, typer.Option(help="Of a line", rich_help_panel=_PANEL)
    ] = None
    polarity: Annotated[
        str | None,
        typer.Option(
            help="bright marks on black (default) | dark marks on white",
            callback=_polarity,
            rich_help_panel=_PANEL,
        ),
    ] = None

    def wanted(self) -> "Wanted":
        """What the chart is to show.

        Raises
        ------
        ChartError : A width is of the other kind of chart, or no length.
        """
        from lensfit.chart.layout import Wanted
        from lensfit.errors import ChartError

        own = {"dot-grid": "hole_diameter_mm", "line-grid": "line_width_mm"}
        for name in own.values():
            if getattr(self, name) is not None and name != own.get(self.kind):
                option = "--" + name.replace("_", "-")
                raise ChartError(
                    f"{option} has no meaning for a {self.kind}", remedy="leave it out"
                )
        mark = getattr(self, own[self.kind]) if self.kind in own else None
        return Wanted(self.kind, self.pitch_mm, mark, self.polarity)  # pyright: ignore[reportArgumentType]

    def sheet(self) -> "SheetWish":
        """What it is drawn on."""
        from lensfit.workflow.chart import SheetWish

        return SheetWish(
            self.paper,
            self.portrait,
            self.screen,
            self.pixel_pitch_mm,
            self.margin_mm,
        )

    def says_sheet(self) -> bool:
        """Whether paper or screen was asked for."""
        return self.paper is not None or self.screen is not None
