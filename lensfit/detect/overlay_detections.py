"""Detections, links, labels and the legend of an overlay, at sub-pixel positions."""

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8
from PIL import Image, ImageDraw, ImageFont

from lensfit.detect.observations import LINE_OF_CONSTANT_I, POINT, Observations

LABEL_EVERY = (5, 10, 20, 50)
"""Detections between labels: the first that keeps them this many widths apart."""
LABEL_WIDTHS_APART = 3
SUBPIXEL_BITS = 4
LINK_OPACITY = 0.55
CLIPPED_COLOUR = (255, 64, 64)
TOUCHING_COLOUR = (255, 210, 0)
INK, FAINT_INK, PAPER = (236, 236, 236), (160, 160, 166), (22, 22, 24)
LARGEST_RING_PX, SMALLEST_RING_PX = 14.0, 2.5

Canvas = UInt8[np.ndarray, "height width 3"]
Colours = UInt8[np.ndarray, "detections 3"]


def draw_points(
    canvas: Canvas, found: Observations, colours: Colours, scale: float
) -> None:
    """Rings on detections known in both directions, joined to lattice neighbours."""
    detections = np.flatnonzero(found.family == POINT)
    places = found.points_px[detections] * scale
    pairs = _neighbours(found.lattice[detections])
    spacing = _spacing_px(found, scale)
    faint = canvas.copy()
    for a, b in pairs:
        _stroke(faint, places[a], places[b], colours[detections[a]])
    cv2.addWeighted(faint, LINK_OPACITY, canvas, 1 - LINK_OPACITY, 0, dst=canvas)
    radius = _ring_radius(found, scale, spacing)[detections]
    for place, size, detection in zip(places, radius, detections.tolist(), strict=True):
        _ring(canvas, place, size, colours[detection])
        arm = min(3.0, 0.45 * size)
        for way in (np.array([arm, 0.0]), np.array([0.0, arm])):
            _stroke(canvas, place - way, place + way, colours[detection])
        _flags(canvas, place, size, found, detection)


def _spacing_px(found: Observations, scale: float) -> float:
    """Usual distance of neighbouring detections on the picture."""
    detections = found.family == POINT
    pairs = _neighbours(found.lattice[detections])
    ends = found.points_px[detections][pairs] * scale
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    return float(np.median(lengths)) if len(lengths) else 40.0


def _label_every(found: Observations, scale: float, label_px: float) -> int:
    wanted = LABEL_WIDTHS_APART * label_px / _spacing_px(found, scale)
    return next((n for n in LABEL_EVERY if n >= wanted), LABEL_EVERY[-1])


def _ring_radius(found: Observations, scale: float, spacing: float) -> np.ndarray:
    """Just around a dot, else a part of the spacing; never into the next ring."""
    radius = found.diameter_px * scale / 2 + 1.5
    radius = np.where(np.isfinite(radius), radius, 0.16 * spacing)
    largest = max(SMALLEST_RING_PX, min(LARGEST_RING_PX, 0.42 * spacing))
    return np.clip(radius, SMALLEST_RING_PX, largest)


def draw_samples(
    canvas: Canvas, found: Observations, colours: Colours, scale: float
) -> None:
    """A dash along the line at each of its samples."""
    detections = np.flatnonzero(found.family != POINT)
    places = found.points_px[detections] * scale
    along = np.stack([-found.normal[detections, 1], found.normal[detections, 0]], -1)
    number = found.lattice[detections, found.family[detections]]
    order = np.lexsort(
        [
            found.lattice[detections, 1 - found.family[detections]],
            number,
            found.family[detections],
        ]
    )
    gaps = np.linalg.norm(np.diff(places[order], axis=0), axis=1)
    half = 0.36 * float(np.median(gaps)) if len(gaps) else 4.0
    for place, way, detection in zip(places, along, detections.tolist(), strict=True):
        _stroke(canvas, place - half * way, place + half * way, colours[detection])
        _ring(canvas, place, 1.3, colours[detection])
        _flags(canvas, place, 4.0, found, detection)


def draw_labels(picture: Image.Image, found: Observations, scale: float) -> None:
    """Lattice indices at every fifth detection (rarer where they are dense), line
    numbers at the ends of every fifth."""
    pen = ImageDraw.Draw(picture)
    size = round(11 * _unit(picture.width))
    font = ImageFont.load_default(size)
    width, height = picture.size
    every = _label_every(found, scale, pen.textlength("00, 00", font))

    def write(place: np.ndarray, text: str) -> None:
        x = min(max(place[0], 2), width - pen.textlength(text, font) - 2)
        y = min(max(place[1], size), height - 2)
        pen.text(
            (x, y), text, INK, font, anchor="ls", stroke_width=2, stroke_fill=PAPER
        )

    for detection in np.flatnonzero(found.family == POINT):
        i, j = found.lattice[detection].astype(int)
        if i % every == 0 and j % every == 0:
            write(found.points_px[detection] * scale + [6, -6], f"{i}, {j}")
    for family, number, ends in _line_ends(found):
        name = "i" if family == LINE_OF_CONSTANT_I else "j"
        for end in ends:
            write(found.points_px[end] * scale + [4, -4], f"{name} {number}")


