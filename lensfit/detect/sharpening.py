"""The sharpening filter of a camera: found along edges, and taken off.

No lens makes a picture darker beside an edge than far from it, or brighter on the
bright side: blur is a mean of what is there. Many cameras do, since they add to the
picture its difference from a blurred copy (an unsharp mask). In wave numbers k, per
pixel, of a power of the light v = L^(1/gamma), they multiply the picture by

    S(k) = 1 + a (1 - exp(-k^2 r^2 / 2)),

a the amount and r the radius in pixels. The light across a straight edge is a step
behind the blur, here a Gaussian and a disc, and the pixel; its power, filtered by S, is
what was recorded. a, r and gamma are those of all photographs of a shoot, the blur is
of each. A halo tells S; an edge without one tells nothing, since the blur of a disc is
steep too. Nor is all an edge that is steep: beside a corner, or where lines cross, more
light comes together than farther away, and blur that is wider than what is around an
edge mixes that in. An edge has to look the same a few pixels along it, and to be sharp
enough to reach its plateaus. So S is looked for only where there are halos, and
dividing by it takes them off: S is at least 1, so noise is damped, not raised. The
filter acts on the luma, as cameras apply it, and is taken off that.

Cameras that suppress halos on one side apply no such filter, and no S explains their
edges: these stay, and are named.

Reference: A. Polesel, G. Ramponi and V. J. Mathews, Image enhancement via adaptive
unsharp masking, IEEE Transactions on Image Processing 9 (2000) 505.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
import scipy.fft
from jaxtyping import Bool, Float
from scipy.ndimage import map_coordinates
from scipy.optimize import least_squares
from scipy.special import j1

from lensfit.chroma import LUMA
from lensfit.photograph import Photograph

_COMPARED_GAMMA = 2.2
"""Of the light that profiles are compared in, about as codes have it."""
_SMOOTHING_PX = 0.8
_HALF_PX, _STEP_PX, _PLATEAU_PX = 8.0, 0.25, 5.0
"""Reach of a profile to each side, and where the plateaus begin."""
_MOST_EDGES, _FEWEST_EDGES = 4000, 100
_STEEP_QUANTILE, _STEEP_PART = 0.97, 0.5
"""Places are edges whose slope is so large a part of that of the steepest few."""
_FLAT, _LEAST_CONTRAST = 0.08, 0.5
"""Deviation of a plateau over the contrast; contrast over that of strong edges."""
_UNEVEN = 0.04
"""How far the plateaus of all edges together may be off, over the contrast: a broad
line, or a small dot, has none."""
_BESIDE_PX = 3.0
"""Along an edge, to both sides, where its plateaus have to be the same."""
_MOST_RISE_PX = 5.0
"""From a tenth of the contrast to nine tenths, of an edge that tells of sharpening."""
_LEAST_HALO, _LEAST_LONE_HALO = 0.03, 0.05
"""Of the contrast, on both sides and on one; JPEG rings by .01, and uneven paper has
been .03 brighter on one side."""
_LEFT_HALO = 0.3
"""Share of the halos that a mask may leave in its own model: more is no mask."""
_QUARTER_TURN = np.array([[0.0, 1.0], [-1.0, 0.0]])
_SIZE = 256
"""Samples of a modelled edge, 32 px to each side."""
_MOST_PROFILES = 4
_BOUNDS = {
    "amount": (1e-3, 8.0),
    "radius_px": (0.5, 4.0),
    "gamma": (1.0, 3.0),
    "blur_px": (0.05, 5.0),
    "disc_px": (0.05, 8.0),
}
_START_RADII_PX = (0.6, 1.2, 2.0)
_START_AMOUNT, _START_GAMMA, _START_BLUR_PX, _START_DISC_PX = 1.0, 1.8, 0.5, 0.8
_PADDING_PX, _TINY = 16, 1e-6


class EdgeProfile(NamedTuple):
    """Median light across the edges of one photograph, to the power of 1 / 2.2.

    Attributes
    ----------
    across_px : From the edge to the bright side.
    light : 0 on the dark plateau and 1 on the bright one.
    dark, bright : Levels of the plateaus.
    """

    across_px: Float[np.ndarray, " places"]
    light: Float[np.ndarray, " places"]
    dark: float
    bright: float

    @property
    def halos(self) -> tuple[float, float]:
        """How far the light passes the plateaus, dark and bright, of the contrast."""
        return -float(self.light.min()), float(self.light.max()) - 1


class UnsharpMask(NamedTuple):
    """What a camera applied to its pictures.

    Attributes
    ----------
    amount, radius_px : Of the mask.
    gamma : It acts on the light to the power of 1 / gamma.
    """

    amount: float
    radius_px: float
    gamma: float


class Sharpening(NamedTuple):
    """The sharpening of a camera.

    Attributes
    ----------
    halos : The largest that were seen, dark and bright, as parts of the contrast.
    mask : That explains them; None where none does, as of halos on one side.
    """

    halos: tuple[float, float]
    mask: UnsharpMask | None

    @property
    def sentence(self) -> str:
        """What was seen, without a full stop."""
        dark, bright = (f"{100 * max(halo, 0.0):.0f} %" for halo in self.halos)
        return (
            f"the camera sharpens: beside edges its photographs are up to {dark} of "
            f"the contrast darker, and {bright} brighter, than farther away"
        )


def edge_profile(photograph: Photograph) -> EdgeProfile | None:
    """Across the strong straight edges of a photograph; None where there are few that
    have a plateau on both sides, and of a linear file, which holds what the sensor
    saw."""
    if photograph.is_linear:
        return None
    light = _root(_luma(photograph.pixels), _COMPARED_GAMMA)
    places, ways = _edges(light)
    if len(places) < _FEWEST_EDGES:
        return None
    across_px = np.arange(-_HALF_PX, _HALF_PX + _STEP_PX / 2, _STEP_PX)
    dark, bright = across_px < -_PLATEAU_PX, across_px > _PLATEAU_PX
    sampled = _sampled_across(light, places, ways, across_px)
    low, high = (np.median(sampled[:, side], 1) for side in (dark, bright))
    contrast = high - low
    uneven = [sampled[:, side].std(1) for side in (dark, bright)]
    for along_px in (-_BESIDE_PX, _BESIDE_PX):
        other_places = places + along_px * ways @ _QUARTER_TURN
        beside = _sampled_across(light, other_places, ways, across_px)
        uneven += [
            np.abs(np.median(beside[:, side], 1) - level)
            for side, level in ((dark, low), (bright, high))
        ]
    strong = contrast > _LEAST_CONTRAST * np.quantile(contrast, 0.9)
    good = strong & (np.max(uneven, 0) < _FLAT * contrast)
    if np.count_nonzero(good) < _FEWEST_EDGES:
        return None
    scaled = (sampled[good] - low[good, None]) / contrast[good, None]
    profile = np.median(scaled, 0)
    off = np.concatenate([profile[dark], profile[bright] - 1])
    sharp = _rise_px(across_px, profile) <= _MOST_RISE_PX
    if not sharp or np.abs(off).max() > _UNEVEN:
        return None
    levels = float(np.median(low[good])), float(np.median(high[good]))
    return EdgeProfile(across_px, profile, *levels)


def _sampled_across(
    light: Float[np.ndarray, "height width"],
    places: Float[np.ndarray, "edges 2"],
    ways: Float[np.ndarray, "edges 2"],
    across_px: Float[np.ndarray, " places"],
) -> Float[np.ndarray, "edges places"]:
    """The light across each place, towards the bright side."""
    along = places[:, None] + across_px[:, None] * ways[:, None]
    return map_coordinates(light, along.T, order=1, mode="nearest").T


def _rise_px(
    across_px: Float[np.ndarray, " places"], profile: Float[np.ndarray, " places"]
) -> float:
    """From the last place below a tenth of the contrast to the first above nine."""
    low = across_px[profile < 0.1]
    high = across_px[profile > 0.9]
    return float(high.min() - low.max()) if len(low) and len(high) else np.inf


def sharpening_of(profiles: Iterable[EdgeProfile | None]) -> Sharpening | None:
    """The sharpening behind the halos of photographs of one camera; None without."""
    profiles = [one for one in profiles if one is not None]
    if not profiles:
        return None
    dark, bright = (max(one.halos[k] for one in profiles) for k in (0, 1))
    with_halos = [one for one in profiles if _has_halo(one)]
    if not with_halos:
        return None
    with_halos.sort(key=lambda one: -max(one.halos))
    return Sharpening((dark, bright), _mask_of(with_halos[:_MOST_PROFILES]))


def _has_halo(profile: EdgeProfile) -> bool:
    return min(profile.halos) >= _LEAST_HALO or max(profile.halos) >= _LEAST_LONE_HALO


def _mask_of(profiles: Sequence[EdgeProfile]) -> UnsharpMask | None:
    """The mask behind the halos of all profiles, whose blur and place are their own."""
    count, seen = len(profiles), np.concatenate([one.light for one in profiles])
    limits = [_BOUNDS[name] for name in UnsharpMask._fields]
    limits += count * [_BOUNDS["blur_px"]] + count * [_BOUNDS["disc_px"]]
    low, high = np.log(limits).T
    bounds = np.append(low, -np.ones(count)), np.append(high, np.ones(count))

    def modelled(values: np.ndarray) -> np.ndarray:
        mask = UnsharpMask(*np.exp(values[:3]).tolist())
        each = values[3:].reshape(3, count).T
        return np.concatenate(
            [
                _sharpened_edge(one, mask, np.exp(blur), np.exp(disc), off_px)
                for one, (blur, disc, off_px) in zip(profiles, each, strict=True)
            ]
        )

    def solved(radius_px: float):
        mask = UnsharpMask(_START_AMOUNT, radius_px, _START_GAMMA)
        start = np.log([*mask, *count * [_START_BLUR_PX], *count * [_START_DISC_PX]])
        start = np.append(start, np.zeros(count))
        return least_squares(lambda x: modelled(x) - seen, start, bounds=bounds)

    best = min(map(solved, _START_RADII_PX), key=lambda one: one.cost)
    found = modelled(best.x)
    left = max(abs(found.min() - seen.min()), abs(found.max() - seen.max()))
    if left > _LEFT_HALO * max(-seen.min(), seen.max() - 1):
        return None
    return UnsharpMask(*np.exp(best.x[:3]).tolist())


def without_sharpening(photograph: Photograph, mask: UnsharpMask) -> Photograph:
    """The photograph as it was before the camera sharpened it; clipped pixels stay, and
    so does a linear file."""
    if photograph.is_linear:
        return photograph
    coded = _root(photograph.pixels, mask.gamma)
    luma = _luma(coded)
    coded = coded + (_deconvolved_luma(luma, mask) - luma)[..., None]
    light = _root(coded, 1 / mask.gamma).astype(np.float32)
    kept = photograph.pixels >= photograph.saturation
    return replace(photograph, pixels=np.where(kept, photograph.pixels, light))


def _luma(
    pixels: Float[np.ndarray, "height width channels"],
) -> Float[np.ndarray, "height width"]:
    return pixels @ LUMA if pixels.shape[2] == 3 else pixels[..., 0]


def _root(
    light: Float[np.ndarray, "*shape"], gamma: float
) -> Float[np.ndarray, "*shape"]:
    """The light to the power of 1 / gamma, odd about zero."""
    return np.sign(light) * np.abs(light) ** (1 / gamma)


def _edges(
    light: Float[np.ndarray, "height width"],
) -> tuple[Float[np.ndarray, "edges 2"], Float[np.ndarray, "edges 2"]]:
    """Places on edges, rows and columns, and unit vectors to the bright side."""
    smooth = cv2.GaussianBlur(light.astype(np.float32), (0, 0), _SMOOTHING_PX)
    slope = np.stack([cv2.Scharr(smooth, cv2.CV_32F, *way) for way in ((0, 1), (1, 0))])
    steep = np.hypot(*slope)
    least = _STEEP_PART * np.quantile(steep[::3, ::3], _STEEP_QUANTILE)
    rows, columns = np.nonzero(_far_from_border(steep) & (steep > least))
    # Of every edge the top of the slope: a few of the places around it.
    step = max(1, len(rows) // (8 * _MOST_EDGES))
    rows, columns = rows[::step], columns[::step]
    ways = (slope[:, rows, columns] / steep[rows, columns]).T
    places = np.stack([rows, columns], -1).astype(float)
    before, here, after = (
        map_coordinates(steep, (places + t * ways).T, order=1) for t in (-1.0, 0.0, 1.0)
    )
    top = (here >= before) & (here > after)
    bend = np.minimum(before - 2 * here + after, -1e-9)
    off = np.where(top, (before - after) / (2 * bend), 0.0)
    top &= np.abs(off) < 0.7
    places, ways = (places + off[:, None] * ways)[top], ways[top]
    step = max(1, len(places) // _MOST_EDGES)
    return places[::step], ways[::step]


def _far_from_border(
    picture: Float[np.ndarray, "height width"],
) -> Bool[np.ndarray, "height width"]:
    inside = np.zeros(picture.shape, bool)
    margin = int(_HALF_PX) + 2
    inside[margin:-margin, margin:-margin] = True
    return inside


def _sharpened_edge(
    profile: EdgeProfile,
    mask: UnsharpMask,
    blur_px: float,
    disc_px: float,
    off_px: float,
) -> Float[np.ndarray, " places"]:
    """The light across the edge, as `EdgeProfile` has it."""
    k = 2 * np.pi * np.fft.fftfreq(_SIZE, _STEP_PX)
    disc = np.maximum(np.abs(k) * disc_px, _TINY)
    blur = np.exp(-((k * blur_px) ** 2) / 2) * np.sinc(k / (2 * np.pi))
    step = np.zeros(_SIZE)
    step[_SIZE // 2] = 1.0
    low, high = (level**_COMPARED_GAMMA for level in (profile.dark, profile.bright))
    blurred = low + (high - low) * np.cumsum(
        _filtered_samples(step, blur * 2 * j1(disc) / disc)
    )
    coded = _root(blurred, mask.gamma)
    slopes = _filtered_samples(np.diff(coded, prepend=coded[0]), _response(k**2, mask))
    # Files hold no light below nothing: beside black ink the dark halo is cut off.
    coded = np.maximum(coded[0] + np.cumsum(slopes), 0.0)
    light = coded ** (mask.gamma / _COMPARED_GAMMA)
    along = (np.arange(_SIZE) - _SIZE // 2 + 0.5) * _STEP_PX
    light = np.interp(profile.across_px - off_px, along, light)
    return (light - profile.dark) / (profile.bright - profile.dark)


def _filtered_samples(
    samples: Float[np.ndarray, " samples"], response: Float[np.ndarray, " samples"]
) -> Float[np.ndarray, " samples"]:
    return np.real(np.fft.ifft(np.fft.fft(samples) * response))


def _response(
    k2: Float[np.ndarray, "*shape"], mask: UnsharpMask
) -> Float[np.ndarray, "*shape"]:
    """S of squared wave numbers."""
    return 1 + mask.amount * (1 - np.exp(-k2 * mask.radius_px**2 / 2))


def _deconvolved_luma(
    luma: Float[np.ndarray, "height width"], mask: UnsharpMask
) -> Float[np.ndarray, "height width"]:
    """The picture over S, as if it went on beyond its border."""
    padded = np.pad(luma.astype(np.float32), _PADDING_PX, "symmetric")
    shape = [cv2.getOptimalDFTSize(n) for n in padded.shape]
    down = 2 * np.pi * np.fft.fftfreq(shape[0])
    right = 2 * np.pi * np.fft.rfftfreq(shape[1])
    k2 = (down[:, None] ** 2 + right**2).astype(np.float32)
    padded = np.pad(
        padded, [(0, s - n) for s, n in zip(shape, padded.shape, strict=True)], "edge"
    )
    waves = np.asarray(scipy.fft.rfft2(padded))
    waves /= _response(k2, mask)
    found = np.asarray(scipy.fft.irfft2(waves, shape))
    rows, columns = luma.shape
    return found[_PADDING_PX : _PADDING_PX + rows, _PADDING_PX : _PADDING_PX + columns]
