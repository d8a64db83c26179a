"""Where a dot's light is centred: sub-pixel centroids with their covariance.

The position of a dot is the centroid of its image with a uniform weight, after its
local background (a plane, fitted to a ring around it) is taken off: for a dot of
uniform radiance that is the centroid of the projected disc whatever the blur, so that
the bias from finite size can be predicted from geometry alone. Two rules keep noise
out while converging to that definition:

- bright dots: samples count where the slightly smoothed picture is above the noise,
  so that faint aberration tails belong to the dot and empty black does not;
- dark dots: a slightly smoothed picture is clipped to a band about half-level, which
  leaves out the texture of the paper and of the ink and keeps the edge.

All dots are measured at once on small patches; each sum over patches is one matrix
product with the polynomials 1, x, y, x^2, x y, y^2 of the patch.
"""

from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import gaussian_filter

from lensfit.detect.patches import (
    Flattened,
    Patches,
    flatten_bright,
    flatten_dark,
    second_moments_about,
    unevenly_lit_px,
)

_CHUNK_SAMPLES = 1_500_000
_THREADS = 2
_SMOOTHING_BRIGHT_PX = 2.5
SMOOTHING_DARK_PX = 1.0
_SMALLEST_WELL = 10_000
"""Electrons at the brightest sample: no camera used for this has noisier light."""
_SAMPLED_DOTS = 40
_ENOUGH_SAMPLES, _BAND_ROWS = 2_000_000, 32
"""To judge the noise of a picture by, and rows of the bands they are taken from."""
_CLIPPED_FIELD = 0.02
"""Dark dots: this much of the window may be clipped paper."""
BAND_GAIN = 1.4
"""Dark dots: levels from (1 - 1/gain)/2 to (1 + 1/gain)/2 of the depth are kept."""
_ABOVE_NOISE = (4.0, 7.0)
"""Bright dots: the weight rises from 0 to 1 between these multiples of the noise."""
_BRIGHT_REACH, _BRIGHT_RING = 0.49, 0.62
"""Aperture and outer ring of bright dots, in distances to the nearest dot."""
_DARK_REACH = 0.47
_DARK_MARGIN_PX = 5.0


class Windows(NamedTuple):
    """An elliptical aperture and background ring for each dot.

    shape_px2 : Matrix S whose ellipse v' S^-1 v = 1 is the edge of the aperture.
    ring : Outer edge of the background ring, in aperture radii.
    core : Radius inside which the dot's own level is taken, in aperture radii.
    """

    shape_px2: Float[np.ndarray, "dots 2 2"]
    ring: Float[np.ndarray, " dots"]
    core: Float[np.ndarray, " dots"]


class Measured(NamedTuple):
    """What was measured of each dot; NaN where it could not be.

    flux : Background-subtracted sum, channel units x square pixels; negative for a
        dark dot.
    level : Mean of the dot's core above its background; negative for a dark dot.
    background : Brightness of the surroundings at the dot's centre.
    noise : Standard deviation of the ring about its plane.
    moment_px2 : Second central moments of the dot.
    saturated : Clipped samples touch the dot.
    steepness : Relative change of the light over a dark dot's radius; 0 for bright.
    """

    centre_px: Float[np.ndarray, "dots 2"]
    covariance_px2: Float[np.ndarray, "dots 2 2"]
    flux: Float[np.ndarray, " dots"]
    level: Float[np.ndarray, " dots"]
    background: Float[np.ndarray, " dots"]
    noise: Float[np.ndarray, " dots"]
    moment_px2: Float[np.ndarray, "dots 2 2"]
    saturated: Bool[np.ndarray, " dots"]
    steepness: Float[np.ndarray, " dots"]


def windows_of(
    moment_px2: Float[np.ndarray, "dots 2 2"],
    spacing_px: Float[np.ndarray, " dots"],
    *,
    bright: bool,
) -> Windows:
    """Apertures that hold a dot's light and stay clear of its neighbours'.

    The light of bright dots reaches far, as aberration: up to half-way to the next
    dot. A dark dot's own ellipse plus a margin holds its blur and sharpening halo.

    Parameters
    ----------
    moment_px2 : Second central moments of the dots.
    spacing_px : To the nearest dot.
    """
    radius = 2 * np.linalg.det(moment_px2) ** 0.25
    if bright:
        aperture = _BRIGHT_REACH * spacing_px
        shape = np.eye(2) * aperture[:, None, None] ** 2
        ring = np.full(len(spacing_px), _BRIGHT_RING / _BRIGHT_REACH)
    else:
        aperture = np.maximum(_DARK_REACH * spacing_px, 1.1 * radius)
        aperture = np.minimum(radius + _DARK_MARGIN_PX, aperture)
        shape = 4 * moment_px2 * (aperture / radius)[:, None, None] ** 2
        ring = 1 + np.maximum(2.0, 0.25 * aperture) / aperture
    return Windows(shape, ring, np.maximum(0.5 * radius, 0.8) / aperture)