def with_legend(
    picture: Image.Image, found: Observations, name: str, swatches: Colours
) -> Image.Image:
    """The picture with a strip that names it, explains it and counts what is on it."""
    unit = _unit(picture.width)
    font = ImageFont.load_default(round(15 * unit))
    width, height = picture.size
    whole = Image.new("RGB", (width, height + round(40 * unit)), PAPER)
    whole.paste(picture, (0, 0))
    pen = ImageDraw.Draw(whole)
    y, half, gap = height + 20 * unit, 5 * unit, 28 * unit
    x = 14 * unit
    for text, ink in ((name, INK), (_summary(found), FAINT_INK)):
        x = _write(pen, x, y, text, ink, font) + gap
    for colour in swatches:
        pen.rectangle([x, y - half, x + half, y + half], tuple(map(int, colour)))
        x += half + 1
    meaning = "rows" if (found.family == POINT).all() else "lines"
    x = _write(pen, x + half, y, meaning, FAINT_INK, font) + gap
    clipped, touching = int(found.saturated.sum()), int(found.overlapping.sum())
    ink = CLIPPED_COLOUR if clipped else FAINT_INK
    pen.line([x, y - half, x + 2 * half, y + half], ink, 2)
    pen.line([x, y + half, x + 2 * half, y - half], ink, 2)
    x = _write(pen, x + 3 * half, y, f"{clipped} clipped", ink, font) + gap
    ink = TOUCHING_COLOUR if touching else FAINT_INK
    pen.rectangle([x, y - half, x + 2 * half, y + half], outline=ink, width=2)
    _write(pen, x + 3 * half, y, f"{touching} touching", ink, font)
    return whole


def _unit(width: int) -> float:
    """How much larger text and strip are drawn on a wider picture."""
    return max(1.0, width / 1500)


def _write(
    pen: ImageDraw.ImageDraw,
    x: float,
    y: float,
    text: str,
    ink: tuple[int, int, int],
    font: ImageFont.FreeTypeFont | ImageFont.ImageFont,
) -> float:
    """Write, and return where the text ends."""
    pen.text((x, y), text, ink, font, anchor="lm")
    return x + pen.textlength(text, font)


def _summary(found: Observations) -> str:
    lines = found.family != POINT
    if lines.any():
        counts = [
            len(np.unique(found.lattice[found.family == family, family]))
            for family in (0, 1)
        ]
        return f"{len(found)} samples on {counts[0]} + {counts[1]} lines"
    low, high = found.lattice.min(0).astype(int), found.lattice.max(0).astype(int)
    return (
        f"{len(found)} of {found.candidates} candidates   "
        f"i {low[0]}…{high[0]}   j {low[1]}…{high[1]}"
    )


def _line_ends(found: Observations) -> list[tuple[int, int, tuple[int, int]]]:
    """Family, number and the two outermost samples of every fifth line."""
    ends = []
    for family in (0, 1):
        of_family = np.flatnonzero(found.family == family)
        numbers = found.lattice[of_family, family].astype(int)
        for number in np.unique(numbers):
            if number % LABEL_EVERY[0] == 0:
                own = of_family[numbers == number]
                along = found.lattice[own, 1 - family]
                ends.append(
                    (family, int(number), (own[along.argmin()], own[along.argmax()]))
                )
    return ends


def _neighbours(
    lattice: Float[np.ndarray, "detections 2"],
) -> Int[np.ndarray, "pairs 2"]:
    """Pairs of detections one step apart; the step is two where none has odd i + j."""
    cells = np.round(lattice).astype(int)
    at = {tuple(cell): k for k, cell in enumerate(cells.tolist())}
    staggered = len(cells) > 1 and (cells.sum(1) % 2 == cells[0].sum() % 2).all()
    steps = ((1, 1), (1, -1)) if staggered else ((1, 0), (0, 1))
    pairs = [
        (k, at[i + di, j + dj])
        for (i, j), k in at.items()
        for di, dj in steps
        if (i + di, j + dj) in at
    ]
    return np.array(pairs, int).reshape(-1, 2)


def _fixed(place: np.ndarray) -> tuple[int, int]:
    """OpenCV's fixed-point coordinates of a position with pixel centres at 0.5."""
    x, y = np.round((place - 0.5) * (1 << SUBPIXEL_BITS)).astype(int)
    return int(x), int(y)


def _stroke(canvas: Canvas, a: np.ndarray, b: np.ndarray, colour: np.ndarray) -> None:
    ink = tuple(int(value) for value in colour)
    cv2.line(canvas, _fixed(a), _fixed(b), ink, 1, cv2.LINE_AA, SUBPIXEL_BITS)


def _ring(canvas: Canvas, place: np.ndarray, radius: float, colour: np.ndarray) -> None:
    ink = tuple(int(value) for value in colour)
    size = round(radius * (1 << SUBPIXEL_BITS))
    cv2.circle(canvas, _fixed(place), size, ink, 1, cv2.LINE_AA, SUBPIXEL_BITS)


def _flags(
    canvas: Canvas, place: np.ndarray, size: float, found: Observations, detection: int
) -> None:
    """A red cross over a clipped detection, a yellow square around one that touches."""
    corners = (size + 2) * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) + place
    if found.saturated[detection]:
        for a, b in ((0, 2), (1, 3)):
            _stroke(canvas, corners[a], corners[b], np.array(CLIPPED_COLOUR))
    if found.overlapping[detection]:
        for a in range(4):
            b = corners[(a + 1) % 4]
            _stroke(canvas, corners[a], b, np.array(TOUCHING_COLOUR))
