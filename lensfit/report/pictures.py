"""Overlay pictures made small enough to live inside the report.

Each is read from the folder of results, shrunk with area averaging (no aliasing of a
fine dot grid) and encoded as JPEG inside a ``data:`` address. Chroma is kept at full
resolution, as the marks are thin coloured lines. (WebP is half the size and thirty
times slower: 0.6 s a picture.) All pictures together share one budget, so that a
report of many takes stays one file that opens at once.
"""

import base64
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8

from lensfit.io.library_output import silenced_libraries

_JPEG = b"\xff\xd8"
TOTAL_BYTES = 1_900_000
_LARGEST_BYTES = 400_000
_STEPS = ((1800, 78), (1800, 66), (1400, 70), (1100, 68), (860, 66), (620, 62))
_FULL_CHROMA = (
    cv2.IMWRITE_JPEG_SAMPLING_FACTOR,
    cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
)


def data_addresses(paths: Sequence[Path]) -> list[str | None]:
    """A ``data:`` address for each picture; None for one that cannot be read."""
    budget = min(_LARGEST_BYTES, TOTAL_BYTES // max(len(paths), 1))
    with ThreadPoolExecutor(max_workers=2) as workers:
        return list(workers.map(lambda path: _data_address(path, budget), paths))


def jpeg_address(path: Path) -> str | None:
    """A ``data:`` address of a JPEG file as it is; None if it cannot be read."""
    try:
        encoded = path.read_bytes()
    except OSError:
        return None
    return _of_jpeg(encoded) if encoded.startswith(_JPEG) else None


def png_address(encoded: bytes) -> str:
    """A ``data:`` address of a PNG."""
    return f"data:image/png;base64,{base64.b64encode(encoded).decode('ascii')}"


def _of_jpeg(encoded: bytes) -> str:
    return f"data:image/jpeg;base64,{base64.b64encode(encoded).decode('ascii')}"


def _data_address(path: Path, budget_bytes: int) -> str | None:
    picture = _read(path)
    if picture is None:
        return None
    encoded = b""
    for width_px, quality in _STEPS:
        picture = _shrink(picture, width_px)
        settings = [cv2.IMWRITE_JPEG_QUALITY, quality, *_FULL_CHROMA]
        _, buffer = cv2.imencode(".jpg", picture, settings)
        encoded = buffer.tobytes()
        if len(encoded) <= budget_bytes:
            break
    return _of_jpeg(encoded)


def _read(path: Path) -> UInt8[np.ndarray, "height width 3"] | None:
    try:
        data = np.frombuffer(path.read_bytes(), dtype=np.uint8)
        with silenced_libraries():
            return cv2.imdecode(data, cv2.IMREAD_COLOR) if data.size else None
    except (OSError, ValueError, cv2.error):
        return None


def _shrink(
    picture: UInt8[np.ndarray, "height width 3"], width_px: int
) -> UInt8[np.ndarray, "height width 3"]:
    height, width = picture.shape[:2]
    if width <= width_px:
        return picture
    size = (width_px, max(1, round(height * width_px / width)))
    return cv2.resize(picture, size, interpolation=cv2.INTER_AREA).astype(np.uint8)
