"""Reading of a chart's code strip, which identifies the chart.

Markers are found by OpenCV, in linear light, in which blur leaves edges where they are.
They are looked for on smaller pictures too, in which the bars that hold modules of cut
foil disappear, and if some are missing, on one enlarged twice. Each knows its place in
the strip, so that any copies of it that are in the frame fill in for each other; a
checksum decides. A strip needs about two pixels for each of its modules and a
blur of less than one and a half of them; no take but the sharpest has to show it.
"""

import math
from itertools import islice, product

import cv2
import numpy as np

from lensfit.chart.pattern import BASE, MARKERS, Pattern, dictionary, pattern_of
from lensfit.photograph import Photograph

_LEAST_PERIMETER_PX = 40.0
"""Of a marker: ten pixels a side."""
_MOST_TO_ENLARGE_PX = 16_000_000
_LARGER, _SMALLER, _SHORTEST_SIDE_PX = 2.0, (0.5, 0.25), 600
"""Scales of further tries, and the least side of a smaller picture."""
_FEWEST_TO_ENLARGE = 3
"""Places of the strip that have to be seen before: one alone may be a dot or a screw,
and an enlarged picture takes longer than all others together."""
_MOST_READINGS = 64
"""Strips that are tried where markers of one place disagree."""


def read_chart_code(photograph: Photograph) -> Pattern | None:
    """The pattern that the code strip of a chart describes.

    Parameters
    ----------
    photograph : The picture, scene-linear.

    Returns
    -------
    None where no whole strip can be read.
    """
    image = photograph.luminance_channel
    if not np.isfinite(image).all() or min(image.shape) < 32:
        return None
    white = max(float(np.percentile(image[::4, ::4], 99.5)), 1e-12)
    picture = np.clip(255 / white * image, 0, 255).astype(np.uint8)
    scales = [1.0, *(s for s in _SMALLER if s * min(image.shape) >= _SHORTEST_SIDE_PX)]
    scales += [_LARGER] if picture.size <= _MOST_TO_ENLARGE_PX else []
    seen: list[set[int]] = [set() for _ in range(MARKERS)]
    for scale in scales:
        if scale > 1 and sum(map(bool, seen)) < _FEWEST_TO_ENLARGE:
            return None
        _look(picture, scale, seen)
        if (pattern := _first_sound(seen)) is not None:
            return pattern
    return None


def _first_sound(seen: list[set[int]]) -> Pattern | None:
    """The first pattern of a right checksum that the markers make."""
    ways = product(*(sorted(ids) for ids in seen))
    for ids in islice(ways, min(_MOST_READINGS, math.prod(map(len, seen)))):
        pattern = pattern_of(ids)
        if pattern is not None:
            return pattern
    return None


def _look(picture: np.ndarray, scale: float, seen: list[set[int]]) -> None:
    """Add the markers of both tones to those seen for each place of the strip."""
    if scale != 1:
        how = cv2.INTER_CUBIC if scale > 1 else cv2.INTER_AREA
        picture = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=how)
    enlarged = max(scale, 1.0)
    options = cv2.aruco.DetectorParameters()
    options.minMarkerPerimeterRate = enlarged * _LEAST_PERIMETER_PX / max(picture.shape)
    options.adaptiveThreshWinSizeMax *= round(enlarged)
    options.detectInvertedMarker = True
    detector = cv2.aruco.ArucoDetector(dictionary(), options)
    _, ids, _ = detector.detectMarkers(picture)
    for marker in () if ids is None else np.ravel(ids):
        if marker < BASE * MARKERS:
            seen[int(marker) // BASE].add(int(marker))
