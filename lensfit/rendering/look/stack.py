"""The order in which looks act on a picture.

pro-mist, diffusion   filters in front of the lens, but applied after it
ghosting              reflections in the lens, of lights as they stand in the plate
glint                 diffraction where the light passes the stop
bloom                 glare on the way to the sensor
white balance         the camera, which comes last, so that it moves no threshold

All act after depth of field and fall-off, in the distorted picture and on the window
with its overscan; then that is cropped. Each takes the picture of the one before. They
are scene-linear and change colour alone: alpha is coverage, which glare does not
change, so that a halo over nothing is light without coverage. Negative values stay, and
so do pixels that are NaN or infinite, which give no light to others.

Sizes are shares of the width of the display window, so that a proxy shows the look of
the full plate. A neutral effect is not run, and if all are neutral there is no stage.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float32

from lensfit.coords import Window
from lensfit.preset.knob_groups import LookKnobs
from lensfit.rendering.look.ghosting import LEVEL, ApertureShape, Ghosts, ghosts_of
from lensfit.rendering.look.glare import (
    DIFFUSION,
    PRO_MIST,
    SharpLayer,
    blur_of_light,
    filtered_picture,
    picture_with_bloom,
)
from lensfit.rendering.look.glint import WIDTH_SHARE, Star, picture_with_glints
from lensfit.rendering.look.light import (
    Picture,
    halved_picture,
    least_sigma_px,
    light_above,
    padded_picture,
)
from lensfit.rendering.look.white_balance import (
    NEUTRAL_KELVIN,
    REC709,
    Chromaticities,
    balance_matrix,
    balanced_picture,
    xyz_from_rgb,
)
from lensfit.rendering.uv import PlateGeometry

if TYPE_CHECKING:
    from lensfit.lens import Lens

EFFECTS = ("pro-mist", "diffusion", "ghosting", "glint", "bloom", "white balance")
"""In the order in which they act."""
_LEAST_GHOST_PX = 24.0


class Arrival(NamedTuple):
    """What looks must know of the plate before the lens blurs it.

    Attributes
    ----------
    lights : That throw ghosts, at half size; None if there are no ghosts.
    blur_px : As `blur_of_light`; None if bloom does not grow, or no depth is known.
    """

    lights: Picture | None
    blur_px: Float32[np.ndarray, "height width"] | None


@dataclass(eq=False)
class Look:
    """Looks of one lens on a plate; keeps the opening that it has made.

    Attributes
    ----------
    knobs : At least one is not neutral.
    lens, geometry : Whose opening, and how pixels lie on the sensor.
    tolerance : Accepted error of the picture, display-referred.
    chromaticities : Of the plate's colours.
    """

    knobs: LookKnobs
    lens: "Lens"
    geometry: PlateGeometry
    tolerance: float
    chromaticities: Chromaticities = REC709
    _openings: dict[Window, ApertureShape] = field(default_factory=dict)

    @property
    def runs(self) -> tuple[str, ...]:
        """The effects that are on, in order."""
        knobs = self.knobs
        balance = knobs.white_balance_kelvin, knobs.white_balance_tint
        on = (
            knobs.pro_mist_gain > 0,
            knobs.diffusion_gain > 0,
            knobs.ghost_gain > 0,
            knobs.glint_gain > 0,
            knobs.bloom_gain > 0,
            balance != (NEUTRAL_KELVIN, 0),
        )
        return tuple(name for name, runs in zip(EFFECTS, on, strict=True) if runs)

    @property
    def spreads(self) -> bool:
        """Whether light from beside the frame matters."""
        return light_spreads(self.knobs)

    @property
    def wants_arrival(self) -> bool:
        """Whether it matters how the plate was before the lens blurred it."""
        return self.knobs.ghost_gain > 0 or self._grows

    @property
    def _grows(self) -> bool:
        return self.knobs.bloom_gain > 0 and self.knobs.bloom_growth > 0

    def arrival(self, layers: Sequence[SharpLayer]) -> Arrival:
        """What to remember of the plate, its layers front to back; of a grey one the
        three channels may be alike."""
        knobs, lights, blur_px = self.knobs, None, None
        if knobs.ghost_gain > 0:
            seen = sum((layer.colour for layer in layers[1:]), layers[0].colour)
            light = light_above(seen, knobs.ghost_threshold)
            lights = halved_picture(padded_picture(light, LEVEL), LEVEL)
        if self._grows and any(layer.radius_px is not None for layer in layers):
            blur_px = blur_of_light(layers, knobs.bloom_threshold)
        return Arrival(lights, blur_px)

    def applied(self, picture: Picture, window: Window, arrival: Arrival) -> Picture:
        """The picture with its looks.

        Parameters
        ----------
        picture : Grey, r g b, or r g b alpha, over `window`.
        arrival : Of the same plate, over the same window.
        """
        knobs, runs, least_px = self.knobs, self.runs, self._least_px
        has_alpha = picture.shape[2] == 4
        colour = np.ascontiguousarray(picture[..., :3] if has_alpha else picture)
        if "pro-mist" in runs:
            size_px, share = self.px(knobs.pro_mist_size_percent), knobs.pro_mist_gain
            colour = filtered_picture(colour, PRO_MIST, share, size_px, least_px)
        if "diffusion" in runs:
            size_px, share = self.px(knobs.diffusion_size_percent), knobs.diffusion_gain
            colour = filtered_picture(colour, DIFFUSION, share, size_px, least_px)
        if arrival.lights is not None:
            ghosts = self._ghosts(arrival.lights, window, colour.shape)
            # A plate in depth has three channels, and a grey one only green in the end.
            ghosts = ghosts[..., 1:2] if colour.shape[2] < ghosts.shape[2] else ghosts
            colour = colour + np.float32(knobs.ghost_gain) * ghosts
        if "glint" in runs:
            threshold, share = knobs.glint_threshold, knobs.glint_gain
            colour = picture_with_glints(colour, threshold, share, self._star, least_px)
        if "bloom" in runs:
            size_px = self.px(knobs.bloom_size_percent)
            threshold, share = knobs.bloom_threshold, knobs.bloom_gain
            more_px = arrival.blur_px
            if more_px is not None:
                more_px = more_px * np.float32(knobs.bloom_growth)
            colour = picture_with_bloom(
                colour, threshold, share, size_px, least_px, more_px
            )
        if "white balance" in runs and colour.shape[2] == 3:
            colour = balanced_picture(colour, self._balance)
        if not has_alpha:
            return colour
        return np.concatenate([colour, picture[..., 3:]], -1)

    @property
    def _least_px(self) -> float:
        return least_sigma_px(self.tolerance)

    def px(self, percent: float) -> float:
        """Pixels, of percent of the width of the display window."""
        return percent / 100 * self.geometry.size_px[0]

    @cached_property
    def _star(self) -> Star:
        return Star(
            self.knobs.glint_streaks,
            self.px(self.knobs.glint_length_percent),
            self.knobs.glint_rotation_deg,
            self.px(100 * WIDTH_SHARE),
            self.knobs.glint_dispersion,
        )

    @cached_property
    def _balance(self) -> np.ndarray:
        kelvin, tint = self.knobs.white_balance_kelvin, self.knobs.white_balance_tint
        return balance_matrix(kelvin, tint, self.chromaticities)

    def _ghosts(self, lights: Picture, window: Window, shape: tuple) -> Picture:
        knobs = self.knobs
        if window not in self._openings:
            self._openings[window] = ApertureShape.of(self.lens, self.geometry, window)
        corner = np.array(window[:2], float)
        return ghosts_of(
            lights,
            LEVEL,
            shape[:2],
            self.geometry.px(_optical_centre_mm(self.lens)) - corner,
            Ghosts(
                knobs.ghost_count,
                knobs.ghost_reach,
                self.px(knobs.ghost_size_percent),
                knobs.ghost_tint,
            ),
            self._openings[window],
            min(_LEAST_GHOST_PX * self._least_px, 96.0),
            tuple(xyz_from_rgb(self.chromaticities)[1]),
        )


def light_spreads(knobs: LookKnobs | None) -> bool:
    """Whether some knobs ask for looks to which light beside the frame matters."""
    gains = ("pro_mist", "diffusion", "ghost", "glint", "bloom")
    return knobs is not None and any(getattr(knobs, f"{g}_gain") > 0 for g in gains)


def look_of(
    knobs: LookKnobs | None,
    lens: "Lens",
    geometry: PlateGeometry,
    tolerance: float,
    chromaticities: Chromaticities | None = None,
) -> Look | None:
    """The looks that knobs ask for; None where all of them are neutral."""
    if knobs is None:
        return None
    look = Look(knobs, lens, geometry, tolerance, chromaticities or REC709)
    return look if look.runs else None


def _optical_centre_mm(lens: "Lens") -> np.ndarray:
    return np.asarray(lens.distortion.principal_point_mm, float)
