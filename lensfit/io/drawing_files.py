"""Drawings of charts as files: SVG, DXF, PDF, and as pixels PNG and EXR.

SVG is version 1.1, with millimetres as they are, to a billionth.

DXF is for laser cutters: closed shapes along which to cut, in millimetres. It is the
ASCII DXF of release 12, which every cutter's program reads: circles, and closed
polylines of boxes, on the layer `CUT`. y points up. Letters are not written: the middle
of an "o" would fall out.

PDF is one page, drawn by matplotlib; 72 points are 25.4 mm. Discs are eight cubic arcs
each, true to a millionth of their radius, and places are rounded to a millionth of a
point.

PNG is for displays and printers, EXR in linear light. Every pixel holds the mean over
its area (`lensfit.chart.coverage`). PNG is sRGB, 8 bit grey, and says its pixels' size;
EXR is float, 1 for white.

References
----------
Autodesk, DXF Reference, group codes of HEADER and ENTITIES.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
from jaxtyping import Float
from matplotlib import rc_context
from matplotlib.backends.backend_pdf import FigureCanvasPdf
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Curves
from PIL import Image

from lensfit.atomic import atomic_path, write_text_atomic
from lensfit.chart.drawing import Drawing, Layer, Outline
from lensfit.coords import Window
from lensfit.io.exr import ExrImage, ExrPart, write_exr
from lensfit.io.transfer import encode
from lensfit.units import MILLIMETRES_PER_INCH

_LETTERS = {1: "M", 2: "L", 3: "Q", 4: "C"}
_CLOSE = 79


def write_svg(path: str | Path, drawing: Drawing) -> None:
    """Write a drawing; a user unit is a millimetre.

    Raises
    ------
    OutputError : The file cannot be written.
    """
    write_text_atomic(path, svg(drawing))


def svg(drawing: Drawing) -> str:
    """The text of the file."""
    width, height = _svg_number(drawing.width_mm), _svg_number(drawing.height_mm)
    ground = _svg_colour(drawing.ground)
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}mm" '
        f'height="{height}mm" viewBox="0 0 {width} {height}">',
        f"<title>{escape(drawing.title)}</title>",
        f'<rect width="{width}" height="{height}" fill="{ground}"/>',
    ]
    for layer in drawing.layers:
        lines += [f'<g fill="{_svg_colour(layer.tone)}">', *_svg_shapes(layer), "</g>"]
    return "\n".join([*lines, "</svg>", ""])


def _svg_shapes(layer: Layer) -> list[str]:
    discs = [
        f'<circle cx="{_svg_number(x)}" cy="{_svg_number(y)}" r="{_svg_number(r)}"/>'
        for x, y, r in layer.discs_mm.tolist()
    ]
    boxes = [
        f'<rect x="{_svg_number(x)}" y="{_svg_number(y)}" width="{_svg_number(w)}" '
        f'height="{_svg_number(h)}"/>'
        for x, y, w, h in layer.boxes_mm.tolist()
    ]
    letters = [f'<path d="{_svg_path(outline)}"/>' for outline in layer.outlines]
    return discs + boxes + letters


def _svg_path(outline: Outline) -> str:
    words, before = [], 0
    for (x, y), code in zip(
        outline.points_mm.tolist(), outline.codes.tolist(), strict=True
    ):
        if code == _CLOSE:
            words.append("Z")
        else:
            # further points of one curve follow without a letter
            words.append("" if before > 0 else _LETTERS[code])
            words[-1] += f"{x:.4f} {y:.4f}"
            before = before - 1 if before > 0 else {3: 1, 4: 2}.get(code, 0)
    return " ".join(words)


def _svg_number(value: float) -> str:
    text = f"{value:.9f}".rstrip("0").rstrip(".")
    return "0" if text in ("-0", "") else text


def _svg_colour(tone: float) -> str:
    return "#fff" if tone > 0.5 else "#000"


_DXF_LAYER = "CUT"
_MILLIMETRES = 4
"""Of $INSUNITS."""


def write_dxf(path: str | Path, drawing: Drawing) -> None:
    """Write the discs and boxes of a drawing.

    Raises
    ------
    OutputError : The file cannot be written.
    """
    write_text_atomic(path, dxf(drawing))


def dxf(drawing: Drawing) -> str:
    """The text of the file."""
    width, height = drawing.width_mm, drawing.height_mm
    groups: list[tuple[int, object]] = [
        (999, drawing.title),
        (0, "SECTION"),
        (2, "HEADER"),
        (9, "$ACADVER"),
        (1, "AC1009"),
        (9, "$INSUNITS"),
        (70, _MILLIMETRES),
        (9, "$EXTMIN"),
        (10, 0.0),
        (20, 0.0),
        (9, "$EXTMAX"),
        (10, width),
        (20, height),
        (0, "ENDSEC"),
        (0, "SECTION"),
        (2, "ENTITIES"),
        *(group for layer in drawing.layers for group in _dxf_circles(layer, height)),
        *(group for layer in drawing.layers for group in _dxf_outlines(layer, height)),
        (0, "ENDSEC"),
        (0, "EOF"),
    ]
    return "".join(f"{code}\n{_dxf_value(value)}\n" for code, value in groups)


def _dxf_circles(layer: Layer, height_mm: float) -> Iterator[tuple[int, object]]:
    for x, y, radius in layer.discs_mm.tolist():
        yield from ((0, "CIRCLE"), (8, _DXF_LAYER))
        yield from ((10, x), (20, height_mm - y), (40, radius))


def _dxf_outlines(layer: Layer, height_mm: float) -> Iterator[tuple[int, object]]:
    for left, top, wide, high in layer.boxes_mm.tolist():
        yield from ((0, "POLYLINE"), (8, _DXF_LAYER), (66, 1), (70, 1))
        for across, down in ((0, 0), (1, 0), (1, 1), (0, 1)):
            yield from ((0, "VERTEX"), (8, _DXF_LAYER), (10, left + across * wide))
            yield 20, height_mm - top - down * high
        yield from ((0, "SEQEND"), (8, _DXF_LAYER))


def _dxf_value(value: object) -> str:
    return f"{value:.6f}" if isinstance(value, float) else str(value)


def write_pdf(path: str | Path, drawing: Drawing, *, compressed: bool = True) -> None:
    """Write a drawing as a page of its size.

    Parameters
    ----------
    compressed : Leave it out to read the drawing's commands as text.

    Raises
    ------
    OutputError : The file cannot be written.
    """
    width, height = drawing.width_mm, drawing.height_mm
    inches = (width / MILLIMETRES_PER_INCH, height / MILLIMETRES_PER_INCH)
    figure = Figure(figsize=inches, facecolor=str(drawing.ground))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    axes.set_xlim(0, width)
    axes.set_ylim(height, 0)
    for layer in drawing.layers:
        curves = _pdf_curves(layer)
        if curves is not None:
            shape = PathPatch(curves, facecolor=str(layer.tone), linewidth=0)
            shape.set_clip_on(False)
            axes.add_artist(shape)
    settings: dict[Any, Any] = {
        "pdf.compression": 6 if compressed else 0,
        "path.simplify": False,
    }
    with atomic_path(path) as temporary, rc_context(settings):
        about = {"Title": drawing.title, "CreationDate": None}
        canvas = FigureCanvasPdf(figure)
        canvas.print_pdf(temporary, metadata=about)


def _pdf_curves(layer: Layer) -> Curves | None:
    """All shapes of a layer in one path."""
    circle = Curves.unit_circle()
    round_ones = [
        Curves(np.asarray(circle.vertices) * r + np.array([x, y]), circle.codes)
        for x, y, r in layer.discs_mm
    ]
    square = Curves.unit_rectangle()
    boxes = [
        Curves(np.asarray(square.vertices) * [w, h] + np.array([x, y]), square.codes)
        for x, y, w, h in layer.boxes_mm
    ]
    letters = [Curves(o.points_mm, o.codes) for o in layer.outlines]
    parts = [*round_ones, *boxes, *letters]
    return Curves.make_compound_path(*parts) if parts else None


def write_png(
    path: str | Path, tones: Float[np.ndarray, "height width"], pixel_mm: float
) -> None:
    """Write tones, scene-linear in 0..1, as sRGB.

    Raises
    ------
    OutputError : The file cannot be written.
    """
    codes = np.empty(tones.shape, np.uint8)
    for row, light in enumerate(tones):  # a row at a time: sheets are large
        codes[row] = np.round(255 * encode(np.clip(light, 0, 1), "srgb"))
    per_inch = MILLIMETRES_PER_INCH / pixel_mm
    with atomic_path(path) as temporary:
        Image.fromarray(codes).save(temporary, format="PNG", dpi=(per_inch, per_inch))


def write_tones_exr(path: str | Path, tones: Float[np.ndarray, "height width"]) -> None:
    """Write tones, scene-linear, as R, G and B of an OpenEXR file.

    Raises
    ------
    OutputError : The file cannot be written.
    """
    window = Window.of_size(tones.shape[1], tones.shape[0])
    plane = np.ascontiguousarray(tones, np.float32)
    part = ExrPart({name: plane for name in "RGB"}, window, window)
    write_exr(path, ExrImage((part,)))
