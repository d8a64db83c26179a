"""Glints: streaks through highlights, as a star filter or straight blades make them.

A share of the light above a threshold is spread along a number of rays from its pixel.
Along a ray of length L the light per length falls off as

    f(t) = exp(-5 t / L) - exp(-5),    0 at L;

across it is a Gaussian of .06 % of the width of the frame. Diffraction grows with the
wavelength, so red's ray is longer than green's and blue's shorter: L (1 + dispersion
(wavelength / green's - 1)), with 1 what physics has. The light of each channel stays
what it was, all rays together, but for what falls beyond the plate; what is beyond it
is taken as dark.

Angles grow from x (right) towards y (down), as those of blades.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32

from lensfit.optics.spectrum import CENTRES_NM, REFERENCE_NM
from lensfit.rendering.look.light import (
    Picture,
    brightest_channel,
    doubled_picture,
    halved_picture,
    left_of,
    level_of,
    light_above,
    padded_picture,
    picture_with_halo,
)

WIDTH_SHARE = 6e-4
"""Standard deviation across a streak over the width of the frame."""
_FALL = 5.0
_LEAST_SHARE = 0.45
"""Of the Gaussian that halos leave to a small picture: a streak has it only across."""
_THINNEST_PX = 0.5
_STEPS_PER_PX = 4
_MARGIN = 8


@dataclass(frozen=True)
class Star:
    """The streaks of a point.

    Attributes
    ----------
    streaks : How many.
    length_px : Of green's.
    rotation_deg : Azimuth of the first.
    sigma_px : Across.
    dispersion : How much lengths differ with wavelength, 1 as diffraction has it.
    """

    streaks: int
    length_px: float
    rotation_deg: float
    sigma_px: float
    dispersion: float

    def lengths_px(self, channels: int) -> list[float]:
        """Of each channel; a grey one has green's."""
        if channels == 1 or self.dispersion == 0:
            return [self.length_px]
        ratios = [nm / REFERENCE_NM - 1 for nm in CENTRES_NM]
        return [self.length_px * max(1 + self.dispersion * r, 0.0) for r in ratios]


def picture_with_glints(
    colour: Picture, threshold: float, share: float, star: Star, least_px: float
) -> Picture:
    """A picture with streaks through its highlights.

    Parameters
    ----------
    threshold : Scene-linear; see `light`.
    share : Of the light above it that goes into streaks, 0 to 1.
    least_px : From `light.least_sigma_px`.
    """
    light = light_above(colour, threshold)
    if light.max() <= 0:
        return colour
    level = level_of(star.sigma_px, _LEAST_SHARE * least_px, light.shape)
    height, width = light.shape[:2]
    # A dark rim, so that halving mirrors nothing back into the picture.
    rim = _MARGIN << level
    dark = cv2.BORDER_CONSTANT
    around = cv2.copyMakeBorder(light, rim, rim, rim, rim, dark)
    around = around.reshape(*around.shape[:2], light.shape[2])
    small = halved_picture(padded_picture(around, level, dark), level)
    kernels = [
        star_kernel(star, length / 2**level, left_of(star.sigma_px, level))
        for length in star.lengths_px(light.shape[2])
    ]
    spread = doubled_picture(_convolved_light(small, kernels), level)
    return picture_with_halo(colour, light, spread[rim:, rim:][:height, :width], share)


