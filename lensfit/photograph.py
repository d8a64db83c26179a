"""One decoded photograph: scene-linear pixels and what is known about them.

Whatever the file's encoding was, `pixels` are proportional to the light that fell on
the sensor. Row 0 is on top; pixel (column 0, row 0) covers [0, 1) x [0, 1).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from lensfit.mosaic import Mosaic, cropped_mosaic


@dataclass(frozen=True, eq=False)
class Photograph:
    """A photograph decoded to scene-linear light.

    Attributes
    ----------
    pixels : float32, scene-linear; one channel, or three in the order r, g, b.
    path : The file it came from.
    sha256 : Hash of that file, hexadecimal.
    encoding : How it was decoded: "linear", "srgb", "logc3", ...
    saturation : Scene-linear value at and above which a sample is clipped; infinity
        when neither encoding nor pixels show a ceiling.
    quantisation_step : Largest scene-linear step between two codes near mid-grey;
        0 for floating point.
    chroma_subsampled : Red and blue were stored at lower resolution (4:2:0, 4:2:2);
        `pixels` have most of what that lost again (`chroma`).
    metadata : What the header or EXIF says, by lensfit's own key names.
    mosaic : Which channel each pixel measured; the others were interpolated. None where
        every pixel measured every channel, or nobody knows.
    """

    pixels: Float[np.ndarray, "height width channels"]
    path: Path
    sha256: str
    encoding: str = "linear"
    saturation: float = float("inf")
    quantisation_step: float = 0.0
    chroma_subsampled: bool = False
    metadata: Mapping[str, object] = field(default_factory=dict)
    mosaic: Mosaic | None = None

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height, pixels."""
        return self.pixels.shape[1], self.pixels.shape[0]

    @property
    def is_linear(self) -> bool:
        """Whether the file holds what the sensor saw, and no picture made of it."""
        return self.encoding == "linear"

    @property
    def luminance_channel(self) -> Float[np.ndarray, "height width"]:
        """The channel positions refer to: green, or the only one."""
        return self.pixels[..., self.luminance_index]

    @property
    def luminance_index(self) -> int:
        """Which channel positions refer to."""
        return 1 if self.pixels.shape[2] == 3 else 0

    def cropped(self, x0: int, y0: int, x1: int, y1: int) -> "Photograph":
        """The part from column x0 and row y0 up to column x1 and row y1."""
        mosaic = self.mosaic and cropped_mosaic(self.mosaic, x0, y0)
        pixels = np.ascontiguousarray(self.pixels[y0:y1, x0:x1])
        return replace(self, pixels=pixels, mosaic=mosaic)
