"""The circle of confusion: blur radius of a thin lens as a function of distance.

It does not make the picture (the lens' own rays do). It sets the thickness of a slab of
depth, tells where two neighbouring pixels belong to different surfaces, and bounds how
far light can spread.

In pixels, with the aperture's diameter A = f/N, the principal distance c and the pixel
pitch q, the signed radius of an object at vergence v = 1/z is

    r = A c (v - v_focus) / 2 q,

positive in front of the focus distance. It is linear in vergence, so everything here is
in vergence, where the sky is an ordinary 0.

References
----------
Thin-lens circle |S2 - S1| / S2 * f^2 / (N (S1 - f)), S1 the focus distance; the same
with c = f S1 / (S1 - f).
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float32

from lensfit.rendering.uv import PlateGeometry

if TYPE_CHECKING:
    from lensfit.lens import Lens

_LEAST_MM = np.float32(1e-30)
"""The vergence of a nearer object is no number of 32 bits."""


@dataclass(frozen=True)
class Circle:
    """Signed radius of the blur as a function of vergence.

    Attributes
    ----------
    px_mm : Radius per vergence, px mm.
    focus_vergence : Per mm, from the entrance pupil.
    most_px : No radius is larger.
    """

    px_mm: float
    focus_vergence: float
    most_px: float = np.inf

    @classmethod
    def of(cls, lens: "Lens", geometry: PlateGeometry) -> "Circle":
        """Of a lens on a plate; zero everywhere if the f-number is unknown."""
        pitch_mm = geometry.area_mm[0] / geometry.size_px[0]
        per_vergence, focus = lens.blur_per_vergence()
        most_mm = lens.largest_blur_mm
        most_px = np.inf if most_mm is None else most_mm / pitch_mm
        return cls(per_vergence / pitch_mm, focus, most_px)

    def radius_px(
        self, depth_mm: Float32[np.ndarray, "*shape"]
    ) -> Float32[np.ndarray, "*shape"]:
        """Of distances from the entrance pupil."""
        scale, focus = np.float32(self.px_mm), np.float32(self.focus_vergence)
        radius = scale * (1 / np.maximum(depth_mm, _LEAST_MM) - focus)
        if self.most_px == np.inf:
            return radius
        return np.clip(radius, np.float32(-self.most_px), np.float32(self.most_px))

    def depth_mm(self, radius_px: float) -> float:
        """Of a radius; infinite for one that only lies beyond infinity."""
        if self.px_mm == 0:
            return np.inf
        vergence = self.focus_vergence + radius_px / self.px_mm
        return 1 / vergence if vergence > 1e-12 else np.inf
