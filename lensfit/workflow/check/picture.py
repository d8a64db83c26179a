"""The picture of a check: detected points, and the sharpness in each ninth.

It is the overlay of `lensfit calibrate` on a reduced photograph, with the level and
every problem on a strip above it, and the width of the blur written into each ninth.
"""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from lensfit.atomic import atomic_path
from lensfit.detect.observations import Observations
from lensfit.detect.overlay import overlay_picture
from lensfit.photograph import Photograph
from lensfit.workflow.check.check_records import Check


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
