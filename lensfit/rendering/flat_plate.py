"""A flat plate with depth, after the warp and before it is blurred."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32

from lensfit.rendering.highlights import Highlights
from lensfit.rendering.layer_stack import Mattes


@dataclass(eq=False)
class FlatPlate:
    """Colours, distances and blur of every pixel.

    Attributes
    ----------
    rgba : Premultiplied, without its lights; beside it the border continues.
    depth_mm : From the entrance pupil, of all that the plate shows.
    radius_px : Of the blur, signed; under a light that of its surroundings.
    lights : Taken off the plate; None where there are none.
    guide : The colours as green's map lays them all, so that they lie on one another
        and on the depth; None where all maps are one.
    mattes : Coverage of the objects that share a pixel, where it is known.
    is_sharp : Whether no blur would be seen.
    """

    rgba: Float32[np.ndarray, "height width 4"]
    depth_mm: Float32[np.ndarray, "height width"]
    radius_px: Float32[np.ndarray, "height width"]
    lights: Highlights | None = None
    guide: Float32[np.ndarray, "height width 4"] | None = None
    mattes: Mattes | None = None
    is_sharp: bool = False

    @property
    def picture(self) -> Float32[np.ndarray, "height width 4"]:
        """With its lights."""
        if self.lights is None:
            return self.rgba
        whole = self.rgba.copy()
        whole[..., :3] += self.lights.light
        return whole
