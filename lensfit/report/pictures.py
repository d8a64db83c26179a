"""The pictures of the report: overlays made small, sheets of grey tiles, fitted dots.

An overlay is read from the folder of results, shrunk with area averaging (no aliasing
of a fine dot grid) and encoded as JPEG inside a ``data:`` address. Chroma is kept at
full resolution, as detected points are thin coloured lines. (WebP is half the size and
thirty times slower: 0.6 s a picture.) All pictures together share one budget, so that a
report of many takes stays one file that opens at once.

Small grey pictures lie side by side on one sheet, as PNG bytes. A tile holds brightness
in [0, 1], row 0 on top; tiles lie as rows and columns of one array. Frames between
tiles are mid-grey, so that dark and bright tiles both end there.

Of fitted dots photograph, model and residual are shown for every take, green channel.
Every dot is shown against its own brightness, from the middle of the field (left)
outward; the residual is drawn `ENLARGED` times stronger about mid-grey. Cells that the
fit does not use, such as a neighbour's, are mid-grey too.
"""

import base64
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from lensfit.atomic import write_bytes_atomic
from lensfit.fitting.wavefront.fit import WavefrontFit
from lensfit.io.decoding import silenced_libraries

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


ENLARGED = 4
_MOST_DOTS = 8
_GREEN = 1


def write_dot_pictures(
    wavefront: WavefrontFit, stems: dict[str, str], folder: Path
) -> dict[str, str]:
    """Write one PNG per take into ``folder/blur``.

    Parameters
    ----------
    stems : How the picture of each take is called, by the take's name.
    folder : The folder of results.

    Returns
    -------
    The paths, relative to `folder`, by the take's name.
    """
    stage = wavefront.stage
    dot_data, residual = stage.dot_data, stage.residual[:, _GREEN]
    background = stage.nuisance[:, _GREEN, 1]
    names = {}
    for k, photograph in enumerate(dot_data.photographs):
        mine = _from_the_middle(dot_data.dots.field_mm, dot_data.take == k)
        tiles = dot_tiles(
            dot_data.light[mine, _GREEN],
            residual[mine],
            background[mine],
            dark=photograph.take.observations.are_dark_dots,
        )
        tiles = np.where(dot_data.valid[mine, _GREEN], tiles, 0.5)
        name = f"blur/{stems[photograph.take.name]}.png"
        write_bytes_atomic(folder / name, png(sheet_of(tiles, enlarged=2)))
        names[photograph.take.name] = name
    return names


def dot_tiles(
    light: Float[np.ndarray, "dots rows columns"],
    residual: Float[np.ndarray, "dots rows columns"],
    background: Float[np.ndarray, " dots"],
    *,
    dark: bool,
) -> Float[np.ndarray, "3 dots rows columns"]:
    """Photograph, model, and half plus `ENLARGED` / 2 of their difference.

    Parameters
    ----------
    light : The photograph's; of dark dots what they take of it.
    residual : Photograph minus model.
    background : Light beside the dot.
    dark : Whether dots are dark ones.
    """
    signal = light - background[:, None, None]
    model = signal - residual
    peak = np.abs(signal).max((1, 2), keepdims=True)
    peak = np.where(peak > 0, peak, 1.0)
    sign = -1 if dark else 1
    photograph, modelled = (dark + sign * part / peak for part in (signal, model))
    left = 0.5 + sign * ENLARGED / 2 * residual / peak
    return np.stack([photograph, modelled, left])


def _from_the_middle(field_mm: np.ndarray, mine: np.ndarray) -> np.ndarray:
    """Rows of a take's dots, by distance from the axis, thinned out evenly."""
    rows = np.flatnonzero(mine)
    rows = rows[np.argsort(np.hypot(*field_mm[rows].T), kind="stable")]
    spread = np.linspace(0, len(rows) - 1, min(len(rows), _MOST_DOTS))
    return rows[np.round(spread).astype(int)]


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
    return _jpeg_address(encoded) if encoded.startswith(_JPEG) else None


def png_address(encoded: bytes) -> str:
    """A ``data:`` address of a PNG."""
    return f"data:image/png;base64,{base64.b64encode(encoded).decode('ascii')}"


def _jpeg_address(encoded: bytes) -> str:
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
    return _jpeg_address(encoded)


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
