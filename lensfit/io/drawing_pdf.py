"""Drawings as one page of PDF, drawn by matplotlib; 72 points are 25.4 mm.

Discs are eight cubic arcs each, true to a millionth of their radius, and places are
rounded to a millionth of a point.
"""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.backends.backend_pdf import FigureCanvasPdf
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Curves

from lensfit.atomic import atomic_path
from lensfit.chart.drawing import Drawing, Layer
from lensfit.units import MILLIMETRES_PER_INCH


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
        curves = _curves(layer)
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


def _curves(layer: Layer) -> Curves | None:
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
