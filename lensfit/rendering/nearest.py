"""Read planes through a map without overshoot: depth, ids and coverage by the nearest
sample, lights on black by linear weights.
"""

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Int

from lensfit.coords import Window
from lensfit.rendering.uv import SourceMap


def nearest(
    plane: Float32[np.ndarray, "height width"],
    source_window: Window,
    source_map: SourceMap,
) -> Float32[np.ndarray, "out_height out_width"]:
    """The sample nearest to each position of the map; the border goes on beyond it.

    Parameters
    ----------
    source_window : Where `plane` lies, in the pixel space of the map.
    """
    method = cv2.INTER_NEAREST
    return _read(plane, source_window, source_map, method, cv2.BORDER_REPLICATE)


def linear(
    plane: Float32[np.ndarray, "height width"],
    source_window: Window,
    source_map: SourceMap,
) -> Float32[np.ndarray, "out_height out_width"]:
    """The mean of the four samples around each position of the map, to 1/64 px; black
    beyond the border."""
    method = cv2.INTER_LINEAR
    return _read(plane, source_window, source_map, method, cv2.BORDER_CONSTANT)


def _read(
    plane: Float32[np.ndarray, "height width"],
    source_window: Window,
    source_map: SourceMap,
    method: int,
    border: int,
) -> Float32[np.ndarray, "out_height out_width"]:
    """The same plane where the map moves nothing."""
    if source_map.window == source_window and not source_map.displacement_px.any():
        return plane
    x, y = _read_at(source_window, source_map)
    return cv2.remap(plane, x, y, method, borderMode=border)


def _read_at(
    source_window: Window, source_map: SourceMap
) -> tuple[
    Float32[np.ndarray, "out_height out_width"],
    Float32[np.ndarray, "out_height out_width"],
]:
    """Columns and rows of the source, pixel centres whole."""
    window = source_map.window
    x, y = np.nan_to_num(source_map.displacement_px)
    x = x + np.arange(window.x_min, window.x_max + 1, dtype=np.float32)
    y = y + np.arange(window.y_min, window.y_max + 1, dtype=np.float32)[:, None]
    return x - np.float32(source_window.x_min), y - np.float32(source_window.y_min)


def nearest_pixels(
    free: Bool[np.ndarray, "height width"], wanted: Bool[np.ndarray, "height width"]
) -> tuple[Int[np.ndarray, " n"], Float32[np.ndarray, " n"]]:
    """Flat index of the free pixel nearest to each wanted one, and its distance."""
    distance, labels = cv2.distanceTransformWithLabels(
        (~free).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    label = np.asarray(labels, np.int32)
    at = np.flatnonzero(free)
    of_label = np.zeros(len(at) + 1, np.int64)
    of_label[label[free]] = at
    return of_label[label[wanted]], distance[wanted]
