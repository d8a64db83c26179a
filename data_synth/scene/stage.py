"""The room in front of a lens that a scene is drawn into, measured as it looks.

Depths are chosen by blur: a layer's blur on the sensor is proportional to how far its
inverse depth is from that of the focus, so depths are drawn in that scale. Sizes are in
frame heights at each depth.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from data_synth.scene.layers import Layer, Plane
from data_synth.scene.paints import Colour, Paint, Product, Waves
from data_synth.scene.plates import PinholeCamera
from data_synth.scene.shapes import Shape

NEAREST_PART = 0.45
"""Of the focus depth: nothing that is drawn before the focus stands nearer."""
LARGEST_BLUR = 0.075
"""Diameter of the blur of the nearest layer, in frame heights, at most."""
ROWS = 540
"""Thin and small things are sized in rows of a frame of this many."""
LIGHT_WAVES = 3
LIGHT_AMPLITUDE = 0.08


@dataclass(frozen=True, eq=False)
class Stage:
    """The room in front of a lens, and the random numbers that furnish it.

    Attributes
    ----------
    focus_mm : Depth of the focus.
    blur_per_inverse_mm : Blur diameter in frame heights, for a distance of 1/mm between
        inverse depths.
    """

    camera: PinholeCamera
    focus_mm: float
    blur_per_inverse_mm: float
    rng: np.random.Generator

    def nearer(self, part: float) -> float:
        """Depth before the focus whose blur is this part of the largest."""
        blur = LARGEST_BLUR / self.blur_per_inverse_mm
        largest = min(blur, (1 / NEAREST_PART - 1) / self.focus_mm)
        return 1 / (1 / self.focus_mm + part * largest)

    def farther(self, part: float) -> float:
        """Depth behind the focus whose blur is this part of that of infinity."""
        return self.focus_mm / (1 - part)

    def height_mm(self, depth_mm: float) -> float:
        """What the frame's height shows at a depth."""
        frame = self.camera.frame
        return frame.size_mm[1] * depth_mm / self.camera.focal_length_mm

    def row_mm(self, depth_mm: float) -> float:
        """A small length at a depth: one of 540 rows of the frame."""
        return self.height_mm(depth_mm) / ROWS

    @property
    def half_width(self) -> float:
        """From the axis to the plate's side, in frame heights."""
        width, height = self.camera.frame.size_px
        return width / height * (0.5 + self.camera.margin_px[0] / width)

    def places(self, count: int, reach: float = 1.0) -> Float[np.ndarray, "count 2"]:
        """Random places over the plate, in frame heights."""
        half = np.array([self.half_width, 0.55])
        return self.rng.uniform(-1, 1, (count, 2)) * half * reach

    def colour(self, low: float = 0.08, high: float = 0.8) -> Colour:
        """A random colour, not too saturated."""
        grey, tint = self.rng.uniform(low, high), self.rng.uniform(0.55, 1.25, 3)
        red, green, blue = np.clip(grey * tint, 0.01, 0.95).tolist()
        return red, green, blue

    def lit_layer(
        self, name: str, plane: Plane, shape: Shape, paint: Paint, opacity: float = 1.0
    ) -> Layer:
        """A layer in light that varies smoothly over it, by about a tenth."""
        unit = self.height_mm(plane.origin_mm[2])
        vectors = self.rng.normal(0, 9, (LIGHT_WAVES, 2)) / unit
        phases = self.rng.uniform(0, 2 * np.pi, LIGHT_WAVES)
        amplitude = np.full((LIGHT_WAVES, 3), LIGHT_AMPLITUDE)
        light = Waves((1.0, 1.0, 1.0), vectors, phases, amplitude)
        return Layer(name, plane, shape, Product(paint, light), opacity)
