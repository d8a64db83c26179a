"""Takes of a standing chart by which blur is measured: focus ring and iris.

In focus, nearer and farther, at the f-number and two stops down; out of focus as far as
shows the pupil without letting dots run into each other.
"""

from dataclasses import dataclass

from lensfit.chart.camera import Camera, blur_mm

_BLUR_PITCHES = 0.4
"""Blur of the out-of-focus takes, wide open: enough to show the pupil, and apart."""
_NEAREST_PART, _FARTHEST_PART = 0.715, 1.65
"""How far the focus ring is turned at most, in distances of the chart."""
_NEAREST_FOCAL_LENGTHS = 4.0001
"""At four a lens images at life size; nearer, nothing is in focus."""


@dataclass(frozen=True)
class FocusTake:
    """One setting of focus ring and iris on the standing chart.

    Attributes
    ----------
    blur_px : Diameter of a point's disc.
    overlapping : Dots run into each other.
    """

    name: str
    f_number: float
    focus_distance_mm: float
    blur_px: float
    overlapping: bool


def focus_takes(
    camera: Camera, chart_mm: float, mark_px: float, pitch_px: float
) -> tuple[FocusTake, ...]:
    """Takes in focus, nearer and farther; at the f-number and two stops down.

    Parameters
    ----------
    chart_mm : Distance of the chart from the sensor.
    mark_px, pitch_px : Width of a mark, and how far apart they are, in focus.
    """
    wished = _BLUR_PITCHES * pitch_px
    nearest = max(
        _NEAREST_PART * chart_mm, _NEAREST_FOCAL_LENGTHS * camera.focal_length_mm
    )
    focus = {
        "in focus": chart_mm,
        "nearer": _focus_mm(camera, chart_mm, nearest, wished),
        "farther": _focus_mm(camera, chart_mm, _FARTHEST_PART * chart_mm, wished),
    }
    takes = []
    for f_number in (camera.f_number, 2 * camera.f_number):
        for name, focus_mm in focus.items():
            blur = blur_mm(camera.focal_length_mm, f_number, focus_mm, chart_mm)
            blur /= camera.pixel_mm
            together = mark_px + blur > pitch_px
            takes.append(FocusTake(name, f_number, focus_mm, blur, together))
    return tuple(takes)


def _focus_mm(
    camera: Camera, chart_mm: float, furthest_mm: float, wished_px: float
) -> float:
    """Focus distance, between the chart's and the furthest, of the wished blur."""

    def blur_px(focus_mm: float) -> float:
        blur = blur_mm(camera.focal_length_mm, camera.f_number, focus_mm, chart_mm)
        return blur / camera.pixel_mm

    if blur_px(furthest_mm) <= wished_px:
        return furthest_mm
    low, high = chart_mm, furthest_mm
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if blur_px(middle) < wished_px else (low, middle)
    return low
