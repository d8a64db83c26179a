"""Figures of `through`: distances across, f-numbers down, one place each."""

from lensfit.report.kernels import GAMMA
from lensfit.report.markup import Markup, number, tag
from lensfit.report.pictures import png_address
from lensfit.report.report_sections import distance_text, figure_html, stop_text
from lensfit.report.svg import WIDTH, Figure, drawing, words
from lensfit.report.through import HEIGHTS, ThroughSheet

_LEFT, _BOTTOM = 66.0, 30.0


def through_figures(sheet: ThroughSheet) -> list[Markup]:
    """Title, what it means, and a figure for each place of the frame."""
    figures = [
        figure_html(_figure(sheet, place, picture))
        for place, picture in zip(HEIGHTS, sheet.pictures, strict=True)
    ]
    return [
        tag("h4", "Through focus and through the aperture"),
        tag("p", _about(sheet), class_="facts"),
        tag("div", *figures, class_="figures thirds"),
    ]


def _about(sheet: ThroughSheet) -> str:
    text = "Predicted: a point of green light at distances from the sensor (across, "
    text += "in metres) and at f-numbers (down)"
    if sheet.focus_distance_mm is not None:
        text += f", the lens focused at {distance_text(sheet.focus_distance_mm)}"
    text += f". All tiles are {number(sheet.width_px, 'px')} wide, light to the power "
    text += f"{GAMMA:g}, each tile against its own peak. Framed: as much out of focus "
    return (
        text + "as one of the photographs of that f-number; the others rest on these."
    )


def _figure(sheet: ThroughSheet, place: str, picture: bytes) -> Figure:
    stops, columns = sheet.photographed.shape
    step = (WIDTH - _LEFT) / columns
    height = stops * step
    shapes = [
        tag(
            "image", href=png_address(picture), x=f"{_LEFT:g}", y="0",
            width=f"{WIDTH - _LEFT:g}", height=f"{height:.1f}",
            preserveAspectRatio="none",
        )
    ]  # fmt: skip
    for row, stop in enumerate(sheet.f_numbers):
        name = stop_text({"f_number": stop})
        middle = (row + 0.5) * step + 7
        shapes.append(words(_LEFT - 8, middle, name, "tick", "end"))
    shapes.append(words(_LEFT - 8, height + 21, "m", "tick", "end"))
    for column, distance in enumerate(sheet.distances_mm):
        middle = _LEFT + (column + 0.5) * step
        name = number(float(f"{distance / 1000:.3g}"))
        shapes.append(words(middle, height + 21, name, "tick", "middle"))
    shapes += [
        _frame(_LEFT + column * step, row * step, step)
        for row in range(stops)
        for column in range(columns)
        if sheet.photographed[row, column]
    ]
    label = f"Point-spread functions through focus and aperture, {place}"
    drawn = drawing(label, *shapes, height=height + _BOTTOM)
    return Figure("through", place, drawn, "")


def _frame(x: float, y: float, step: float) -> Markup:
    at = {"x": f"{x + 1.5:.1f}", "y": f"{y + 1.5:.1f}"}
    side = f"{step - 3:.1f}"
    return tag("rect", **at, width=side, height=side, class_="shown")