def measure(
    image: Float[np.ndarray, "height width"],
    centre_px: Float[np.ndarray, "dots 2"],
    windows: Windows,
    polarity: str,
    saturation: float = np.inf,
    ignore: Bool[np.ndarray, "height width"] | None = None,
) -> Measured:
    """Centroids of dots in one channel, starting from approximate centres.

    Parameters
    ----------
    image : Scene-linear channel, float32.
    centre_px : Approximate centres, within a fraction of the dot's radius.
    windows : Aperture and ring of each dot.
    polarity : "bright" or "dark".
    saturation : Value at and above which a sample is clipped.
    ignore : Samples that belong to something else, such as dirt.
    """
    image = np.ascontiguousarray(image, np.float32)
    shot = shot_noise_gain(image, saturation) if polarity == "bright" else 0.0
    sigma = _SMOOTHING_BRIGHT_PX if polarity == "bright" else SMOOTHING_DARK_PX
    smooth = cv2.GaussianBlur(image, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE)
    reach = np.sqrt(np.linalg.eigvalsh(windows.shape_px2)[:, 1]) * windows.ring
    half = np.maximum(np.ceil(reach + 0.5).astype(int), 2)
    order = _batches(half)

    def measured(some):
        patch = Patches(image, smooth, centre_px[some], int(half[some].max()), ignore)
        their = Windows(*(column[some] for column in windows))
        return _measure(patch, their, polarity == "bright", saturation, shot)

    with ThreadPoolExecutor(_THREADS) as pool:
        parts = list(pool.map(measured, order))
    back = np.argsort(np.concatenate(order))
    columns = zip(*parts, strict=True)
    return Measured(*(np.concatenate(column)[back] for column in columns))


def shot_noise_gain(
    image: Float[np.ndarray, "height width"], saturation: float = np.inf
) -> float:
    """Variance per brightness of the light's own noise, from the picture itself.

    The mixed fourth difference is blind to smooth structure (Immerkaer, 1996). Over
    octaves of brightness the least ratio counts, since structure can only add to it;
    where all is structure (dots of a few pixels) that of a small well bounds it.
    """
    square, level = _fourth_differences(image)
    dark = np.median(level)
    above = level - dark
    top = float(above.max(initial=0))
    if top <= 0:
        return 0.0
    floor = (
        float(square[above < top / 256].mean()) if (above < top / 256).any() else 0.0
    )
    use = (above > top / 64) & (level < 0.9 * saturation)
    above, square = above[use], square[use]
    octave = np.floor(np.log2(above / top)).astype(int)
    ratios = [
        (np.median(square[octave == k]) / 0.455 - floor) / np.median(above[octave == k])
        for k in np.unique(octave)
        if np.count_nonzero(octave == k) >= 200
    ]
    if not ratios:
        return 0.0
    return float(np.clip(min(ratios), 0.0, float(image.max()) / _SMALLEST_WELL))


