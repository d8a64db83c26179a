"""The figures of one photograph, coverage, exposure and sharpness, and their picture.

The picture shows detected points and the sharpness in each ninth. It is the overlay of
`lensfit calibrate` on a reduced photograph, with the level and every problem on a strip
above it, and the width of the blur written into each ninth.
"""

import math
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from lensfit.atomic import atomic_path
from lensfit.detect.blobs import noise_of
from lensfit.detect.directional_blur import DirectionalBlur
from lensfit.detect.observations import Observations
from lensfit.detect.overlay import overlay_picture
from lensfit.photograph import Photograph
from lensfit.report.evidence import cell_counts, empty_places
from lensfit.workflow.check.check_records import Check, Coverage, Exposure, Sharpness

CORNERS = ("top left", "top right", "bottom left", "bottom right")
_ZONES = (0.0, 0.4, 0.75, 1.01)
"""Radii that part centre, middle and edge, in half diagonals."""
_FEWEST = 6


def coverage_of(found: Observations) -> Coverage:
    """Where on the frame detected points are."""
    width, height = found.image_size_px
    counts = cell_counts(found.points_px, (float(width), float(height)))
    ends = [counts[row, column] for row in (0, -1) for column in (0, -1)]
    reached = tuple(n for n, c in zip(CORNERS, ends, strict=True) if c)
    return Coverage(float(np.mean(counts > 0)), tuple(empty_places(counts)), reached)


def exposure_of(photograph: Photograph, found: Observations) -> Exposure:
    """How far the target's own light is from clipping and from the noise.

    That of bright dots and lines is their brightest sample; of dark ones and of
    squares, the white around them.
    """
    pixels = photograph.pixels
    if found.bright:
        light = _brightest_samples(pixels, found.points_px)
    else:
        light = np.nanmax(found.flux, axis=1)
    light = light[np.isfinite(light) & (light > 0)]
    below = above = None
    if len(light) and math.isfinite(photograph.saturation):
        below = math.log2(photograph.saturation / float(np.quantile(light, 0.98)))
    noise = noise_of(photograph.luminance_channel)
    if len(light) and noise > 0:
        above = math.log2(float(np.median(light)) / noise)
    every = np.ascontiguousarray(pixels[::4, ::4])
    clipped = (every >= photograph.saturation).any(-1)
    return Exposure(
        below_clipping_stops=below,
        above_noise_stops=above,
        clipped_points=int(found.saturated.sum()),
        points=len(found),
        clipped_share=float(clipped.mean()),
    )


def _brightest_samples(pixels: np.ndarray, points_px: np.ndarray) -> np.ndarray:
    """Largest sample of any channel in the 3 x 3 pixels about each point."""
    height, width = pixels.shape[:2]
    column, row = np.floor(points_px).astype(int).T
    offset = np.arange(-1, 2)
    columns = np.clip(column[:, None] + offset, 0, width - 1)
    rows = np.clip(row[:, None] + offset, 0, height - 1)
    return pixels[rows[:, :, None], columns[:, None, :]].max((1, 2, 3))


def sharpness_of(
    blur: DirectionalBlur, image_size_px: tuple[int, int], holds_feature: bool
) -> Sharpness:
    """Medians of the blur's diameter over zones of the frame."""
    size = np.asarray(image_size_px, float)
    diameter = 4 * np.sqrt(np.maximum(blur.variance_px2, 0.0))
    place = blur.points_px / size
    radius = np.linalg.norm(blur.points_px - size / 2, axis=1)
    radius /= np.linalg.norm(size) / 2
    zone = np.digitize(radius, _ZONES) - 1
    centre, middle, edge = (_median(diameter[zone == k]) for k in range(3))
    ninth = np.clip((3 * place).astype(int), 0, 2)
    zones = tuple(
        tuple(_median(diameter[(ninth == [column, row]).all(1)]) for column in range(3))
        for row in range(3)
    )
    return Sharpness(centre, middle, edge, zones, holds_feature)


def _median(values: np.ndarray) -> float | None:
    return float(np.median(values)) if len(values) >= _FEWEST else None


