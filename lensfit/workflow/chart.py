"""Choose a chart and its distance, lay it out, draw it, write it in each format.

With n the noise of a pixel as part of white, the position of a dot of radius r pixels
scatters by ``n R^2 / (2 sqrt(pi) r^2)`` pixels if it is bright, the centroid of an
aperture of radius R (6 px more than r, as far as its light is looked for, and no more
than the detector's window), and by ``n sqrt(w / (pi r))`` if it is dark, as an edge of
w = 4 px carries its place. R and w are measured: they agree with the detector's own
covariance.

A model of k numbers fitted to d dots errs by ``scatter sqrt(k / d)`` pixels rms over
the frame. `lensfit.chart.chart_camera` has the optics and the takes.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lensfit import __version__
from lensfit.chart.chart_camera import (
    Camera,
    FocusTake,
    distance_of_magnification_mm,
    focus_takes,
    magnification_at,
)
from lensfit.chart.coverage import paint, size_in_pixels
from lensfit.chart.drawing import Drawing
from lensfit.chart.layout import Layout, Wanted, draw, foil_drawing, lay_out
from lensfit.chart.sheet import PAPERS, Sheet, paper_sheet, screen_sheet
from lensfit.errors import ChartError
from lensfit.io.drawing_files import (
    write_dxf,
    write_pdf,
    write_png,
    write_svg,
    write_tones_exr,
)
from lensfit.units import MILLIMETRES_PER_INCH

_APERTURE_PITCHES = 0.49
"""R at most: what `lensfit.detect.dots` takes a bright dot's light from."""
_BRIGHT_MARGIN_PX, _DARK_EDGE_PX = 6.0, 4.0
SCATTER_FORMULA = {
    "bright": "n R^2 / (2 sqrt(pi) r^2)",
    "dark": f"n sqrt({_DARK_EDGE_PX:g} px / (pi r))",
}


def dot_scatter_px(
    noise: float, mark_px: float, pitch_px: float, *, bright: bool
) -> float:
    """Scatter of a dot's place, in pixels, along one axis.

    Parameters
    ----------
    noise : n, standard deviation of a pixel as part of white.
    mark_px, pitch_px : Diameter of the dot, and distance to the next.
    bright : Light on dark, else dark on light.
    """
    radius = mark_px / 2
    if not bright:
        return noise * math.sqrt(_DARK_EDGE_PX / (math.pi * radius))
    aperture = min(_APERTURE_PITCHES * pitch_px, radius + _BRIGHT_MARGIN_PX)
    return noise * aperture**2 / (2 * math.sqrt(math.pi) * radius**2)


MODEL_NUMBERS = 20
"""Of a lens and a pose, as a fit of one photograph chooses."""
SMALL_HOLE_PX = 1.6
"""Diameter of holes by which blur is measured."""
READABLE_MODULE_PX = 2.5
CLOSE_FOCAL_LENGTHS = 10.0


@dataclass(frozen=True)
class Advice:
    """What a chart will look like, and what to do about it.

    Attributes
    ----------
    distance_mm : Of the chart, from the sensor.
    field_mm : Width and height that the frame sees there.
    marks_on_frame : Dots, crossings or corners, the chart's middle in the frame's.
    mark_px, pitch_px, module_px : Width of a mark, pitch, module of the code.
    scatter_px : Of a dot's position, in focus; None for other charts.
    scatter_formula : What it was reckoned by.
    expected_rms_px : Of a fitted lens over the frame.
    small_hole_mm : Diameter of a hole by which blur could be measured.
    whole_sheet_distance_mm : From where the frame sees the whole sheet, with its code.
    """

    sheet_mm: tuple[float, float]
    kind: str
    pitch_mm: float
    mark_mm: float
    columns: int
    rows: int
    distance_mm: float
    field_mm: tuple[float, float]
    marks_on_frame: int
    mark_px: float
    pitch_px: float
    module_px: float
    scatter_px: float | None
    scatter_formula: str
    expected_rms_px: float | None
    small_hole_mm: float
    whole_sheet_distance_mm: float
    takes: tuple[FocusTake, ...]
    notes: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """In types that JSON knows."""
        return asdict(self)


def advise(
    camera: Camera,
    wanted: Wanted,
    sheet: Sheet | None = None,
    focus_distance_mm: float | None = None,
) -> Advice:
    """What lands on the frame.

    Parameters
    ----------
    sheet : Of the chart; None takes the smallest paper that fills the frame at the
        focus distance, or A3 if there is none.
    focus_distance_mm : Of lens and chart, from the sensor; None takes that at which
        the pattern fills the frame.

    Raises
    ------
    ChartError : The chart cannot be made, or is nearer than the lens can focus.
    """
    camera.check()
    if sheet is None:
        sheet = _paper_for(camera, wanted, focus_distance_mm)
    layout = lay_out(sheet, wanted)
    distance = focus_distance_mm
    if distance is None:
        distance = _filling_distance_mm(camera, _extent_mm(layout))
    magnification = magnification_at(camera.focal_length_mm, distance)
    px_per_mm = magnification / camera.pixel_mm
    pattern = layout.pattern
    field = tuple(side / magnification for side in camera.sensor_mm)
    marks = _marks_in(layout, field)
    scatter = None
    if pattern.kind == "dot-grid":
        scatter = dot_scatter_px(
            camera.noise_percent / 100,
            pattern.mark_mm * px_per_mm,
            pattern.pitch_mm * px_per_mm,
            bright=pattern.polarity == "bright",
        )
    advice = Advice(
        sheet_mm=(sheet.width_mm, sheet.height_mm),
        kind=pattern.kind,
        pitch_mm=pattern.pitch_mm,
        mark_mm=pattern.mark_mm,
        columns=pattern.columns,
        rows=pattern.rows,
        distance_mm=distance,
        field_mm=(field[0], field[1]),
        marks_on_frame=marks,
        mark_px=pattern.mark_mm * px_per_mm,
        pitch_px=pattern.pitch_mm * px_per_mm,
        module_px=layout.module_mm * px_per_mm,
        scatter_px=scatter,
        scatter_formula=SCATTER_FORMULA[pattern.polarity],
        expected_rms_px=scatter and scatter * math.sqrt(MODEL_NUMBERS / max(marks, 1)),
        small_hole_mm=SMALL_HOLE_PX / px_per_mm,
        whole_sheet_distance_mm=_whole_sheet_distance_mm(camera, sheet),
        takes=(),
        notes=(),
    )
    takes = focus_takes(camera, distance, advice.mark_px, advice.pitch_px)
    notes = _notes(camera, layout, advice)
    return Advice(**(vars(advice) | {"takes": takes, "notes": notes}))


