"""Sub-pixel centre of a line from its intensity profile across it.

The centre is the centroid of the line's light (or of the light it blocks) over a
window that holds the whole profile, after a straight background has been taken from
the flanks on both sides. The window is centred on the result and fades out smoothly,
so both sides are treated alike. Pixels sample the profile; what that costs is (1/pi)
times the profile's contrast at one cycle per pixel: nothing with a blur of half a
pixel or more, and at worst some hundredths of a pixel for a perfectly sharp line less
than two pixels wide that runs exactly along the pixel rows.

Rows are read along x for a line nearer to upright, along y for one nearer to level;
several rows make one sample, and their scatter is its noise.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

RECENTRINGS = 3
WORTH_OF_COMMON_SCATTER = 20
"""Rows that the scatter of all samples counts for beside a sample's own rows."""
FEWEST_PER_BIN = 0.2
"""Samples that a bin of the mean profile needs, of an even share."""


@dataclass(frozen=True)
class Stretches:
    """Short pieces of predicted line to be measured, all read along x.

    A line nearer to level is handled by giving the transposed image and swapping x
    and y. In row r the line is predicted at
    ``x_px + slope (r - y_px) + bend (r - y_px)^2 / 2``.
    """

    x_px: Float[np.ndarray, " samples"]
    y_px: Float[np.ndarray, " samples"]
    slope: Float[np.ndarray, " samples"]
    bend: Float[np.ndarray, " samples"]


@dataclass(frozen=True)
class Window:
    """What is read around a line: profile, fading edge, flanks, rows; pixels.

    Within `half_width_px` everything counts; over `fade_px` beyond it less and less,
    smoothly, so that light which reaches further does not beat with the pixel grid;
    `flank_px` more on either side tell the background.
    """

    half_width_px: float
    fade_px: float
    flank_px: float
    rows: int

    @property
    def reach_px(self) -> float:
        """Distance from the line to the outer end of the flank."""
        return self.half_width_px + self.fade_px + self.flank_px

    @property
    def columns(self) -> int:
        return 2 * int(np.ceil(self.reach_px)) + 2

    def profile_weight(self, u_px: np.ndarray) -> np.ndarray:
        """Weight of a pixel at a distance from the line."""
        away = np.clip((np.abs(u_px) - self.half_width_px) / self.fade_px, 0, 1)
        return 0.5 + 0.5 * np.cos(np.pi * away)

    def flank_weight(self, u_px: np.ndarray) -> np.ndarray:
        """1 on the flanks, 0 elsewhere."""
        away = np.abs(u_px) - self.half_width_px - self.fade_px
        return ((away >= 0) & (away <= self.flank_px)).astype(float)


class MeasuredLines(NamedTuple):
    """How the lines of one photograph were measured.

    Attributes
    ----------
    width_pitches : Their own width; None where blur hides it.
    windows : What was read around them, in each channel of the photograph.
    """

    width_pitches: float | None
    windows: tuple[Window, ...]


@dataclass(frozen=True)
class Centres:
    """Measured centres: displacement along x from the prediction, and its company."""

    dx_px: Float[np.ndarray, " samples"]
    variance_px2: Float[np.ndarray, " samples"]
    flux_per_row: Float[np.ndarray, " samples"]
    background: Float[np.ndarray, " samples"]
    highest: Float[np.ndarray, " samples"]
    measured: Bool[np.ndarray, " samples"]


@dataclass(frozen=True)
class _Patch:
    """Pixels around each stretch and their distance from the line along x."""

    values: Float[np.ndarray, "samples rows columns"]
    u_px: Float[np.ndarray, "samples rows columns"]
    inside: Bool[np.ndarray, " samples"]


def measure_centres(
    image: Float[np.ndarray, "height width"],
    stretches: Stretches,
    window: Window,
    sign: int,
    start_px: Float[np.ndarray, " samples"] | None = None,
) -> Centres:
    """Centre of the line in every stretch, relative to its prediction.

    Parameters
    ----------
    image : Samples, channel units.
    stretches : Where lines are expected.
    window : What to read around them.
    sign : +1 for lines brighter than their surroundings, -1 for darker.
    start_px : First guess of the displacement along x, pixels; 0 if None.
    """
    shift = np.zeros(len(stretches.x_px))
    if start_px is not None:
        shift = np.nan_to_num(start_px)
    for _ in range(RECENTRINGS):
        patch = _read(image, stretches, shift, window)
        light, background = _above_background(patch, window, sign)
        weight = window.profile_weight(patch.u_px)
        light = light * weight
        flux = light.sum((1, 2))
        with np.errstate(divide="ignore", invalid="ignore"):
            step = np.nan_to_num((light * patch.u_px).sum((1, 2)) / flux)
        found = patch.inside & (flux > 0) & (np.abs(step) < window.half_width_px)
        shift = shift + np.where(found, step, 0.0)
    return Centres(
        dx_px=np.where(found, shift, np.nan),
        variance_px2=_variance(light, patch.u_px, flux, found),
        flux_per_row=np.asarray(flux / window.rows),
        background=background,
        highest=np.where(weight > 0, patch.values, -np.inf).max((1, 2)),
        measured=found,
    )