def reduced_picture(
    photograph: Photograph, found: Observations, widest_px: int
) -> tuple[Photograph, Observations]:
    """Both, no wider than `widest_px`; as they are if they are no wider."""
    width, height = photograph.size_px
    if width <= widest_px:
        return photograph, found
    size = widest_px, max(1, round(height * widest_px / width))
    pixels = cv2.resize(photograph.pixels, size, interpolation=cv2.INTER_AREA)
    scale = widest_px / width
    small = replace(
        photograph, pixels=pixels.reshape(size[1], size[0], -1), mosaic=None
    )
    detections = replace(
        found,
        points_px=found.points_px * scale,
        diameter_px=found.diameter_px * scale,
        image_size_px=size,
    )
    return small, detections


_WIDEST_PX = 1600
_TONES = {"good": (96, 190, 120), "caution": (232, 178, 60), "bad": (235, 92, 80)}
_PAPER, _INK = (22, 22, 24), (236, 236, 236)
_ARROW = (255, 64, 200)


def write_check_picture(
    photograph: Photograph, found: Observations, judged: Check, path: Path
) -> None:
    """Write the picture as a PNG.

    Raises
    ------
    OutputError : It cannot be written.
    """
    small, detections = reduced_picture(photograph, found, _WIDEST_PX)
    overlay = overlay_picture(small, detections)
    scale = overlay.width / small.size_px[0]
    frame = small.size_px[0] * scale, small.size_px[1] * scale
    unit = max(1.0, overlay.width / 1500)
    font = ImageFont.load_default(round(18 * unit))
    _write_zones(overlay, judged, frame, font)
    if judged.motion is not None and judged.motion.moved:
        _draw_motion(overlay, judged.motion.direction_deg, frame, unit)
    lines = [(judged.level.upper(), _TONES[judged.level])]
    lines += [(f"{p.text}; {p.remedy}", _TONES[p.level]) for p in judged.problems]
    lines = lines if len(lines) > 1 else [("GOOD: nothing to mend", _TONES["good"])]
    picture = _with_strip(overlay, lines, font, round(28 * unit))
    with atomic_path(path) as temporary:
        picture.save(temporary, format="PNG", compress_level=1)


def _write_zones(
    picture: Image.Image, judged: Check, frame: tuple[float, float], font
) -> None:
    """Lines of the ninths, and the blur in each."""
    if judged.sharpness is None:
        return
    pen = ImageDraw.Draw(picture)
    width, height = frame
    for k in (1, 2):
        pen.line([k * width / 3, 0, k * width / 3, height], (110, 110, 116), 1)
        pen.line([0, k * height / 3, width, k * height / 3], (110, 110, 116), 1)
    for row, zones in enumerate(judged.sharpness.zones_px):
        for column, blur_px in enumerate(zones):
            text = "-" if blur_px is None else f"{blur_px:.1f} px"
            at = ((column + 0.5) * width / 3, (row + 0.5) * height / 3)
            pen.text(
                at, text, _INK, font, anchor="mm", stroke_width=4, stroke_fill=_PAPER
            )


def _draw_motion(
    picture: Image.Image, direction_deg: float, frame: tuple[float, float], unit: float
) -> None:
    """A double arrow along the motion, through the middle of the frame."""
    pen = ImageDraw.Draw(picture)
    angle = np.radians(direction_deg)
    way = np.array([np.cos(angle), np.sin(angle)])
    middle, half = np.array(frame) / 2 + [0, 40 * unit], 90 * unit
    pen.line([*(middle - half * way), *(middle + half * way)], _ARROW, round(3 * unit))
    across = np.array([-way[1], way[0]])
    for sign in (-1, 1):
        tip = middle + sign * half * way
        for side in (-1, 1):
            barb = tip - sign * 16 * unit * way + side * 9 * unit * across
            pen.line([*tip, *barb], _ARROW, round(3 * unit))


def _with_strip(
    picture: Image.Image,
    lines: list[tuple[str, tuple[int, int, int]]],
    font,
    line_px: int,
) -> Image.Image:
    whole = Image.new(
        "RGB", (picture.width, picture.height + line_px * len(lines) + 12), _PAPER
    )
    whole.paste(picture, (0, line_px * len(lines) + 12))
    pen = ImageDraw.Draw(whole)
    for k, (text, ink) in enumerate(lines):
        pen.text((14, 6 + (k + 0.5) * line_px), text, ink, font, anchor="lm")
    return whole