def _extent_mm(layout: Layout) -> tuple[float, float]:
    """Of the pattern, from its first to its last mark."""
    pattern = layout.pattern
    columns, rows = pattern.lattice_size
    return (columns - 1) * pattern.pitch_mm, (rows - 1) * pattern.pitch_mm


def _filling_distance_mm(camera: Camera, extent_mm: tuple[float, float]) -> float:
    """Where the pattern covers the whole frame, and no more."""
    parts = [s / e for s, e in zip(camera.sensor_mm, extent_mm, strict=True)]
    # a lens images no larger than life size at four focal lengths
    return distance_of_magnification_mm(camera.focal_length_mm, min(max(parts), 1.0))


def _whole_sheet_distance_mm(camera: Camera, sheet: Sheet) -> float:
    sides = (sheet.width_mm, sheet.height_mm)
    parts = [s / e for s, e in zip(camera.sensor_mm, sides, strict=True)]
    return distance_of_magnification_mm(camera.focal_length_mm, min(*parts, 1.0))


def _paper_for(camera: Camera, wanted: Wanted, distance_mm: float | None) -> Sheet:
    if distance_mm is None:
        return paper_sheet("A3")
    magnification = magnification_at(camera.focal_length_mm, distance_mm)
    sheets = [paper_sheet(name) for name in sorted(PAPERS) if name.startswith("A")]
    for sheet in reversed(sheets):
        try:
            extent = _extent_mm(lay_out(sheet, wanted))
        except ChartError:
            continue  # too small for that pitch
        if all(
            e * magnification >= s
            for e, s in zip(extent, camera.sensor_mm, strict=True)
        ):
            return sheet
    return sheets[0]


def _marks_in(layout: Layout, field_mm: tuple[float, ...]) -> int:
    count = 1
    for number, side in zip(layout.pattern.lattice_size, field_mm, strict=True):
        place = (np.arange(number) - (number - 1) / 2) * layout.pattern.pitch_mm
        count *= int(np.count_nonzero(np.abs(place) <= side / 2))
    missing = layout.pattern.kind == "dot-grid" and layout.pattern.oriented
    return max(count - 4 * missing, 0)


def _notes(camera: Camera, layout: Layout, advice: Advice) -> tuple[str, ...]:
    notes = []
    extent = _extent_mm(layout)
    parts = [e / f for e, f in zip(extent, advice.field_mm, strict=True)]
    if min(parts) < 0.95:
        notes.append(
            f"the pattern covers {min(parts[0], 1):.0%} of the frame's width and "
            f"{min(parts[1], 1):.0%} of its height: use a larger sheet, or go to "
            f"{_filling_distance_mm(camera, extent):.0f} mm"
        )
    if advice.distance_mm < CLOSE_FOCAL_LENGTHS * camera.focal_length_mm:
        notes.append(
            f"{advice.distance_mm:.0f} mm is nearer than many lenses focus: a larger "
            "sheet fills the frame from farther away"
        )
    if advice.pitch_px < 12:
        notes.append("marks are less than 12 px apart: use a larger pitch")
    if advice.marks_on_frame < 150:
        notes.append("fewer than 150 marks land on the frame: use a smaller pitch")
    if advice.kind == "dot-grid":
        if advice.mark_px < 1.5:
            notes.append("dots are smaller than 1.5 px: make them larger")
        if advice.mark_px > 1.8:
            notes.append(
                f"to measure blur too, photograph holes of {advice.small_hole_mm:.2g} "
                f"mm ({SMALL_HOLE_PX:g} px); these are {advice.mark_px:.1f} px wide"
            )
    at = advice.whole_sheet_distance_mm
    module = magnification_at(camera.focal_length_mm, max(at, advice.distance_mm))
    module *= layout.module_mm / camera.pixel_mm
    if module < READABLE_MODULE_PX:
        notes.append(
            f"the code's modules are {module:.1f} px where the whole sheet is seen, "
            "too few to read: state the target in the shoot file"
        )
    elif at > 1.02 * advice.distance_mm:
        notes.append(
            "the code lies outside the frame at this distance: let one sharp take show "
            f"a whole strip, for instance from {at:.0f} mm, or state the target"
        )
    return tuple(notes)


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