def star_kernel(
    star: Star, length_px: float, sigma_px: float
) -> Float32[np.ndarray, "size size"]:
    """All streaks of a point, its pixel in the middle; sums to 1.

    A Gaussian has no preferred axes, so a streak is the product of its profile along
    (already spread by the Gaussian) and the Gaussian across.
    """
    sigma_px = max(sigma_px, _THINNEST_PX)
    spare = math.ceil(5 * sigma_px) + 1
    half = math.ceil(length_px) + spare
    kernel = np.zeros((2 * half + 1, 2 * half + 1))
    along_px, profile = _profile(length_px, sigma_px)
    for n in range(star.streaks):
        angle = math.radians(star.rotation_deg) + 2 * math.pi * n / star.streaks
        x, y = _pixels_near(math.cos(angle), math.sin(angle), half, spare)
        u = x * math.cos(angle) + y * math.sin(angle)
        v = y * math.cos(angle) - x * math.sin(angle)
        value = np.interp(u, along_px, profile, 0, 0) * np.exp(
            -0.5 * (v / sigma_px) ** 2
        )
        kernel[y + half, x + half] += value / (value.sum() * star.streaks)
    return kernel.astype(np.float32)


def _profile(length_px: float, sigma_px: float) -> tuple[np.ndarray, np.ndarray]:
    """Light along a streak, spread by the Gaussian, and where."""
    step = min(1.0, sigma_px) / _STEPS_PER_PX
    reach = math.ceil(5 * sigma_px / step)
    t = step * np.arange(-reach, math.ceil(length_px / step) + reach + 1)
    inside = (t >= 0) & (t <= length_px)
    falling = np.exp(-_FALL * np.clip(t / max(length_px, 1e-9), 0, 1))
    light = np.where(inside, falling - math.exp(-_FALL), 0)
    if light.sum() <= 0:
        light[reach] = 1
    near = step * np.arange(-reach, reach + 1)
    return t, np.convolve(light, np.exp(-0.5 * (near / sigma_px) ** 2), "same")


def _pixels_near(
    cosine: float, sine: float, half: int, spare: int
) -> tuple[np.ndarray, np.ndarray]:
    """Columns and rows, from the middle, of the pixels about a ray; each once."""
    steep = abs(sine) > abs(cosine)
    rise = cosine / sine if steep else sine / cosine
    ahead = math.copysign(1, sine if steep else cosine)
    first = np.arange(-spare, half + 1)[:, None] * int(ahead)
    second = np.rint(first * rise).astype(int) + np.arange(-2 * spare, 2 * spare + 1)
    first = np.broadcast_to(first, second.shape)
    kept = (np.abs(second) <= half) & (np.abs(first) <= half)
    first, second = first[kept], second[kept]
    return (second, first) if steep else (first, second)


def _convolved_light(light: Picture, kernels: list[np.ndarray]) -> Picture:
    """Light spread by a kernel for each channel, or one for all; dark beyond it."""
    lit = brightest_channel(light) > 0
    rows, columns = (np.flatnonzero(lit.max(axis)) for axis in (-1, 0))
    cores = cv2.getNumThreads()
    result = np.zeros_like(light)
    if not rows.size:
        return result
    from scipy import fft

    top, left = rows[0], columns[0]
    part = light[top : rows[-1] + 1, left : columns[-1] + 1]
    for channel in range(light.shape[2]):
        kernel = kernels[channel % len(kernels)]
        half = kernel.shape[0] // 2
        shape = [fft.next_fast_len(n + 2 * half, True) for n in part.shape[:2]]
        plane = part[..., channel]
        both = [np.asarray(fft.rfft2(p, shape, workers=cores)) for p in (plane, kernel)]
        spread = np.asarray(fft.irfft2(both[0] * both[1], shape, workers=cores))
        # Rounding leaves a little on either side of nothing.
        spread = np.maximum(spread, 0)[
            : part.shape[0] + 2 * half, : part.shape[1] + 2 * half
        ]
        _laid(result[..., channel], spread, top - half, left - half)
    return result


def _laid(plane: np.ndarray, patch: np.ndarray, top: int, left: int) -> None:
    """Put what a patch has in common with a plane onto it."""
    y0, x0 = max(top, 0), max(left, 0)
    y1 = min(top + patch.shape[0], plane.shape[0])
    x1 = min(left + patch.shape[1], plane.shape[1])
    plane[y0:y1, x0:x1] = patch[y0 - top : y1 - top, x0 - left : x1 - left]
