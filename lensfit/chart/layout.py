"""Where everything lies on a chart's sheet.

A band along the top holds the code strip and the caption, one along the bottom the
ruler and, where there is room, the code strip again; the pattern is centred between.
All of it keeps clear of the pattern: by at least three quarters of a pitch, beyond what
a detector measures around a dot, and by more than one pitch of a line grid, so that
nothing printed lies where one more line might be looked for.

Captions are outlines, so that a chart looks the same wherever it is opened: DejaVu
Sans, which comes with matplotlib.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextPath

from lensfit.chart.drawing import BLACK, WHITE, Drawing, Layer, Outline
from lensfit.chart.pattern import (
    LINE_END,
    STRIP_MODULES,
    ChartKind,
    Pattern,
    Polarity,
    make_pattern,
    marker_cells,
    marker_ids,
    nearest_printable_length_mm,
    pattern_layers,
)
from lensfit.chart.sheet import Sheet
from lensfit.errors import ChartError

_FONT = FontProperties(family="DejaVu Sans")
_EM = 100.0


def text_outline(
    text: str, left_mm: float, baseline_mm: float, size_mm: float, *, align: float = 0.0
) -> Outline:
    """A line of text.

    Parameters
    ----------
    size_mm : Height of the font's em.
    align : Part of the text's width that lies left of `left_mm`: 0, 0.5 or 1.
    """
    path = TextPath((0, 0), text, size=_EM, prop=_FONT)
    points = np.asarray(path.vertices, float) * [1.0, -1.0] * (size_mm / _EM)
    points[:, 0] -= align * width_per_em(text) * size_mm
    codes = np.asarray(path.codes, int)
    return Outline(points + np.array([left_mm, baseline_mm]), codes)


def width_per_em(text: str) -> float:
    """Width of a line of text, in heights of the font's em."""
    path = TextPath((0, 0), text, size=_EM, prop=_FONT)
    return float(np.asarray(path.vertices)[:, 0].max()) / _EM


CLEAR_PITCHES = 0.75
LINE_CLEAR_PITCHES = 1.5
_MODULE_PART = 1 / 500
"""Module of the code, as part of the sheet's width plus height."""
_SMALLEST_MODULE_MM = 0.15
_LARGEST_LENGTH_MM = 400.0
"""The code has room for marks up to 419 mm wide."""
_RULERS_MM = (100, 50, 20, 10)
_NICE = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
FOIL_BAR = 0.15
"""Width of what stays between holes of the code, in modules."""
_MARKS_ACROSS = 28
_DOT_PART, _LINE_PART = 0.25, 0.06


class Wanted(NamedTuple):
    """What is asked of a chart; None means: choose what suits the sheet.

    Attributes
    ----------
    mark_mm : Diameter of a dot or width of a line.
    polarity : By default bright marks on black, and a checkerboard on white.
    """

    kind: ChartKind = "dot-grid"
    pitch_mm: float | None = None
    mark_mm: float | None = None
    polarity: Polarity | None = None


@dataclass(frozen=True)
class Layout:
    """A pattern in its place on a sheet.

    Attributes
    ----------
    origin_mm : Place of lattice point (0, 0).
    module_mm : Module of the code.
    code_mm : Top left corners of the code strips.
    ruler_mm : Length of the ruler's bar.
    ruler_at_mm : Top left corner of the bar.
    """

    sheet: Sheet
    pattern: Pattern
    origin_mm: tuple[float, float]
    module_mm: float
    code_mm: tuple[tuple[float, float], ...]
    ruler_mm: int
    ruler_at_mm: tuple[float, float]

    @property
    def band_mm(self) -> float:
        """Height of the bands above and below the pattern."""
        return STRIP_MODULES[1] * self.module_mm


def lay_out(sheet: Sheet, wanted: Wanted) -> Layout:
    """Fill a sheet with as many marks as it holds.

    Raises
    ------
    ChartError : The pattern or the code does not fit.
    """
    wide = sheet.width_mm - 2 * sheet.margin_mm
    module = min((sheet.width_mm + sheet.height_mm) * _MODULE_PART, wide / 113)
    if sheet.pixel_mm is not None:
        module = max(math.floor(module / sheet.pixel_mm), 1) * sheet.pixel_mm
    if module * STRIP_MODULES[0] > wide + 1e-9 or module < _SMALLEST_MODULE_MM:
        raise ChartError(
            f"the sheet of {sheet.width_mm:g} x {sheet.height_mm:g} mm is too small "
            "for the chart's code",
            remedy="use a larger sheet or a smaller margin",
        )
    pattern = _pattern(sheet, wanted, module)
    across = (np.array(pattern.lattice_size) - 1) * pattern.pitch_mm
    origin = (np.array([sheet.width_mm, sheet.height_mm]) - across) / 2
    bottom = sheet.height_mm - sheet.margin_mm - STRIP_MODULES[1] * module
    ruler = next((n for n in _RULERS_MM if n <= wide), _RULERS_MM[-1])
    strip = STRIP_MODULES[0] * module
    codes = [(sheet.margin_mm, sheet.margin_mm)]
    if ruler + 12 * module + strip <= wide:
        codes.append((sheet.width_mm - sheet.margin_mm - strip, bottom))
    return Layout(
        sheet=sheet,
        pattern=pattern,
        origin_mm=(float(origin[0]), float(origin[1])),
        module_mm=module,
        code_mm=tuple(codes),
        ruler_mm=ruler,
        ruler_at_mm=(sheet.margin_mm + module, bottom + module),
    )


