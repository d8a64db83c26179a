"""Drawings as SVG 1.1: millimetres as they are, to a billionth."""

from pathlib import Path
from xml.sax.saxutils import escape

from lensfit.atomic import write_text_atomic
from lensfit.chart.drawing import Drawing, Layer, Outline

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
    width, height = _number(drawing.width_mm), _number(drawing.height_mm)
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}mm" '
        f'height="{height}mm" viewBox="0 0 {width} {height}">',
        f"<title>{escape(drawing.title)}</title>",
        f'<rect width="{width}" height="{height}" fill="{_colour(drawing.ground)}"/>',
    ]
    for layer in drawing.layers:
        lines += [f'<g fill="{_colour(layer.tone)}">', *_shapes(layer), "</g>"]
    return "\n".join([*lines, "</svg>", ""])


def _shapes(layer: Layer) -> list[str]:
    discs = [
        f'<circle cx="{_number(x)}" cy="{_number(y)}" r="{_number(r)}"/>'
        for x, y, r in layer.discs_mm.tolist()
    ]
    boxes = [
        f'<rect x="{_number(x)}" y="{_number(y)}" width="{_number(w)}" '
        f'height="{_number(h)}"/>'
        for x, y, w, h in layer.boxes_mm.tolist()
    ]
    letters = [f'<path d="{_outline(outline)}"/>' for outline in layer.outlines]
    return discs + boxes + letters


def _outline(outline: Outline) -> str:
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


def _number(value: float) -> str:
    text = f"{value:.9f}".rstrip("0").rstrip(".")
    return "0" if text in ("-0", "") else text


def _colour(tone: float) -> str:
    return "#fff" if tone > 0.5 else "#000"