def mean_profile(
    image: Float[np.ndarray, "height width"],
    stretches: Stretches,
    reach_px: float,
    sign: int,
) -> tuple[Float[np.ndarray, " bins"], Float[np.ndarray, " bins"]]:
    """Median profile across many stretches, in half-pixel bins.

    Each stretch is first centred on its own strongest part, as predictions may be a
    pixel off.

    Returns
    -------
    distance_px, height : Distance along x from the centre; signed image value.
    """
    rough = Window(reach_px / 3, reach_px / 3, reach_px / 3, 3)
    shift = measure_centres(image, stretches, rough, sign).dx_px
    patch = _read(image, stretches, np.nan_to_num(shift), rough)
    used = patch.inside & np.isfinite(shift)
    u, values = patch.u_px[used].ravel(), sign * patch.values[used].ravel()
    bins = np.round(2 * u).astype(int)
    edge = int(2 * reach_px)
    distance = np.arange(-edge, edge + 1)
    height = np.full(len(distance), np.nan)
    enough = FEWEST_PER_BIN * len(values) / len(distance)
    for k, b in enumerate(distance):
        own = values[bins == b]
        # Where all lines lie alike on the pixels, only strays fill every other bin.
        if len(own) and len(own) >= enough:
            height[k] = np.median(own)
    return distance / 2, height


def _read(
    image: np.ndarray, stretches: Stretches, shift: np.ndarray, window: Window
) -> _Patch:
    height, width = image.shape
    first = np.round(stretches.y_px - window.rows / 2).astype(int)
    rows: Int[np.ndarray, "samples rows"] = first[:, None] + np.arange(window.rows)
    dy = rows + 0.5 - stretches.y_px[:, None]
    line = (stretches.x_px + shift)[:, None] + stretches.slope[:, None] * dy
    line += stretches.bend[:, None] * dy**2 / 2
    left = np.round(line - window.columns / 2).astype(int)
    columns = left[..., None] + np.arange(window.columns)
    reach = window.half_width_px + window.fade_px + window.flank_px / 2
    inside = (rows >= 0).all(1) & (rows < height).all(1)
    inside &= (line >= reach).all(1) & (line <= width - reach).all(1)
    values = image[
        np.clip(rows, 0, height - 1)[..., None], np.clip(columns, 0, width - 1)
    ].astype(float)
    outside = (columns < 0) | (columns >= width)
    u = np.where(outside, np.inf, columns + 0.5 - line[..., None])
    return _Patch(np.where(outside, 0.0, values), _finite(u), inside)


def _finite(u: np.ndarray) -> np.ndarray:
    """Columns outside the image get a distance beyond every window."""
    return np.where(np.isinf(u), 1e6, u)


def _above_background(
    patch: _Patch, window: Window, sign: int
) -> tuple[np.ndarray, np.ndarray]:
    """Signed light above a straight background fitted to both flanks."""
    weight = window.flank_weight(patch.u_px)
    wu = weight * patch.u_px
    s0, s1, s2 = weight.sum((1, 2)), wu.sum((1, 2)), (wu * patch.u_px).sum((1, 2))
    t0 = (weight * patch.values).sum((1, 2))
    t1 = (wu * patch.values).sum((1, 2))
    with np.errstate(divide="ignore", invalid="ignore"):
        determinant = s0 * s2 - s1**2
        level = np.nan_to_num((s2 * t0 - s1 * t1) / determinant)
        tilt = np.nan_to_num((s0 * t1 - s1 * t0) / determinant)
    background = level[:, None, None] + tilt[:, None, None] * patch.u_px
    return sign * (patch.values - background), level


def _variance(
    light: np.ndarray, u: np.ndarray, flux: np.ndarray, found: np.ndarray
) -> np.ndarray:
    """Variance of a sample from the scatter of its rows, steadied by all samples.

    The scatter holds shot, read, quantisation and compression noise alike. It scales
    with the inverse square of the flux, so it is pooled as first moments.
    """
    rows = light.shape[1]
    moment = (light * u).sum(2)
    line = np.arange(rows) - (rows - 1) / 2
    slope = moment @ line / (line @ line)
    scatter = moment - moment.mean(1, keepdims=True) - slope[:, None] * line
    own = (scatter**2).sum(1)
    freedom = max(rows - 2, 1)
    if not found.any():
        return np.full(len(flux), np.nan)
    common = np.median(own[found]) / freedom
    pooled = own + WORTH_OF_COMMON_SCATTER * common
    pooled /= freedom + WORTH_OF_COMMON_SCATTER
    with np.errstate(divide="ignore", invalid="ignore"):
        return pooled * rows / flux**2
