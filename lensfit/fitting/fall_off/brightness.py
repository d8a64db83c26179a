"""Relative illumination of the sensor at the detections, from their brightness.

All bright dots emit the same flux, spread over the area of their image: the flux
divided by the area magnification is proportional to the illumination. The flux of a
line per length is divided by the magnification of its width. The bright field around
dark dots is proportional to the illumination times the light that fell on the chart.

Lines are not used if there are enough dots: a line is measured up to a fixed distance,
and the blur in the corners extends beyond it.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from lensfit.detect.observations import LINE_OF_CONSTANT_I, POINT, Observations
from lensfit.fitting.adjust import Adjustment
from lensfit.fitting.chart_view import View

FEWEST_DETECTIONS = 30
_STEP = 1e-3
"""Of differences, half boards."""


def area_stretch(adjustment: Adjustment) -> Float[np.ndarray, "views detections 2 2"]:
    """d sensor mm / d board mm at every detection.

    Central differences over a thousandth of the half board, good to a millionth: the
    program that predicts detections serves here too.
    """
    half_mm = np.asarray(adjustment.stack.view.half_board_mm)[:, None]
    board = adjustment.stack.board
    columns = [
        (adjustment.predicted_mm(board + step) - adjustment.predicted_mm(board - step))
        / (2 * _STEP)
        for step in _STEP * np.eye(2)
    ]
    return np.stack(columns, -1) / half_mm[:, :, None]


class Brightness(NamedTuple):
    """Squared radius and log brightness of the detections of one view; `lines` if none
    is a dot."""

    squared_mm2: Float[np.ndarray, " detections"]
    brightness: Float[np.ndarray, "detections 3"]
    lines: bool


class JoinedBrightness(NamedTuple):
    """Of all views at one f-number, in one row."""

    squared_mm2: Float[np.ndarray, " detections"]
    brightness: Float[np.ndarray, "detections 3"]
    take: Int[np.ndarray, " detections"]


def brightness_of(
    view: View,
    stretch: Float[np.ndarray, "most 2 2"],
    radius_vector: Float[np.ndarray, "most 2"],
    used: Bool[np.ndarray, " most"],
) -> Brightness:
    """Of the detections that were used.

    Parameters
    ----------
    stretch : By `area_stretch`, of the detections and then of what fills the stack.
    radius_vector : Of the detections from the principal point, mm.
    """
    o = view.observations
    count = len(o)
    matrix, keep = stretch[:count], used[:count] & ~o.saturated & ~o.overlapping
    brightness = o.flux if o.flux.shape[1] == 3 else np.repeat(o.flux, 3, 1)
    if o.bright:
        brightness = brightness / _spread(matrix, o)[:, None]
    keep &= np.all(brightness > 0, -1)
    squared = np.sum(radius_vector[:count] ** 2, -1)
    lines = bool(np.all(o.family != POINT))
    return Brightness(squared[keep], np.log(brightness[keep]), lines)


def _spread(
    matrix: Float[np.ndarray, "detections 2 2"], o: Observations
) -> Float[np.ndarray, " detections"]:
    """Area a dot is magnified by; for a line sample, its width."""
    area = np.abs(np.linalg.det(matrix))
    across = np.where(
        (o.family == LINE_OF_CONSTANT_I)[:, None], matrix[..., 0], matrix[..., 1]
    )
    width = np.abs(np.sum(across * np.nan_to_num(o.normal), -1))
    return np.where(o.family == POINT, area, width)


def dots_if_enough(rows: list[Brightness]) -> list[Brightness]:
    """The views of dots if they have enough detections, otherwise all."""
    dots = [row for row in rows if not row.lines]
    return dots if count_of(dots) >= FEWEST_DETECTIONS else rows


def joined_brightness(rows: list[Brightness]) -> JoinedBrightness:
    """Views are counted in the order of `rows`."""
    return JoinedBrightness(
        np.concatenate([row.squared_mm2 for row in rows]),
        np.concatenate([row.brightness for row in rows]),
        np.repeat(np.arange(len(rows)), [len(row.squared_mm2) for row in rows]),
    )


def count_of(rows: list[Brightness]) -> int:
    """How many detections there are in all."""
    return sum(len(row.squared_mm2) for row in rows)
