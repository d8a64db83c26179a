"""Transfer functions: code values to scene-linear light and back.

Codes are normalised to 0..1 over the full range of the file; light is 0.18 for an 18 %
grey card in the camera logs and 1 for diffuse white in sRGB and the gammas. Constants
are those of the makers' papers, named at each curve, and agree with their published
grey cards (tests). Values below black go on along each curve's straight toe, so that
noise around black is not clipped; a gamma has no toe and goes on with odd symmetry.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensfit.errors import ImageError

Curve = Callable[[Float[np.ndarray, "..."]], Float[np.ndarray, "..."]]


@dataclass(frozen=True)
class Transfer:
    """One encoding.

    Attributes
    ----------
    decode : Scene-linear light from code values.
    encode : Its inverse.
    """

    decode: Curve
    encode: Curve


def decode(
    codes: Float[np.ndarray, "*shape"], encoding: str
) -> Float[np.ndarray, "*shape"]:
    """Scene-linear light, float64, from normalised code values.

    Raises
    ------
    ImageError : `encoding` is not in `ENCODINGS`.
    """
    return transfer_of(encoding).decode(np.asarray(codes, float))


def encode(
    light: Float[np.ndarray, "*shape"], encoding: str
) -> Float[np.ndarray, "*shape"]:
    """Normalised code values, float64, from scene-linear light; inverse of `decode`.

    Raises
    ------
    ImageError : `encoding` is not in `ENCODINGS`.
    """
    return transfer_of(encoding).encode(np.asarray(light, float))


def transfer_of(encoding: str) -> Transfer:
    """The curve of that name.

    Raises
    ------
    ImageError : There is none.
    """
    try:
        return _CURVES[encoding]
    except KeyError:
        raise ImageError(
            f"unknown encoding {encoding!r}", remedy=f"use one of {', '.join(_CURVES)}"
        ) from None


def _linear() -> Transfer:
    return Transfer(lambda code: code, lambda light: light)


def _gamma(exponent: float) -> Transfer:
    return Transfer(
        lambda code: np.sign(code) * np.abs(code) ** exponent,
        lambda light: np.sign(light) * np.abs(light) ** (1 / exponent),
    )


def _power_with_toe(
    exponent: float, offset: float, slope: float, code_cut: float
) -> Transfer:
    """``((code + offset)/(1 + offset))^exponent`` above a straight toe."""

    def decode_power(code):
        power = np.maximum((code + offset) / (1 + offset), 0) ** exponent
        return np.where(code <= code_cut, code / slope, power)

    def encode_power(light):
        power = (1 + offset) * np.maximum(light, 0) ** (1 / exponent) - offset
        return np.where(light <= code_cut / slope, slope * light, power)

    return Transfer(decode_power, encode_power)


def _log_with_toe(
    *,
    slope: float,
    offset: float,
    gain: float,
    lift: float,
    light_cut: float,
    toe_slope: float,
    toe_lift: float,
    base: float = 10.0,
) -> Transfer:
    """``gain * log(slope * light + offset) + lift`` above a straight toe."""
    rate = gain / math.log(base)
    code_cut = toe_slope * light_cut + toe_lift

    def decode_log(code):
        above = np.maximum(code, code_cut)
        log = (np.exp((above - lift) / rate) - offset) / slope
        return np.where(code < code_cut, (code - toe_lift) / toe_slope, log)

    def encode_log(light):
        above = np.maximum(light, light_cut)
        log = rate * np.log(slope * above + offset) + lift
        return np.where(light < light_cut, toe_slope * light + toe_lift, log)

    return Transfer(decode_log, encode_log)


def _logc3() -> Transfer:
    """ARRI, "ALEXA Log C Curve - Usage in VFX" (2012), SUP 3.x, EI 800, table 'LSE'."""
    return _log_with_toe(
        slope=5.555556,
        offset=0.052272,
        gain=0.247190,
        lift=0.385537,
        light_cut=0.010591,
        toe_slope=5.367655,
        toe_lift=0.092809,
    )


def _logc4() -> Transfer:
    """Cooper and Brendel, "ARRI LogC4 Logarithmic Color Space Specification" (2022)."""
    a = (2**18 - 16) / 117.45
    b = (1023 - 95) / 1023
    c = 95 / 1023
    slope = 7 * math.log(2) * 2 ** (7 - 14 * c / b) / (a * b)  # light per code
    cut = (2 ** (14 * (-c / b) + 6) - 64) / a
    return _log_with_toe(
        slope=a,
        offset=64.0,
        gain=b / 14,
        lift=c - 6 * b / 14,
        light_cut=cut,
        toe_slope=1 / slope,
        toe_lift=-cut / slope,
        base=2.0,
    )


def _slog3() -> Transfer:
    """Sony, "Technical Summary for S-Gamut3.Cine/S-Log3 and S-Gamut3/S-Log3"."""
    toe_slope = (171.2102946929 - 95) / 0.01125 / 1023
    return _log_with_toe(
        slope=1 / 0.19,
        offset=0.01 / 0.19,
        gain=261.5 / 1023,
        lift=420 / 1023,
        light_cut=0.01125,
        toe_slope=toe_slope,
        toe_lift=95 / 1023,
    )


def _log3g10() -> Transfer:
    """RED, "White Paper on REDWideGamutRGB and Log3G10" (2017)."""
    return _log_with_toe(
        slope=155.975327,
        offset=1 + 155.975327 * 0.01,
        gain=0.224282,
        lift=0.0,
        light_cut=-0.01,
        toe_slope=15.1927,
        toe_lift=15.1927 * 0.01,
    )


def _canonlog3() -> Transfer:
    """Canon's ACES input transform for Canon Log 3 (2021); symmetric about its toe.

    Its light is relative to 90 % reflectance, hence the factor 0.9.
    """
    gain, slope, white = 0.36726845, 14.98325, 0.9
    low, high = 0.097465473, 0.15277891
    low_lift, mid_lift, high_lift = 0.12783901, 0.12512219, 0.12240537
    mid_slope = 1.9754798

    def decode_canon(code):
        below = (1 - 10 ** ((low_lift - np.minimum(code, low)) / gain)) / slope
        above = (10 ** ((np.maximum(code, high) - high_lift) / gain) - 1) / slope
        middle = (code - mid_lift) / mid_slope
        return white * np.where(code < low, below, np.where(code > high, above, middle))

    def encode_canon(light):
        light = light / white
        below = low_lift - gain * np.log10(1 - slope * np.minimum(light, 0))
        above = high_lift + gain * np.log10(1 + slope * np.maximum(light, 0))
        middle = mid_slope * light + mid_lift
        return np.where(middle < low, below, np.where(middle > high, above, middle))

    return Transfer(decode_canon, encode_canon)


def _cineon() -> Transfer:
    """Kodak Cineon printing density: 0.002 per code, white 685, black 95 of 1023."""
    black = 10 ** ((95 - 685) / 300)

    def decode_cineon(code):
        return (10 ** ((1023 * code - 685) / 300) - black) / (1 - black)

    def encode_cineon(light):
        # Code 0 is the least light there is a code for, a little below black.
        least = 10 ** (-685 / 300)
        exposure = np.maximum(light * (1 - black) + black, least)
        return (685 + 300 * np.log10(exposure)) / 1023

    return Transfer(decode_cineon, encode_cineon)


_CURVES = {
    "linear": _linear(),
    "srgb": _power_with_toe(2.4, 0.055, 12.92, 0.04045),  # IEC 61966-2-1
    # ITU-R BT.709, with the unrounded constants that BT.2020-2 gives for its curve.
    "rec709": _power_with_toe(1 / 0.45, 0.09929682680944, 4.5, 0.08124285829863151),
    "gamma2.2": _gamma(2.2),
    "gamma2.4": _gamma(2.4),
    "logc3": _logc3(),
    "logc4": _logc4(),
    "slog3": _slog3(),
    "redlog3g10": _log3g10(),
    "canonlog3": _canonlog3(),
    "cineon": _cineon(),
}
ENCODINGS = tuple(_CURVES)
"""The names that `decode`, `encode` and a shoot file's ``encoding`` accept."""
