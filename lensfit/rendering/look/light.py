"""The light that an effect acts on, and smaller pictures on which it is spread.

It acts on the light of the whole picture, or on that above a threshold, which has a
soft knee, so that nothing pops as a light crosses it. With m the brightest of the three
channels and T the threshold, the light above it is

    0 below T/2,     (m - T/2)^2 / 2T  up to 3T/2,     m - T from there on,

in the pixel's own colour. It scales with exposure when the threshold does. A pixel that
is NaN or infinite in any channel gives no light, and negative channels give none.

On smaller pictures wide kernels are cheap. Pixels are cells: one of the smaller picture
covers two by two. Both ways take the quadratic B-spline (1, 3, 3, 1), which keeps the
sum and the place of every light, and widens it by a variance that does not depend on
where it lies: n steps down and n up by (4^n - 1) / 2 px^2 in all. What is left of a
Gaussian's variance is put on between, at the small size. The error of that against the
Gaussian itself (L2, relative, of a point) is .025 sigma^-2.5 or less with sigma the
Gaussian that is left, in pixels of the small picture: .4 % at 2, .08 % at 4.

Beside the picture its mirror image continues it.

Reference: P. J. Burt and E. H. Adelson, IEEE Trans. Commun. 31, 1983.
"""

import math

import cv2
import numpy as np
from jaxtyping import Float32

Picture = Float32[np.ndarray, "height width channels"]
Plane = Float32[np.ndarray, "height width"]
_KNEE = 0.5
"""Half the width of the knee over the threshold."""
_SPLINE = np.array([1, 3, 3, 1], np.float32) / 8
_REACH = 4.5
_LEAST_SIDE_PX = 4
_PIXEL_VARIANCE = 1 / 12


def all_light(colour: Picture) -> Picture:
    """The light of a picture, never negative, always finite."""
    light = np.maximum(colour, np.float32(0))
    if is_finite(colour):
        return light
    return np.where(np.isfinite(colour).all(-1, keepdims=True), light, np.float32(0))


def is_finite(colour: Picture) -> bool:
    """Whether no pixel is NaN or infinite: no finite ones add up to that in double."""
    return bool(np.isfinite(colour.sum(dtype=np.float64)))


def light_above(colour: Picture, threshold: float) -> Picture:
    """The part of the light that is above a threshold; all of it above 0."""
    light = all_light(colour)
    if threshold == 0:
        return light
    brightest = brightest_channel(light)
    share = _above(brightest, threshold)
    share /= np.maximum(brightest, np.finfo(np.float32).tiny)
    light *= share[..., None]
    return light


def brightness_above(colour: Picture, threshold: float) -> Plane:
    """The brightest channel of `light_above`."""
    brightest = brightest_channel(all_light(colour))
    return brightest if threshold == 0 else _above(brightest, threshold)


def brightest_channel(colour: Picture) -> Plane:
    """Of one or three channels."""
    first, *others = np.moveaxis(colour, -1, 0)
    result = first.copy()
    for channel in others:
        np.maximum(result, channel, out=result)
    return result


def _above(brightest: Plane, threshold: float) -> Plane:
    """Along the knee the square, beyond it the line; below it nothing is left."""
    low, width = (1 - _KNEE) * threshold, 2 * _KNEE * threshold
    over = brightest - np.float32(low)
    along = np.clip(over, 0, np.float32(width))
    over -= along
    np.maximum(over, 0, out=over)
    along *= along
    along *= np.float32(1 / (2 * width))
    over += along
    return over


def picture_with_halo(
    colour: Picture, light: Picture, halo: Picture, share: float
) -> Picture:
    """The picture with a share of some light taken away and laid down as its halo."""
    result = halo - light
    result *= np.float32(share)
    result += colour
    return result


def least_sigma_px(tolerance: float) -> float:
    """The Gaussian to leave to the small picture, so that a halo is as good as that."""
    return float(np.clip(0.25 * tolerance**-0.3, 1.0, 8.0))


def level_of(sigma_px: float, least_px: float, shape: tuple[int, ...]) -> int:
    """How many times a picture may be halved for a Gaussian."""
    level = 0
    while (
        left_of(sigma_px, level + 1) >= least_px
        and min(shape[:2]) >> (level + 1) >= _LEAST_SIDE_PX
    ):
        level += 1
    return level


def left_of(sigma_px: float, level: int) -> float:
    """The Gaussian that is left, in pixels of the small picture; 0 if none is."""
    rest = sigma_px**2 - (4**level - 1) / 2
    return math.sqrt(max(rest, 0.0)) / 2**level


def padded_picture(
    picture: Picture, level: int, border: int = cv2.BORDER_REFLECT
) -> Picture:
    """The picture continued to the right and below, so that it halves without rest."""
    height, width = picture.shape[:2]
    below, right = -height % 2**level, -width % 2**level
    if not below and not right:
        return picture
    return _whole(cv2.copyMakeBorder(picture, 0, below, 0, right, border), picture)


def halved_picture(picture: Picture, times: int = 1) -> Picture:
    """Half the size in both directions, so many times; sides must divide."""
    for _ in range(times):
        smooth = cv2.sepFilter2D(
            picture,
            -1,
            _SPLINE,
            _SPLINE,
            anchor=(1, 1),
            borderType=cv2.BORDER_REFLECT,
        )
        picture = _whole(np.ascontiguousarray(smooth[::2, ::2]), picture)
    return picture


def doubled_picture(picture: Picture, times: int = 1) -> Picture:
    """Twice the size in both directions, so many times."""
    for _ in range(times):
        height, width = picture.shape[:2]
        # Bilinear between the middles of cells is this very spline.
        large = cv2.resize(
            picture, (2 * width, 2 * height), interpolation=cv2.INTER_LINEAR
        )
        picture = _whole(large, picture)
    return picture


def picture_at_level(picture: Picture, level: int, wanted: int) -> Picture:
    """A picture that was halved `level` times as if it had been `wanted` times."""
    if wanted <= level:
        return doubled_picture(picture, level - wanted)
    return halved_picture(padded_picture(picture, wanted - level), wanted - level)


def gaussian(picture: Picture, sigma_px: float) -> Picture:
    """Spread by a Gaussian of this standard deviation, pixels included."""
    variance = sigma_px**2 - _PIXEL_VARIANCE
    if variance <= 0:
        return picture
    kernel = _pixel_gaussian(math.sqrt(variance), reach_of(sigma_px))
    spread = cv2.sepFilter2D(picture, -1, kernel, kernel, borderType=cv2.BORDER_REFLECT)
    return _whole(spread, picture)


def reach_of(sigma_px: float) -> int:
    """How far `gaussian` spreads light."""
    return math.ceil(_REACH * sigma_px)


def _pixel_gaussian(sigma_px: float, half: int) -> Float32[np.ndarray, " size"]:
    """Integrated over pixels; sums to 1."""
    edges = (np.arange(-half, half + 2) - 0.5) / (sigma_px * math.sqrt(2))
    shares = np.diff([math.erf(e) for e in edges])
    return (shares / shares.sum()).astype(np.float32)


def _whole(made: np.ndarray, like: np.ndarray) -> np.ndarray:
    """OpenCV drops the axis of a single channel."""
    return made.reshape(*made.shape[:2], like.shape[2])
