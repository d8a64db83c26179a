"""How a chart says what it is: a strip of square markers that encodes its pattern.

Fourteen markers of OpenCV's dictionary DICT_5X5_1000, of which two wrong bits each are
mended. The id of a marker is ``71 * position + digit``, so every marker knows its place
in the strip: they may be read in any order, from several strips, turned or tilted.
The digits, base 71, most significant first, are one whole number: the pattern's fields
and a checksum (CRC-16/CCITT-FALSE). On a dark sheet the markers are inverted.

A marker is 7 x 7 modules with its frame, with one module between; the strip measures
113 x 9 modules with its quiet zone. On photographs a module needs about 2 pixels.
"""

from functools import cache
from typing import Any

import cv2
import numpy as np
from jaxtyping import Bool

from lensfit.chart.pattern import KINDS, POLARITIES, STEP_MM, Pattern

MARKERS = 14
BASE = 71
MARKER_MODULES = 7
STRIP_MODULES = (MARKERS * (MARKER_MODULES + 1) + 1, MARKER_MODULES + 2)
_VERSION = 1
_FIELD_BITS = (2, 2, 1, 24, 22, 8, 8, 1)
"""Version, kind, polarity, pitch and mark in steps, columns, rows, oriented."""
_CHECK_BITS = 16


def marker_ids(pattern: Pattern) -> tuple[int, ...]:
    """Ids of the markers of the strip, from left to right."""
    fields = (
        _VERSION,
        KINDS.index(pattern.kind),
        POLARITIES.index(pattern.polarity),
        round(pattern.pitch_mm / STEP_MM),
        round(pattern.mark_mm / STEP_MM),
        pattern.columns,
        pattern.rows,
        int(pattern.oriented),
    )
    number = 0
    for value, bits in zip(fields, _FIELD_BITS, strict=True):
        if not 0 <= value < 1 << bits:
            raise ValueError(f"{value} does not fit {bits} bits")
        number = number << bits | value
    number = number << _CHECK_BITS | _checksum(number)
    digits = [number // BASE ** (MARKERS - 1 - k) % BASE for k in range(MARKERS)]
    return tuple(BASE * k + digit for k, digit in enumerate(digits))


def pattern_of(ids: tuple[int, ...]) -> Pattern | None:
    """The pattern that a whole strip of ids describes; None if its checksum is wrong.

    Parameters
    ----------
    ids : One for each position, in order.
    """
    number = 0
    for k, marker in enumerate(ids):
        number = number * BASE + marker - BASE * k
    content, check = number >> _CHECK_BITS, number & (1 << _CHECK_BITS) - 1
    if content >> sum(_FIELD_BITS) or _checksum(content) != check:
        return None
    values = []
    for bits in reversed(_FIELD_BITS):
        values.append(content & (1 << bits) - 1)
        content >>= bits
    version, kind, polarity, pitch, mark, columns, rows, oriented = reversed(values)
    if version != _VERSION or kind >= len(KINDS):
        return None
    return Pattern(
        KINDS[kind],
        POLARITIES[polarity],
        round(pitch * STEP_MM, 4),
        round(mark * STEP_MM, 4),
        columns,
        rows,
        bool(oriented),
    )


def marker_cells(marker: int) -> Bool[np.ndarray, "7 7"]:
    """Which modules of a marker are black on a white sheet, row 0 on top."""
    size = MARKER_MODULES
    return cv2.aruco.generateImageMarker(dictionary(), marker, size, borderBits=1) == 0


@cache
def dictionary() -> Any:
    """OpenCV's dictionary that the strip is written in."""
    return cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_1000)


def _checksum(number: int) -> int:
    """CRC-16/CCITT-FALSE of the number's bytes."""
    crc = 0xFFFF
    for byte in number.to_bytes((sum(_FIELD_BITS) + 7) // 8, "big"):
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc
