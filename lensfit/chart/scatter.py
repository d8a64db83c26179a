"""How far the noise of its pixels throws the measured place of a dot.

With n the noise of a pixel as part of white, the position of a dot of radius r pixels
scatters by ``n R^2 / (2 sqrt(pi) r^2)`` pixels if it is bright, the centroid of an
aperture of radius R (6 px more than r, as far as its light is looked for, and no more
than the detector's window), and by ``n sqrt(w / (pi r))`` if it is dark, as an edge of
w = 4 px carries its place. R and w are measured: they agree with the detector's own
covariance.
"""

import math

_APERTURE_PITCHES = 0.49
"""R at most: what `lensfit.detect.dots` takes a bright dot's light from."""
_BRIGHT_MARGIN_PX, _DARK_EDGE_PX = 6.0, 4.0
SCATTER_FORMULA = {
    "bright": "n R^2 / (2 sqrt(pi) r^2)",
    "dark": f"n sqrt({_DARK_EDGE_PX:g} px / (pi r))",
}


def dot_scatter_px(
    noise: float, mark_px: float, pitch_px: float, *, bright: bool
) -> float:
    """Scatter of a dot's place, in pixels, along one axis.

    Parameters
    ----------
    noise : n, standard deviation of a pixel as part of white.
    mark_px, pitch_px : Diameter of the dot, and distance to the next.
    bright : Light on dark, else dark on light.
    """
    radius = mark_px / 2
    if not bright:
        return noise * math.sqrt(_DARK_EDGE_PX / (math.pi * radius))
    aperture = min(_APERTURE_PITCHES * pitch_px, radius + _BRIGHT_MARGIN_PX)
    return noise * aperture**2 / (2 * math.sqrt(math.pi) * radius**2)
