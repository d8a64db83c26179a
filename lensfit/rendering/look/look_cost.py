"""Time of each look, and its effect in one sentence, for the plan of a plate.

Seconds are of two cores, measured on frames of two to eight megapixels; those of glints
and ghosts are of a frame with highlights all over it, which is the most.
"""

from typing import NamedTuple

from lensfit.coords import Window
from lensfit.rendering.look.pyramid import least_sigma_px
from lensfit.rendering.look.stack import Look

_SECONDS_PER_PIXEL = {
    "pro-mist": 2e-8,
    "diffusion": 4e-8,
    "ghosting": 9e-8,
    "glint": 7e-8,
    "bloom": 6e-8,
    "white balance": 3e-9,
}
_HALO_ERROR = 4e-4
"""Rms change of a picture per share, at a Gaussian of one pixel that is left."""


class LookPrice(NamedTuple):
    """One look that is on.

    Attributes
    ----------
    name : As in `stack.EFFECTS`.
    reason : What it does.
    error : Expected rms error of the picture, display-referred.
    seconds : Expected time.
    """

    name: str
    reason: str
    error: float
    seconds: float


def prices(look: Look, window: Window) -> list[LookPrice]:
    """Of the looks that run over a window, in order."""
    knobs, pixels = look.knobs, window.width * window.height
    shares = {
        "pro-mist": knobs.pro_mist_gain,
        "diffusion": knobs.diffusion_gain,
        "ghosting": knobs.ghost_gain,
        "glint": knobs.glint_gain,
        "bloom": knobs.bloom_gain,
        "white balance": 0.0,
    }
    halo_error = _HALO_ERROR / least_sigma_px(look.tolerance) ** 3
    return [
        LookPrice(
            name,
            _reason(name, look),
            shares[name] * halo_error,
            pixels * _SECONDS_PER_PIXEL[name],
        )
        for name in look.runs
    ]


def _reason(name: str, look: Look) -> str:
    knobs = look.knobs
    match name:
        case "pro-mist":
            share, size = knobs.pro_mist_gain, knobs.pro_mist_size_percent
        case "diffusion":
            share, size = knobs.diffusion_gain, knobs.diffusion_size_percent
        case "bloom":
            share, size = knobs.bloom_gain, knobs.bloom_size_percent
        case "ghosting":
            return (
                f"{knobs.ghost_count} of each light above {knobs.ghost_threshold:g}, "
                f"{100 * knobs.ghost_gain:.3g} % of its light together"
            )
        case "glint":
            return (
                f"{100 * knobs.glint_gain:.3g} % of the light above "
                f"{knobs.glint_threshold:g} in {knobs.glint_streaks} streaks of "
                f"{look.px(knobs.glint_length_percent):.3g} px"
            )
        case _:
            kelvin, tint = knobs.white_balance_kelvin, knobs.white_balance_tint
            return f"{kelvin:g} K, tint {tint:g}"
    above = f" above {knobs.bloom_threshold:g}" if name == "bloom" else ""
    half = look.px(size)
    return f"{100 * share:.3g} % of the light{above}, half of it within {half:.3g} px"
