"""What charts are printed on or shown on: paper, or a screen of known pixels.

Paper sizes are ISO 216 and ANSI, in millimetres, portrait; millimetres may be given
instead of a name.
"""

import math
import re
from dataclasses import dataclass

from lensfit.errors import ChartError

PAPERS = {
    "A0": (841.0, 1189.0),
    "A1": (594.0, 841.0),
    "A2": (420.0, 594.0),
    "A3": (297.0, 420.0),
    "A4": (210.0, 297.0),
    "LETTER": (215.9, 279.4),
    "TABLOID": (279.4, 431.8),
}
_SMALLEST_MM, _LARGEST_MM = 40.0, 20_000.0


@dataclass(frozen=True)
class Sheet:
    """A rectangle to draw on.

    Attributes
    ----------
    margin_mm : Kept free on every side.
    pixel_mm : Pitch of a screen's pixels; None for paper.
    """

    width_mm: float
    height_mm: float
    margin_mm: float
    pixel_mm: float | None = None


def paper_sheet(
    paper: str, *, portrait: bool = False, margin_mm: float | None = None
) -> Sheet:
    """A sheet of paper, on its long side unless `portrait` is set.

    Parameters
    ----------
    paper : A name of `PAPERS` in any case, or "WIDTHxHEIGHT" in mm, taken as it is.
    margin_mm : By default 10 mm, or a twentieth of a small sheet's short side.

    Raises
    ------
    ChartError : There is no such paper, or its size or margin is out of range.
    """
    size = PAPERS.get(paper.upper())
    if size is None:
        width, height = _pair(paper, "paper", f"{', '.join(PAPERS)} or WxH in mm")
    else:
        width, height = size if portrait else size[::-1]
    return _check_sheet_size(Sheet(width, height, _margin(width, height, margin_mm)))


def screen_sheet(
    size_px: str, pixel_mm: float, *, margin_mm: float | None = None
) -> Sheet:
    """A screen.

    Parameters
    ----------
    size_px : "WIDTHxHEIGHT".
    pixel_mm : Pitch of its pixels.

    Raises
    ------
    ChartError : The size is no size, or size, pitch or margin is out of range.
    """
    width_px, height_px = _pair(size_px, "screen", "WIDTHxHEIGHT in px")
    if not (width_px.is_integer() and height_px.is_integer()):
        raise ChartError(f"a screen of {size_px} has no whole number of pixels")
    if not (math.isfinite(pixel_mm) and 0 < pixel_mm <= 50):
        raise ChartError(
            f"a pixel pitch of {pixel_mm:g} mm is out of range",
            remedy="divide the width of the lit area by the number of its pixels",
        )
    width, height = width_px * pixel_mm, height_px * pixel_mm
    return _check_sheet_size(
        Sheet(width, height, _margin(width, height, margin_mm), pixel_mm)
    )


def _pair(text: str, what: str, wanted: str) -> tuple[float, float]:
    match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*[xX×]\s*(\d+(?:\.\d+)?)(?:\s*mm)?", text)
    if not match:
        raise ChartError(f"'{text}' is no {what}", remedy=f"give {wanted}")
    return float(match[1]), float(match[2])


def _margin(width_mm: float, height_mm: float, margin_mm: float | None) -> float:
    if margin_mm is None:
        return min(10.0, 0.05 * min(width_mm, height_mm))
    return margin_mm


def _check_sheet_size(sheet: Sheet) -> Sheet:
    shorter, longer = sorted((sheet.width_mm, sheet.height_mm))
    if shorter < _SMALLEST_MM or longer > _LARGEST_MM:
        raise ChartError(
            f"a sheet of {sheet.width_mm:g} x {sheet.height_mm:g} mm is out of range",
            remedy=f"give {_SMALLEST_MM:g} to {_LARGEST_MM:g} mm a side",
        )
    if not 0 <= sheet.margin_mm <= shorter / 4:
        raise ChartError(
            f"a margin of {sheet.margin_mm:g} mm does not suit a sheet of "
            f"{sheet.width_mm:g} x {sheet.height_mm:g} mm",
            remedy=f"give 0 to {shorter / 4:g} mm",
        )
    return sheet
