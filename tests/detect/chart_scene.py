"""Photographs of charts by a plane's perspective, blur and noise; truth known."""

from pathlib import Path

import cv2
import numpy as np

from lensfit.chart.coverage import paint
from lensfit.chart.layout import Layout, Wanted, draw, foil_drawing, lay_out
from lensfit.chart.sheet import paper_sheet
from lensfit.photograph import Photograph

SIZE_PX = (1200, 900)
FINE_PER_MM = 8


def a4(kind: str, polarity: str | None = None) -> Layout:
    """An ordinary small chart; few marks, so that tests are quick."""
    pitch = {"dot-grid": 14.0, "line-grid": 16.0, "checkerboard": 16.0}[kind]
    return lay_out(paper_sheet("A4"), Wanted(kind, pitch, None, polarity))


def photographed(
    layout: Layout,
    *,
    turn_deg: float = 0.0,
    tilt: float = 0.0,
    fill: float = 0.95,
    blur_px: float = 0.7,
    noise: float = 0.004,
    cut: bool = False,
    size_px: tuple[int, int] = SIZE_PX,
) -> tuple[Photograph, np.ndarray]:
    """A photograph, and the homography from sheet millimetres to its pixels.

    `tilt` is how much larger one side of the sheet appears than its middle; `fill` the
    part of the frame that the turned sheet spans; `cut` shows light through foil.
    """
    drawing = foil_drawing(layout) if cut else draw(layout, "0")
    sheet = paint(drawing, 1 / FINE_PER_MM)
    size = np.array([drawing.width_mm, drawing.height_mm])
    turn = np.radians(turn_deg)
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([[c, -s], [s, c]])
    scale = fill * (np.array(size_px) / (np.abs(rotation) @ size)).min()
    to_middle, place, lens = np.eye(3), np.eye(3), np.eye(3)
    to_middle[:2, 2] = -size / 2
    place[:2, :2] = rotation * scale
    lens[2, 0] = tilt / (size.max() * scale)
    back = np.eye(3)
    back[:2, 2] = np.array(size_px) / 2
    homography = back @ lens @ place @ to_middle
    centres = np.eye(3)
    centres[:2, 2] = 0.5
    fine = np.diag([1 / FINE_PER_MM, 1 / FINE_PER_MM, 1.0])
    step = FINE_PER_MM / scale
    smooth = cv2.GaussianBlur(sheet, (0, 0), max(0.3 * step, 0.3))
    image = cv2.warpPerspective(
        smooth,
        np.linalg.inv(centres) @ homography @ fine @ centres,
        size_px,
        flags=cv2.INTER_LINEAR,
        borderValue=0.3,
    )
    image = 0.02 + 0.7 * cv2.GaussianBlur(image, (0, 0), blur_px)
    image = image + noise * np.random.default_rng(0).normal(size=image.shape)
    pixels = image.astype(np.float32)[..., None]
    return Photograph(pixels, Path("chart.exr"), ""), homography


def error_px(marks, layout: Layout, homography: np.ndarray) -> np.ndarray:
    """How far marks with the chart's own indices are from where they should be."""
    mm = marks.lattice * layout.pattern.pitch_mm + layout.origin_mm
    true = np.column_stack([mm, np.ones(len(mm))]) @ homography.T
    miss = true[:, :2] / true[:, 2:] - marks.points_px
    along_normal = np.abs((miss * marks.normal).sum(1))
    return np.where(
        np.isfinite(along_normal), along_normal, np.linalg.norm(miss, axis=1)
    )
