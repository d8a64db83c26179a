"""A photograph and its detections at a smaller size, to be looked at."""

from dataclasses import replace

import cv2

from lensfit.detect.observations import Observations
from lensfit.photograph import Photograph


def reduced(
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