def _fourth_differences(image: Float[np.ndarray, "height width"]):
    """Squares of the mixed fourth difference and smoothed brightness, row by row.

    Of large pictures evenly spread bands of rows are enough: each octave of brightness
    needs some hundred samples.
    """
    kernel = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32) / 6
    apart = max(1, image.size // _ENOUGH_SAMPLES) * _BAND_ROWS
    rows = _BAND_ROWS if apart > _BAND_ROWS else len(image)
    square, level = [], []
    for first in range(0, len(image), max(apart, rows)):
        band = image[first : first + rows]
        square.append(cv2.filter2D(band, -1, kernel)[1:-1, 1:-1] ** 2)
        level.append(cv2.blur(band, (3, 3))[1:-1, 1:-1])
    return np.concatenate(square), np.concatenate(level)


def _batches(half: np.ndarray) -> list[np.ndarray]:
    """Dots that share a patch size, in batches that fit a processor's cache."""
    bucket = np.ceil(3 * np.log2(half)).astype(int)
    batches = []
    for size in np.unique(bucket):
        dots = np.flatnonzero(bucket == size)
        chunk = max(1, _CHUNK_SAMPLES // (2 * int(half[dots].max()) + 1) ** 2)
        batches += [dots[k : k + chunk] for k in range(0, len(dots), chunk)]
    return batches


def _measure(
    patch: Patches, windows: Windows, bright: bool, saturation: float, shot: float
) -> Measured:
    """`measure` for dots that share a patch size."""
    rho = patch.radius(windows.shape_px2, patch.start)
    radius = np.linalg.det(windows.shape_px2).astype(np.float32)[:, None] ** 0.25
    ring = (rho > 1 + 0.5 / radius) & (rho < windows.ring[:, None]) & patch.inside
    flat = flatten_bright(patch, ring) if bright else flatten_dark(patch, ring, radius)
    core = ((rho < windows.core[:, None]) & patch.inside).astype(np.float32)
    level = (core * flat.smooth).sum(1) / np.maximum(core.sum(1), 1e-3)
    centre, aperture, weight, light = patch.start, core, core, core
    sums = total = np.zeros(0)
    for _ in range(2):
        rho = patch.radius(windows.shape_px2, centre)
        aperture = np.clip((1 - rho) * radius + 0.5, 0, 1) * patch.inside
        if bright:
            weight = aperture * _above_noise(flat.smooth, flat.noise)
            light = weight * flat.sharp
        else:
            light, weight = _band(flat.smooth, level, aperture)
        sums = (light @ patch.basis).astype(float)
        total = np.where(sums[:, 0] > 0, sums[:, 0], np.nan)
        step = sums[:, 1:3] / total[:, None]
        near = np.abs(step - patch.start).max(1) < 0.75 * radius[:, 0]
        centre = np.where(near[:, None], step, np.nan)
    covariance = _covariance(patch, flat, weight, centre)
    if bright:
        own = second_moments_about(weight * light, patch, centre)
        covariance = (covariance + shot * own) / (total**2)[:, None, None]
    else:
        share = _smoothed_share(weight, patch, centre)
        scale = total * level / BAND_GAIN
        covariance *= share / (scale**2)[:, None, None]
    clipped = (patch.sharp >= saturation) & (aperture > 0.5)
    limit = 0.0 if bright else _CLIPPED_FIELD
    good = np.isfinite(centre).all(1)
    moment = _central(sums, total, centre)
    steepness, doubt = _steep_light(flat, moment, bright)
    return Measured(
        centre_px=centre + patch.origin,
        covariance_px2=covariance + doubt,
        flux=total if bright else (aperture * flat.sharp).sum(1) + 0 * centre[:, 0],
        level=np.where(good, level, np.nan).astype(float),
        background=flat.plane[:, 0] + (flat.plane[:, 1:] * centre).sum(1),
        noise=flat.noise,
        moment_px2=moment,
        saturated=clipped.mean(1) > limit,
        steepness=steepness,
    )


def _steep_light(flat: Flattened, moment, bright: bool):
    """Relative change of the light over each dark dot's radius, and the doubt it casts.

    The doubt is a covariance, square pixels; bright dots are lit by nothing else.
    """
    if bright:
        return np.zeros(len(moment)), np.zeros((2, 2))
    radius = 2 * np.linalg.det(np.nan_to_num(moment)).clip(0) ** 0.25
    slope = np.linalg.norm(flat.plane[:, 1:], axis=1) / flat.plane[:, 0]
    doubt = unevenly_lit_px(slope * radius, radius)
    return slope * radius, (doubt**2)[:, None, None] * np.eye(2)


def _above_noise(smooth, noise):
    """Weight of samples by how far the smoothed signal is above its own noise."""
    low, high = _ABOVE_NOISE
    own = np.maximum(noise / (2 * np.sqrt(np.pi) * _SMOOTHING_BRIGHT_PX), 1e-12)
    weight = smooth * (1 / (own * (high - low))).astype(np.float32)[:, None]
    weight -= low / (high - low)
    return np.clip(weight, 0, 1, out=weight)


def _band(smooth, level, aperture):
    """Depth clipped to the band about half-level, and where it is not clipped."""
    safe = np.where(level < 0, level, -np.inf).astype(np.float32)
    depth = smooth * (BAND_GAIN / safe)[:, None]
    depth += 0.5 - 0.5 * BAND_GAIN
    unclipped = ((depth > 0) & (depth < 1)) * aperture
    return np.clip(depth, 0, 1, out=depth) * aperture, unclipped


def _central(sums, total, centre):
    xx, xy, yy = (sums[:, 3:] / total[:, None]).T
    second = np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -2)
    return second - centre[:, :, None] * centre[:, None, :]


def _covariance(patch, flat: Flattened, weight, centre):
    """Of the first moments: white noise under the weight, and the fitted slopes'."""
    lever = second_moments_about(weight, patch, centre)
    spread = second_moments_about(weight * weight, patch, centre)
    slope = lever @ flat.plane_covariance[:, 1:, 1:] @ lever
    return (flat.noise**2)[:, None, None] * (spread + slope)


def _smoothed_share(weight, patch: Patches, centre) -> float:
    """Variance of the smoothed picture's sums, relative to white noise's.

    Exact for a sample of the dots: noise enters through the weight times the offset,
    smoothed as the picture was.
    """
    some = np.unique(np.linspace(0, len(weight) - 1, _SAMPLED_DOTS).astype(int))
    some = some[np.isfinite(centre[some]).all(1)]
    side = round(weight.shape[1] ** 0.5)
    lever = (patch.basis[:, 1] - centre[some, :1]) * weight[some]
    lever = lever.reshape(-1, side, side)
    spread = gaussian_filter(lever, (0, SMOOTHING_DARK_PX, SMOOTHING_DARK_PX))
    white = (lever**2).sum((1, 2))
    share = (spread**2).sum((1, 2))[white > 0] / white[white > 0]
    return float(np.median(share)) if len(share) else 1.0
