"""One decoded photograph: scene-linear pixels and what is known about them.

Whatever the file's encoding was, `pixels` are proportional to the light that fell on
the sensor. Row 0 is on top; pixel (column 0, row 0) covers [0, 1) x [0, 1).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float


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
    chroma_subsampled : Red and blue were stored at lower resolution (4:2:0, 4:2:2).
    metadata : What the header or EXIF says, by lensfit's own key names.
    """

    pixels: Float[np.ndarray, "height width channels"]
    path: Path
    sha256: str
    encoding: str = "linear"
    saturation: float = float("inf")
    quantisation_step: float = 0.0
    chroma_subsampled: bool = False
    metadata: Mapping[str, object] = field(default_factory=dict)

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height, pixels."""
        return self.pixels.shape[1], self.pixels.shape[0]

    @property
    def luminance_channel(self) -> Float[np.ndarray, "height width"]:
        """The channel positions refer to: green, or the only one."""
        return self.pixels[..., 1 if self.pixels.shape[2] == 3 else 0]
