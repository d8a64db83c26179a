"""The kernel of an ideal lens whose stop was turned: the picture of that stop, scaled.

An ideal lens shows its stop in every light out of focus, the same all over the frame
and as large as the circle of confusion: upright beyond the focus distance, turned by
half a turn before it. So one picture of the stop (blades, ring, filter), made once,
gives the kernel of any radius in closed form: its running sums along both axes, read at
the edges of the pixels. Diffraction is left out, as for `lensfit.render.disc`.
"""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Float32

from lensfit.kernel.lens_blur import LensBlur
from lensfit.optics.pupil import pupil_rays
from lensfit.optics.transmission import transmitted

_SIDE = 1024
_HALF = 1.6
"""Of the picture, in radii of the stop; the corners of three blades are at 1.56."""
_AZIMUTHS = 4096
_LEAST_RADIUS_PX = 1 / 16


@dataclass(frozen=True, eq=False)
class StopShape:
    """The light through a stop.

    Attributes
    ----------
    sums : Of the light left of and above the corners of the picture's cells, for r, g
        and b; the last one of each is 1.
    oval : By how much it is drawn out along x and y.
    """

    sums: Float[np.ndarray, "3 corners corners"]
    oval: tuple[float, float]

    @classmethod
    def of(cls, blur: LensBlur) -> "StopShape":
        """Of a perfect lens without rims."""
        light = _light(blur)
        sums = np.zeros((3, _SIDE + 1, _SIDE + 1))
        sums[:, 1:, 1:] = light.cumsum(1).cumsum(2)
        oval = (1.0, 1.0) if blur.oval is None else np.asarray(blur.oval).tolist()
        return cls(sums / sums[:, -1:, -1:], (oval[0], oval[1]))

    @property
    def is_coloured(self) -> bool:
        """Whether the colours differ at all."""
        return bool(np.any(self.sums != self.sums[1]))

    def kernel(
        self, radius_px: float, half: int, channel: int, finer: int = 1
    ) -> Float32[np.ndarray, "size size"]:
        """Share of its light in each pixel; sums to 1.

        Parameters
        ----------
        radius_px : Signed, in pixels of the plate; positive before the focus distance.
        half : Pixels of the kernel on either side of the middle one.
        channel : 0, 1 or 2 for red, green or blue.
        finer : Pixels of the kernel per pixel of the plate.
        """
        radius, size = -radius_px * finer, 2 * half + 1
        if abs(radius) < _LEAST_RADIUS_PX:
            point = np.zeros((size, size), np.float32)
            point[half, half] = 1
            return point
        edges = np.arange(size + 1) - size / 2
        columns, rows = (
            np.clip((edges / (radius * by) / _HALF + 1) * (_SIDE / 2), 0, _SIDE)
            for by in self.oval
        )
        below = _read(_read(self.sums[channel], rows).T, columns).T
        shares = np.diff(np.diff(below, axis=0), axis=1)
        return (shares / shares.sum()).astype(np.float32)

    @property
    def widest(self) -> float:
        """Half the side of the picture of a stop of radius 1."""
        return _HALF * max(self.oval)


def _read(
    sums: Float[np.ndarray, "corners n"], at: Float[np.ndarray, " edges"]
) -> Float[np.ndarray, "edges n"]:
    """Rows between the rows."""
    low = np.minimum(at.astype(int), len(sums) - 2)
    share = (at - low)[:, None]
    return (1 - share) * sums[low] + share * sums[low + 1]


def _light(blur: LensBlur) -> Float[np.ndarray, "3 side side"]:
    """On cells of the picture."""
    t = ((np.arange(_SIDE) + 0.5) / _SIDE * 2 - 1) * _HALF
    place = np.stack(np.meshgrid(t, t), -1).reshape(-1, 2)
    azimuth = np.arange(_AZIMUTHS) * (2 * np.pi / _AZIMUTHS)
    outline, _ = pupil_rays(
        jnp.zeros(2),
        blur.stop_radius,
        blur.pupil,
        jnp.asarray(azimuth),
        jnp.ones(_AZIMUTHS),
    )
    radius = np.linalg.norm(np.asarray(outline), axis=1)
    away = np.hypot(place[:, 0], place[:, 1])
    turn = np.arctan2(place[:, 1], place[:, 0])
    edge = np.interp(turn, azimuth, radius, period=2 * np.pi)
    cell = 2 * _HALF / _SIDE
    inside = np.clip((edge - away) / cell + 0.5, 0, 1)
    if blur.transmission is None:
        return np.broadcast_to(inside.reshape(_SIDE, _SIDE), (3, _SIDE, _SIDE))
    each = [
        inside
        * np.asarray(
            transmitted(
                jnp.asarray(place),
                jnp.asarray(edge),
                jnp.asarray(channel),
                jnp.asarray(float(len(place))),
                blur.transmission,
            )
        )
        for channel in range(3)
    ]
    return np.stack(each).reshape(3, _SIDE, _SIDE)