def _pattern(sheet: Sheet, wanted: Wanted, module_mm: float) -> Pattern:
    checker = wanted.kind == "checkerboard"
    polarity = wanted.polarity or ("dark" if checker else "bright")
    if checker and (polarity == "bright" or wanted.mark_mm is not None):
        raise ChartError(
            "a checkerboard has neither polarity nor width of a mark",
            remedy="leave these options out",
        )
    pitch = _nice_pitch_mm(sheet) if wanted.pitch_mm is None else wanted.pitch_mm
    part = {"dot-grid": _DOT_PART, "line-grid": _LINE_PART, "checkerboard": 0.0}
    mark = part[wanted.kind] * pitch if wanted.mark_mm is None else wanted.mark_mm
    widths = {"dot-grid": "--hole-diameter-mm", "line-grid": "--line-width-mm"}
    lengths = [("--pitch-mm", pitch, 0.01)]
    lengths += [(widths[wanted.kind], mark, 0.001)] if not checker else []
    for option, length, least in lengths:
        if not (math.isfinite(length) and least <= length < _LARGEST_LENGTH_MM):
            raise ChartError(
                f"{option} {length:g} is out of range",
                remedy=f"give {least:g} to {_LARGEST_LENGTH_MM:g} mm",
            )
    pitch, mark = nearest_printable_length_mm(pitch), nearest_printable_length_mm(mark)
    band = sheet.margin_mm + STRIP_MODULES[1] * module_mm
    lines = wanted.kind == "line-grid"
    clear = (LINE_CLEAR_PITCHES if lines else CLEAR_PITCHES) * pitch
    clear = max(clear, mark / 2 + 2 * module_mm)
    size = np.array([sheet.width_mm, sheet.height_mm])
    if checker:
        kept = np.array([sheet.margin_mm, band + 0.25 * pitch])
        count = np.floor((size - 2 * kept) / pitch + 1e-9)
    else:
        end = LINE_END * pitch if lines else mark / 2
        beside = max(CLEAR_PITCHES * pitch, sheet.margin_mm + end)
        kept = np.array([beside, band + clear])
        count = np.floor((size - 2 * kept) / pitch + 1e-9) + 1
    columns, rows = (max(int(n), 0) for n in count)
    return make_pattern(wanted.kind, polarity, pitch, mark, columns, rows)


def _nice_pitch_mm(sheet: Sheet) -> float:
    """About `_MARKS_ACROSS` marks across the longer side, by a round number."""
    longest = max(sheet.width_mm, sheet.height_mm) / _MARKS_ACROSS
    ten = 10.0 ** math.floor(math.log10(longest))
    return ten * min(_NICE, key=lambda n: abs(n - longest / ten))


def draw(layout: Layout, version: str) -> Drawing:
    """Everything that is on the sheet.

    Parameters
    ----------
    version : Of lensfit, for the caption.
    """
    dark = layout.pattern.polarity == "dark"
    ground, ink = (WHITE, BLACK) if dark else (BLACK, WHITE)
    boxes = np.concatenate([_code_boxes(layout), _ruler_boxes(layout)])
    letters = (*_ruler_letters(layout), *_caption(layout, version))
    return Drawing(
        width_mm=layout.sheet.width_mm,
        height_mm=layout.sheet.height_mm,
        ground=ground,
        layers=(
            *pattern_layers(layout.pattern, layout.origin_mm, ink, ground),
            Layer(ink, boxes_mm=boxes, outlines=letters),
        ),
        title=", ".join(pattern_description(layout.pattern)),
    )


def foil_drawing(layout: Layout) -> Drawing:
    """The holes to cut into foil, none of which encloses a part that falls out.

    Each inked module of the code is a hole of its own: bars of `FOIL_BAR` modules that
    stay between them hold every module that is not inked. Ruler and caption, whose
    letters would fall out, are left away.

    Raises
    ------
    ChartError : What lies between lines or squares would fall out, or dark dots would.
    """
    pattern = layout.pattern
    if pattern.kind != "dot-grid" or pattern.polarity != "bright":
        raise ChartError(
            f"a {pattern.kind.replace('-', ' ')} of {pattern.polarity} marks falls "
            "apart when it is cut",
            remedy="cut a dot grid of bright marks, or write SVG or PDF and print it",
        )
    return Drawing(
        width_mm=layout.sheet.width_mm,
        height_mm=layout.sheet.height_mm,
        ground=BLACK,
        layers=(
            *pattern_layers(pattern, layout.origin_mm, WHITE, BLACK),
            Layer(WHITE, boxes_mm=_code_boxes(layout, bar=FOIL_BAR)),
        ),
        title=", ".join(pattern_description(pattern)),
    )


