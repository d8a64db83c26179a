"""Figure of breathing: the image magnification as a function of the focus distance."""

import numpy as np

from lensfit.report.axes import Axes
from lensfit.report.frame_coverage import numbers
from lensfit.report.markup import Markup, number
from lensfit.report.plots import span
from lensfit.report.svg import Figure, drawing


def breathing(curve: dict) -> Figure | None:
    """The curve with its band, and the focus distances that were photographed.

    Parameters
    ----------
    curve : "focus_dioptres" (1/m from the sensor), "larger_percent" against the
        farthest of them, "sd_percent" where it is known; "photographed_dioptres".
    """
    focus, larger = numbers(curve["focus_dioptres"]), numbers(curve["larger_percent"])
    if focus.size < 2:
        return None
    sd = numbers(curve["sd_percent"])
    known = np.nan_to_num(sd)
    axes = Axes(span(focus), span(larger, known, zero=True))
    shapes: list[Markup] = [axes.furniture("focus (1/m)", "image larger by (%)")]
    shapes += [axes.mark(at, "") for at in curve["photographed_dioptres"]]
    shapes.append(axes.band(focus, larger - sd, larger + sd, "s1"))
    shapes.append(axes.line(focus, larger, "s1"))
    caption = f"{number(larger[-1], '%', 2)} larger focused nearest than farthest. "
    caption += (
        "Dashed: focus distances that were photographed. The band is one standard "
    )
    caption += "deviation there, nearest and farthest counted as independent."
    return Figure("breathing", "Breathing", drawing("Breathing", *shapes), caption)
