"""Maps and gains that apply a lens to a plate, prepared once per camera state.

A stage that is invisible at the tolerance is left out: if lateral colour nowhere
separates the channels visibly, one map serves all, and a lens that does not darken has
no gain. The tolerance is an error in display-referred units; `Budget` lists the error
that it allows each approximation.

Fall-off happens where the light lands, so its gain is applied after the warp, in the
distorted picture, and multiplies radiance only: alpha is coverage, which does not dim.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float32

from lensfit.batches import in_batches
from lensfit.coords import Window
from lensfit.preset.knob_groups import LookKnobs
from lensfit.rendering.look.stack import Look, look_of
from lensfit.rendering.look.white_balance import Chromaticities
from lensfit.rendering.plate_defocus import Defocus
from lensfit.rendering.smooth import PointFunction, smooth_over_window
from lensfit.rendering.uv import (
    Channel,
    PlateGeometry,
    SourceMap,
    source_map,
    window_grid,
)

if TYPE_CHECKING:
    from lensfit.lens import Lens

CHANNELS: tuple[Channel, ...] = ("r", "g", "b")
DEFAULT_TOLERANCE = 3e-3
_GRID = 33


class Budget(NamedTuple):
    """What a tolerance on the picture allows each approximation.

    A position wrong by d px costs d times the gradient of the picture: at most about
    1 per px on an edge, about 0.1 per px rms where there is detail at all.
    """

    map_error_px: float
    unseen_lateral_colour_px: float
    gain_error: float

    @classmethod
    def of(cls, tolerance: float) -> "Budget":
        if not tolerance > 0:
            raise ValueError(f"a tolerance is positive, not {tolerance}")
        return cls(tolerance / 4, 10 * tolerance, tolerance / 4)


@dataclass(frozen=True)
class Switches:
    """Which effects of the lens are wanted at all."""

    distortion: bool = True
    lateral_colour: bool = True
    falloff: bool = True
    defocus: bool = True


@dataclass(frozen=True, eq=False)
class Stages:
    """What is applied to a plate over `window`.

    Attributes
    ----------
    window : Pixels that are rendered.
    maps : Where red, green and blue read; the same object where they share one.
    gains : Relative illumination of red, green and blue; None where there is no
        fall-off to see.
    lateral_colour_px : Largest distance between the channels, whether applied or not.
    defocus : The lens' kernels, for plates with depth; None where it is not wanted.
    look : Bloom, glints and the like; None where all are neutral.
    """

    window: Window
    maps: tuple[SourceMap, SourceMap, SourceMap]
    gains: tuple[Float32[np.ndarray, "height width"] | None, ...]
    lateral_colour_px: float
    defocus: Defocus | None = None
    look: Look | None = None


def prepare_stages(
    lens: "Lens",
    display_window: Window,
    window: Window,
    *,
    tolerance: float = DEFAULT_TOLERANCE,
    switches: Switches | None = None,
    sensor_width_mm: float | None = None,
    external: SourceMap | None = None,
    look: LookKnobs | None = None,
    chromaticities: Chromaticities | None = None,
    depth_levels: int | None = None,
) -> Stages:
    """The maps and gains of a lens over a window.

    Parameters
    ----------
    lens : Lens at its camera state.
    display_window : Pixels that span the sensor width.
    window : Pixels to render.
    tolerance : Accepted error of the picture, display-referred.
    switches : Effects wanted; all if None.
    sensor_width_mm : Width that the display window spans; the lens' own if None.
    external : Map to use in place of the lens' own distortion; it covers `window`.
    look : Wanted looks; none if None.
    chromaticities : Of the plate's colours; Rec. 709 if None.
    depth_levels : Levels of depth; by the tolerance if None.
    """
    switches, budget = switches or Switches(), Budget.of(tolerance)
    geometry = PlateGeometry.of(lens, display_window, sensor_width_mm)
    # Where the light that a pixel shows in green really lands on the sensor.
    stays = not switches.distortion and external is None
    landing = geometry.distorted(lens, "g") if stays else None
    red_px, blue_px = lateral_colour_px(lens, geometry, window, landing)
    if external is not None:
        green = external.cropped(window)
    elif switches.distortion:
        mapping = geometry.undistorted(lens, "g")
        green = source_map(mapping, window, budget.map_error_px)
    else:
        green = SourceMap.identity(window)

    def beside_green(channel: Channel, shift_px: float) -> SourceMap:
        seen = shift_px > budget.unseen_lateral_colour_px
        if not (switches.lateral_colour and seen):
            return green
        mapping = _colour_shift(lens, geometry, channel, landing)
        return source_map(mapping, window, budget.map_error_px).after(green)

    maps = (beside_green("r", red_px), green, beside_green("b", blue_px))
    gains = (None, None, None)
    if switches.falloff:
        gains = _gains(lens, geometry, window, budget.gain_error, landing)
    defocus = None
    if switches.defocus:
        defocus = Defocus(lens, geometry, tolerance, depth_levels)
    looks = look_of(look, lens, geometry, tolerance, chromaticities)
    shift_px = max(red_px, blue_px)
    return Stages(window, maps, gains, shift_px, defocus, looks)


def lateral_colour_px(
    lens: "Lens",
    geometry: PlateGeometry,
    window: Window,
    landing: PointFunction | None = None,
) -> tuple[float, float]:
    """Largest distance between what red and green, and blue and green, read over a
    window, px."""
    if not lens.has_lateral_colour:
        return 0.0, 0.0
    points = window_grid(window, _GRID)
    red, blue = (
        in_batches(_colour_shift(lens, geometry, c, landing), points) - points
        for c in ("r", "b")
    )
    red_px, blue_px = (
        float(np.nanmax(np.linalg.norm(moved, axis=-1), initial=0.0))
        for moved in (red, blue)
    )
    return red_px, blue_px


def _colour_shift(
    lens: "Lens",
    geometry: PlateGeometry,
    channel: Channel,
    landing: PointFunction | None,
) -> PointFunction:
    """Own position plus what `channel` reads away from green."""
    in_green = geometry.undistorted(lens, "g")
    in_channel = geometry.undistorted(lens, channel)

    def mapping(points: np.ndarray) -> np.ndarray:
        landed = points if landing is None else landing(points)
        return points + in_channel(landed) - in_green(landed)

    return mapping


def _gains(
    lens: "Lens",
    geometry: PlateGeometry,
    window: Window,
    error: float,
    landing: PointFunction | None,
) -> tuple[np.ndarray | None, ...]:
    """Gain per channel; None where it is one throughout."""
    gains: list[np.ndarray | None] = []
    for channel in CHANNELS:
        gain = illumination_gain(
            lens, geometry, window, channel, tolerance=error, landing=landing
        )
        dims = not np.abs(gain - 1).max() <= error
        gains.append(gain if dims else None)
    return tuple(gains)


def illumination_gain(
    lens: "Lens",
    geometry: PlateGeometry,
    window: Window,
    channel: Channel = "g",
    *,
    tolerance: float = 2.5e-4,
    landing: PointFunction | None = None,
) -> Float32[np.ndarray, "height width"]:
    """Relative illumination at each pixel of `window`, 1 on axis.

    Parameters
    ----------
    lens : Lens at its camera state.
    geometry : How the plate lies on the sensor.
    window : Pixels wanted.
    channel : Colour channel.
    tolerance : Largest error of the interpolation between exact evaluations.
    landing : Where a pixel's light lands, px to px, when the picture itself stays
        undistorted; each pixel is where it lands if None.
    """

    def gain(points_px: np.ndarray) -> np.ndarray:
        landed = points_px if landing is None else landing(points_px)
        value = lens.relative_illumination(geometry.mm(landed), channel)
        return np.asarray(value, float)[:, None]

    return smooth_over_window(gain, window, tolerance)[0].astype(np.float32)


def apply_gain(
    pixels: Float32[np.ndarray, "height width channels"],
    gains: Sequence[Float32[np.ndarray, "height width"] | None],
) -> Float32[np.ndarray, "height width channels"]:
    """Each channel times its gain; None leaves a channel as it is, bit for bit.

    NaN gains (outside what the lens images) give black.
    """
    if all(gain is None for gain in gains):
        return pixels
    return np.asarray(_darkened_pixels(pixels, list(gains)))


@jax.jit
def _darkened_pixels(pixels: Array, gains: list[Array | None]) -> Array:
    """In one pass over the picture; a pure function, for any device."""
    one = jnp.ones(pixels.shape[:2], pixels.dtype)
    planes = [one if gain is None else jnp.nan_to_num(gain, nan=0.0) for gain in gains]
    return pixels * jnp.stack(planes, -1)
