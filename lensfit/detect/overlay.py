"""A picture of what was found, for a person to check by eye.

The photograph is exposed for display and greyed a little; every detection sits on it at
its sub-pixel position. Colour tells the row j and lightness the parity of the column i
(or the number of the line), so that a detection that was numbered wrongly breaks a
stripe. Clipped detections are crossed out, detections that touch a neighbour are
squared, and a strip at the bottom says how many there are of each.
"""

from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8
from PIL import Image, ImageDraw, ImageFont

from lensfit.atomic import atomic_path
from lensfit.detect.observations import LINE_OF_CONSTANT_I, POINT, Observations
from lensfit.photograph import Photograph

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


def _fixed_point(place: np.ndarray) -> tuple[int, int]:
    """OpenCV's fixed-point coordinates of a position with pixel centres at 0.5."""
    x, y = np.round((place - 0.5) * (1 << SUBPIXEL_BITS)).astype(int)
    return int(x), int(y)


def _stroke(canvas: Canvas, a: np.ndarray, b: np.ndarray, colour: np.ndarray) -> None:
    ink = tuple(int(value) for value in colour)
    cv2.line(
        canvas, _fixed_point(a), _fixed_point(b), ink, 1, cv2.LINE_AA, SUBPIXEL_BITS
    )


def _ring(canvas: Canvas, place: np.ndarray, radius: float, colour: np.ndarray) -> None:
    ink = tuple(int(value) for value in colour)
    size = round(radius * (1 << SUBPIXEL_BITS))
    cv2.circle(canvas, _fixed_point(place), size, ink, 1, cv2.LINE_AA, SUBPIXEL_BITS)


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


WIDEST_PX, NARROWEST_PX = 3000, 1000
"""Pictures wider than the first are reduced, narrower than the second enlarged."""
HUES = 7
"""Rows until the colours repeat."""
LIGHTNESS = (0.85, 0.7)
"""OKLab lightness of even and odd columns."""
CHROMA = 0.16
GREYED, DIMMED = 0.6, 0.5
LEAST_OF_MARKS = 0.2
"""Of the usual peak of bright detections: white is no darker, or their veil glares."""


def draw_overlay(
    photograph: Photograph, observations: Observations, path: str | Path
) -> None:
    """Write the overlay of one photograph as a PNG.

    Parameters
    ----------
    photograph : The picture the observations were made on.
    observations : What was found on it.
    path : Where to write; an existing file is replaced as a whole.

    Raises
    ------
    OutputError : the file cannot be written.
    """
    picture = overlay_picture(photograph, observations)
    with atomic_path(path) as temporary:
        picture.save(temporary, format="PNG", compress_level=4)


def overlay_picture(photograph: Photograph, observations: Observations) -> Image.Image:
    """The overlay of one photograph, at most `WIDEST_PX` wide."""
    scale = _scale(photograph.size_px[0])
    canvas = _dimmed_photograph(photograph, observations, scale)
    lines = observations.family != POINT
    if lines.any():
        number = observations.lattice[
            np.arange(len(lines)), np.maximum(observations.family, 0)
        ]
        colours = stripe_colours(number, observations.family.astype(float))
        draw_samples(canvas, observations, colours, scale)
    if not lines.all():
        colours = stripe_colours(observations.lattice[:, 1], observations.lattice[:, 0])
        draw_points(canvas, observations, colours, scale)
    picture = Image.fromarray(canvas)
    draw_labels(picture, observations, scale)
    swatches = stripe_colours(np.arange(HUES, dtype=float), np.zeros(HUES))
    return with_legend(picture, observations, photograph.path.name, swatches)


def stripe_colours(
    row: Float[np.ndarray, " detections"], column: Float[np.ndarray, " detections"]
) -> UInt8[np.ndarray, "detections 3"]:
    """sRGB colour of each detection: hue by row, lightness by parity of the column.

    Equal steps of hue in OKLab (B. Ottosson, "A perceptual color space for image
    processing", 2020), so that no two neighbouring rows look alike.
    """
    hue = 2 * np.pi * (np.mod(row, HUES) * 3 % HUES) / HUES + 0.5
    lightness = np.where(np.mod(column, 2) == 0, *LIGHTNESS)
    lab = np.stack([lightness, CHROMA * np.cos(hue), CHROMA * np.sin(hue)], -1)
    to_lms = np.array(
        [
            [1.0, 0.3963377774, 0.2158037573],
            [1.0, -0.1055613458, -0.0638541728],
            [1.0, -0.0894841775, -1.2914855480],
        ]
    )
    to_rgb = np.array(
        [
            [4.0767416621, -3.3077115913, 0.2309699292],
            [-1.2684380046, 2.6097574011, -0.3413193965],
            [-0.0041960863, -0.7034186147, 1.7076147010],
        ]
    )
    return _srgb_codes((lab @ to_lms.T) ** 3 @ to_rgb.T)


def _srgb_codes(linear: np.ndarray) -> UInt8[np.ndarray, "..."]:
    """sRGB code values of linear light, clipped to 0..1."""
    linear = np.clip(linear, 0, 1)
    curved = 1.055 * np.maximum(linear, 1e-6) ** (1 / 2.4) - 0.055
    return np.round(255 * np.where(linear <= 0.0031308, 12.92 * linear, curved)).astype(
        np.uint8
    )


_CODES = _srgb_codes(np.linspace(0.0, 1.0, 1 << 16))
"""Of all levels of 16 bits: a picture has millions of samples, a power is slow."""


def _scale(width: int) -> float:
    if width > WIDEST_PX:
        return WIDEST_PX / width
    return float(np.ceil(NARROWEST_PX / width)) if width < NARROWEST_PX else 1.0


def _dimmed_photograph(
    photograph: Photograph, observations: Observations, scale: float
) -> UInt8[np.ndarray, "height width 3"]:
    """The photograph exposed so that its highlights just fit, greyed and dimmed.

    Small bright dots are too few to count as highlights, and are looked at as well.
    """
    width, height = (round(side * scale) for side in photograph.size_px)
    way = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    pixels = cv2.resize(photograph.pixels, (width, height), interpolation=way)
    pixels = np.nan_to_num(pixels.reshape(height, width, -1))
    white = max(float(np.percentile(pixels[::2, ::2], 99.7)), 1e-12)
    if observations.bright:
        column, row = np.floor(observations.points_px).astype(int).T
        peak = float(np.median(photograph.pixels[row, column].max(-1)))
        white = max(white, LEAST_OF_MARKS * peak)
    if pixels.shape[2] == 1:
        pixels = cv2.cvtColor(pixels, cv2.COLOR_GRAY2RGB)
    mixed = DIMMED * ((1 - GREYED) * np.eye(3) + GREYED / 3) * (len(_CODES) - 1) / white
    levels = np.clip(cv2.transform(pixels, mixed), 0, len(_CODES) - 1)
    return _CODES[np.rint(levels).astype(np.uint16)]