def pattern_description(pattern: Pattern) -> tuple[str, str]:
    """A pattern in words: what it is, and its sizes."""
    name = pattern.kind.replace("-", " ")
    if pattern.kind == "checkerboard":
        sizes = f"squares of {pattern.pitch_mm:g} mm"
    else:
        name += f", {pattern.polarity} marks"
        mark = "dot" if pattern.kind == "dot-grid" else "line"
        sizes = f"pitch {pattern.pitch_mm:g} mm, {mark} {pattern.mark_mm:g} mm"
    return name, f"{sizes}, {pattern.columns} x {pattern.rows}"


def _code_boxes(layout: Layout, bar: float = 0.0) -> np.ndarray:
    """Runs of inked modules of every strip, or each module by itself where bars, so
    many modules wide, stay between them."""
    module_mm, boxes = layout.module_mm, []
    for left_mm, top_mm in layout.code_mm:  # of the quiet zone
        for position, marker in enumerate(marker_ids(layout.pattern)):
            for row, cells in enumerate(marker_cells(marker)):
                for start, end in _each(cells) if bar else _runs(cells):
                    place = np.array([1 + 8 * position + start, 1 + row]) + bar / 2
                    size = np.array([end - start, 1]) - bar
                    at = [left_mm, top_mm] + module_mm * place
                    boxes.append((*at, *(module_mm * size)))
    return np.array(boxes)


def _runs(cells: np.ndarray) -> np.ndarray:
    """Where each run of inked cells begins and ends."""
    edges = np.flatnonzero(np.diff(np.r_[False, cells, False].astype(int)))
    return edges.reshape(-1, 2)


def _each(cells: np.ndarray) -> np.ndarray:
    """Where each inked cell begins and ends."""
    return np.flatnonzero(cells)[:, None] + [0, 1]


def _ruler_boxes(layout: Layout) -> np.ndarray:
    """A bar of the ruler's exact length, and ticks below it."""
    left, top = layout.ruler_at_mm
    thick = 0.15 * layout.band_mm
    boxes = [(left, top, float(layout.ruler_mm), thick)]
    for tick in range(layout.ruler_mm + 1):
        part = 0.3 if tick % 10 == 0 else 0.2 if tick % 5 == 0 else 0.12
        # the outer ticks stay inside the bar's ends
        x = min(max(tick - 0.1, 0.0), layout.ruler_mm - 0.2)
        boxes.append((left + x, top + thick, 0.2, part * layout.band_mm))
    return np.array(boxes)


def _ruler_letters(layout: Layout) -> list[Outline]:
    left, top = layout.ruler_at_mm
    size = min(0.28 * layout.band_mm, 0.06 * layout.ruler_mm)
    base = top + 0.45 * layout.band_mm + 0.8 * size
    half, whole = layout.ruler_mm // 2, layout.ruler_mm
    return [
        text_outline("0", left, base, size),
        text_outline(f"{half}", left + half, base, size, align=0.5),
        text_outline(f"{whole} mm", left + whole, base, size, align=1.0),
    ]


def _caption(layout: Layout, version: str) -> list[Outline]:
    """Three lines beside the first code strip, as large as there is room."""
    name, sizes = pattern_description(layout.pattern)
    shown = "show" if layout.sheet.pixel_mm is not None else "print"
    lines = (
        f"lensfit {version}: {name}",
        sizes,
        f"{shown} at 100 %: the bar below measures {layout.ruler_mm} mm",
    )
    left = layout.code_mm[0][0] + (STRIP_MODULES[0] + 3) * layout.module_mm
    room = layout.sheet.width_mm - layout.sheet.margin_mm - left
    widest = max(width_per_em(line) for line in lines)
    size = min(0.26 * layout.band_mm, room / widest)
    if size < 0.1 * layout.band_mm:
        return _caption_below(layout, lines)
    top = layout.code_mm[0][1] + layout.band_mm / 2 - 1.4 * size
    return [
        text_outline(line, left, top + (0.78 + 1.0 * k) * size * 1.2, size)
        for k, line in enumerate(lines)
    ]


def _caption_below(layout: Layout, lines: tuple[str, ...]) -> list[Outline]:
    """The same as one line, small, under the ruler or beside it."""
    text = ", ".join(lines[:2])
    left, top = layout.ruler_at_mm
    room = layout.sheet.width_mm - 2 * left
    size = min(0.2 * layout.band_mm, room / width_per_em(text))
    return [text_outline(text, left, top + 0.98 * layout.band_mm, size)]
