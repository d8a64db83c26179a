"""`lensfit chart`: charts to print or show, and advice on which."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lensfit.cli._door import one_of
from lensfit.cli._options import one_of_or_none, photograph_size_px
from lensfit.cli._terminal import say_line
from lensfit.cli.groups import takes_groups

if TYPE_CHECKING:
    from lensfit.chart.layout import Wanted
    from lensfit.workflow.chart import Advice, SheetWish

KINDS = ("dot-grid", "line-grid", "checkerboard")
_PANEL = "Chart"


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
            callback=one_of_or_none(("bright", "dark")),
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


app = typer.Typer(invoke_without_command=True)


@app.callback()
@takes_groups
def chart(
    context: typer.Context,
    *,
    chart: ChartGroup,
    out: Annotated[
        list[Path] | None,
        typer.Option(
            help="File to write: .svg, .pdf, .png, .exr; .dxf to cut; may be repeated"
        ),
    ] = None,
    dpi: Annotated[
        float | None, typer.Option(help="Of PNG and EXR of paper; 300 by default")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print as JSON")] = False,
) -> None:
    """Make a chart of dots, lines or squares, to print or to show on a screen.

    It carries a code that calibrate reads, marks that show its orientation, and a
    ruler to check the printer.

    Example: lensfit chart --paper A2 --pitch-mm 20 --out dots.pdf
    Example: lensfit chart advise --focal-length-mm 50 --f-number 1.4
    --sensor-width-mm 24.89
    """
    if context.invoked_subcommand is not None:
        return
    if not out:
        raise typer.BadParameter("name a file to write, as in --out chart.pdf")
    from lensfit.chart.layout import pattern_description
    from lensfit.workflow.chart import write_chart

    layout = write_chart(out, chart.sheet(), chart.wanted(), dpi=dpi)
    if as_json:
        from dataclasses import asdict

        typer.echo(json.dumps({"files": [str(p) for p in out], **asdict(layout)}))
        return
    say_line(", ".join(pattern_description(layout.pattern)))
    for path in out:
        say_line(str(path))


@app.command()
@takes_groups
def advise(
    *,
    focal_length_mm: Annotated[float, typer.Option(help="Of the lens")],
    f_number: Annotated[float, typer.Option(help="Widest that will be photographed")],
    sensor_width_mm: Annotated[float, typer.Option(help="Width that the frame spans")],
    size: Annotated[
        str, typer.Option(help="Of the photographs, WIDTHxHEIGHT px")
    ] = "4096x3072",
    focus_distance_mm: Annotated[
        float | None,
        typer.Option(
            help="Of the chart, from the sensor; where it fills the frame by default"
        ),
    ] = None,
    noise_percent: Annotated[
        float, typer.Option(help="Of a pixel, of white, rms")
    ] = 0.5,
    chart: ChartGroup,
    as_json: Annotated[bool, typer.Option("--json", help="Print as JSON")] = False,
) -> None:
    """Predict how a chart will look through a lens, and from where to photograph it.

    Example: lensfit chart advise --focal-length-mm 50 --f-number 1.4
    --sensor-width-mm 24.89 --paper A2
    """
    from lensfit.chart.chart_camera import Camera
    from lensfit.workflow.chart import advise as advise_on

    camera = Camera(
        focal_length_mm,
        f_number,
        sensor_width_mm,
        photograph_size_px(size),
        noise_percent,
    )
    sheet = chart.sheet().sheet() if chart.says_sheet() else None
    advice = advise_on(camera, chart.wanted(), sheet, focus_distance_mm)
    if as_json:
        typer.echo(json.dumps(advice.as_json()))
    else:
        _print_advice(advice, noise_percent)


def _print_advice(advice: "Advice", noise_percent: float) -> None:
    from lensfit.workflow.chart import MODEL_NUMBERS

    sheet = "{:g} x {:g} mm".format(*advice.sheet_mm)
    mark = f", marks {advice.mark_mm:g} mm" if advice.mark_mm else ""
    lines = [
        f"chart     {advice.kind}, {advice.columns} x {advice.rows}, pitch "
        f"{advice.pitch_mm:g} mm{mark}, on {sheet}",
        f"distance  {advice.distance_mm:.0f} mm from the sensor; the frame sees "
        "{:.0f} x {:.0f} mm".format(*advice.field_mm),
        f"on frame  {advice.marks_on_frame} marks, {advice.pitch_px:.1f} px apart"
        + (f", {advice.mark_px:.1f} px wide" if advice.mark_mm else ""),
    ]
    if advice.scatter_px is not None:
        lines += [
            f"expected  {advice.scatter_px:.2g} px scatter of a dot "
            f"({advice.scatter_formula}, noise n = {noise_percent:g} %),",
            f"          {advice.expected_rms_px:.1g} px rms of the lens (scatter x "
            f"sqrt({MODEL_NUMBERS} numbers / {advice.marks_on_frame} dots))",
        ]
    lines.append("takes     f-number  focus at     blur")
    for take in advice.takes:
        lines.append(
            f"  {take.name:9} {take.f_number:6.3g} {take.focus_distance_mm:8.0f} mm "
            f"{take.blur_px:7.1f} px" + ", dots overlap" * take.overlapping
        )
    for line in [*lines, *(f"note      {note}" for note in advice.notes)]:
        say_line(line)
