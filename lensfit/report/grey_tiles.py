"""Small grey pictures side by side on one sheet, as PNG bytes.

A tile holds brightness in [0, 1], row 0 on top; tiles lie as rows and columns of one
array. Frames between tiles are mid-grey, so that dark and bright tiles both end there.
"""

import cv2
import numpy as np
from jaxtyping import Float, UInt8

_FRAME = 96
_FRAME_PX = 2


def sheet_of(
    tiles: Float[np.ndarray, "rows columns height width"], enlarged: int = 1
) -> UInt8[np.ndarray, "sheet_height sheet_width"]:
    """One picture of all tiles, each pixel drawn `enlarged` times as large."""
    rows, columns, height, width = tiles.shape
    step = (height * enlarged + _FRAME_PX, width * enlarged + _FRAME_PX)
    shape = (rows * step[0] + _FRAME_PX, columns * step[1] + _FRAME_PX)
    sheet = np.full(shape, _FRAME, np.uint8)
    shown = np.round(np.clip(np.nan_to_num(tiles), 0, 1) * 255).astype(np.uint8)
    for row, column in np.ndindex(rows, columns):
        tile = np.kron(shown[row, column], np.ones((enlarged, enlarged), np.uint8))
        top, left = (row * step[0] + _FRAME_PX, column * step[1] + _FRAME_PX)
        sheet[top : top + tile.shape[0], left : left + tile.shape[1]] = tile
    return sheet


def with_bar(
    sheet: UInt8[np.ndarray, "height width"], length: float
) -> UInt8[np.ndarray, "taller width"]:
    """The sheet with a white bar, `length` sheet pixels long, on a strip below it."""
    strip = np.full((12, sheet.shape[1]), _FRAME, np.uint8)
    end = min(_FRAME_PX + max(round(length), 1), sheet.shape[1])
    strip[4:8, _FRAME_PX:end] = 255
    return np.concatenate([sheet, strip])


def png(sheet: UInt8[np.ndarray, "height width"]) -> bytes:
    """Encoded as 8-bit grey PNG."""
    _, buffer = cv2.imencode(".png", sheet, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    return buffer.tobytes()
