"""Drawings as DXF for laser cutters: closed shapes along which to cut, in millimetres.

ASCII DXF of release 12, which every cutter's program reads: circles, and closed
polylines of boxes, on the layer `CUT`. y points up. Letters are not written: the middle
of an "o" would fall out.

Reference: Autodesk, DXF Reference, group codes of HEADER and ENTITIES.
"""

from collections.abc import Iterator
from pathlib import Path

from lensfit.atomic import write_text_atomic
from lensfit.chart.drawing import Drawing, Layer

_LAYER = "CUT"
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
        *(group for layer in drawing.layers for group in _circles(layer, height)),
        *(group for layer in drawing.layers for group in _outlines(layer, height)),
        (0, "ENDSEC"),
        (0, "EOF"),
    ]
    return "".join(f"{code}\n{_text(value)}\n" for code, value in groups)


def _circles(layer: Layer, height_mm: float) -> Iterator[tuple[int, object]]:
    for x, y, radius in layer.discs_mm.tolist():
        yield from ((0, "CIRCLE"), (8, _LAYER))
        yield from ((10, x), (20, height_mm - y), (40, radius))


def _outlines(layer: Layer, height_mm: float) -> Iterator[tuple[int, object]]:
    for left, top, wide, high in layer.boxes_mm.tolist():
        yield from ((0, "POLYLINE"), (8, _LAYER), (66, 1), (70, 1))
        for across, down in ((0, 0), (1, 0), (1, 1), (0, 1)):
            yield from ((0, "VERTEX"), (8, _LAYER), (10, left + across * wide))
            yield 20, height_mm - top - down * high
        yield from ((0, "SEQEND"), (8, _LAYER))


def _text(value: object) -> str:
    return f"{value:.6f}" if isinstance(value, float) else str(value)
