"""Make a chart: lay out, draw, write in each requested format."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lensfit import __version__
from lensfit.chart.coverage import paint, size_in_pixels
from lensfit.chart.drawing import Drawing
from lensfit.chart.layout import Layout, Wanted, draw, foil_drawing, lay_out
from lensfit.chart.sheet import Sheet, paper_sheet, screen_sheet
from lensfit.errors import ChartError
from lensfit.io.drawing_files import (
    write_dxf,
    write_pdf,
    write_png,
    write_svg,
    write_tones_exr,
)
from lensfit.units import MILLIMETRES_PER_INCH

FORMATS = (".svg", ".pdf", ".dxf", ".png", ".exr")
MOST_PIXELS = 120_000_000
DEFAULT_DPI = 300.0


@dataclass(frozen=True)
class SheetWish:
    """What to draw on, as requested.

    Attributes
    ----------
    paper : A size by name, or WxH in mm.
    screen : WxH in px, in place of paper; then `pixel_pitch_mm` is needed.
    """

    paper: str | None = None
    portrait: bool = False
    screen: str | None = None
    pixel_pitch_mm: float | None = None
    margin_mm: float | None = None

    def sheet(self) -> Sheet:
        """The sheet.

        Raises
        ------
        ChartError : It cannot be had, or paper and screen are both requested.
        """
        if self.screen is None:
            if self.pixel_pitch_mm is not None:
                raise ChartError(
                    "paper has no pixel pitch", remedy="give --screen WIDTHxHEIGHT too"
                )
            return paper_sheet(
                self.paper or "A3", portrait=self.portrait, margin_mm=self.margin_mm
            )
        if self.paper is not None or self.portrait:
            raise ChartError(
                "a chart is for paper or for a screen, not for both",
                remedy="leave out --screen, or --paper and --portrait",
            )
        if self.pixel_pitch_mm is None:
            raise ChartError(
                "the size of the screen's pixels is not known",
                remedy="add --pixel-pitch-mm: width of the lit area / pixels across",
            )
        return screen_sheet(self.screen, self.pixel_pitch_mm, margin_mm=self.margin_mm)


def write_chart(
    paths: Sequence[str | Path],
    wish: SheetWish,
    wanted: Wanted,
    *,
    dpi: float | None = None,
) -> Layout:
    """Make a chart and write it to every path, in the format of its suffix.

    Parameters
    ----------
    paths : Files that end in .svg, .pdf, .png or .exr, or in .dxf for cut foil.
    dpi : Pixels per inch of PNG and EXR of paper; 300 by default.

    Raises
    ------
    ChartError : The chart cannot be made so, or a format is unknown.
    OutputError : A file cannot be written.
    """
    for path in map(Path, paths):
        if path.suffix.lower() not in FORMATS:
            raise ChartError(
                f"'{path.suffix}' is no format of charts",
                where=path,
                remedy=f"end the name in one of {', '.join(FORMATS)}",
            )
    layout = lay_out(wish.sheet(), wanted)
    pixel_mm = _pixel_mm(layout.sheet, dpi)
    drawing = draw(layout, __version__)
    formats = {Path(path).suffix.lower() for path in paths}
    holes = foil_drawing(layout) if ".dxf" in formats else None
    tones = None
    if formats & {".png", ".exr"}:
        _check_pixels(drawing, pixel_mm)
        tones = paint(drawing, pixel_mm)
    for path in map(Path, paths):
        _write(path, drawing, holes, tones, pixel_mm)
    return layout


def _write(
    path: Path,
    drawing: Drawing,
    holes: Drawing | None,
    tones: np.ndarray | None,
    pixel_mm: float,
) -> None:
    suffix = path.suffix.lower()
    if suffix == ".svg":
        write_svg(path, drawing)
    elif suffix == ".pdf":
        write_pdf(path, drawing)
    elif suffix == ".dxf" and holes is not None:
        write_dxf(path, holes)
    elif tones is not None:
        if suffix == ".png":
            write_png(path, tones, pixel_mm)
        else:
            write_tones_exr(path, tones)


def _pixel_mm(sheet: Sheet, dpi: float | None) -> float:
    if sheet.pixel_mm is not None:
        if dpi is not None:
            raise ChartError(
                "a screen's resolution is its own", remedy="leave out --dpi"
            )
        return sheet.pixel_mm
    if dpi is not None and not (math.isfinite(dpi) and 20 <= dpi <= 10_000):
        raise ChartError(f"{dpi:g} dpi is out of range", remedy="give 20 to 10000")
    return MILLIMETRES_PER_INCH / (dpi or DEFAULT_DPI)


def _check_pixels(drawing: Drawing, pixel_mm: float) -> None:
    width, height = size_in_pixels(drawing, pixel_mm)
    if width * height > MOST_PIXELS:
        raise ChartError(
            f"{width} x {height} pixels are too many",
            remedy="lower --dpi, or write SVG or PDF",
        )
