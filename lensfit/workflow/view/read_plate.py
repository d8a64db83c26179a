"""One frame of a plate, and smaller ones for a quick look through the lens.

In a smaller one (a proxy) blocks of pixels become one: colours are averaged, and of
everything that may not be mixed (depth, ids) the middle sample is taken. Blocks are
counted from the corner of the display window; incomplete blocks at its right and lower
border are left out, so that the frame may lose a part of a proxy's pixel there.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from lensfit.coords import Window
from lensfit.errors import ImageError
from lensfit.io.exr import ExrImage, ExrPart, read_exr
from lensfit.io.exr_deep import is_deep
from lensfit.plate.apply_options import ApplyOptions
from lensfit.plate.frame.plate_views import plate_views
from lensfit.plate.plate_file import colour_layers
from lensfit.workflow.view.screen_picture import first_layer

Quality = Literal["proxy", "finer", "full"]
"""In the order of their pixels."""
MOST_PIXELS, MOST_PIXELS_OF_RAYS = 140_000, 60_000
"""Of an ideal lens, and of one whose blur is made of rays, which costs six times as
much a pixel."""
_FINER = 4
"""Times as many pixels along a side as a proxy's: some ten times its seconds."""
_MOST_FACTOR = 16


class Plate(NamedTuple):
    """One frame that was read.

    Attributes
    ----------
    image, header : Its first view, and what states its camera.
    smaller : The same with fewer pixels, by quality; none where it is small itself.
    layer : The colours that are shown.
    """

    path: Path
    image: ExrImage
    header: ExrImage
    smaller: Mapping[Quality, ExrImage]
    layer: str

    @property
    def qualities(self) -> tuple[Quality, ...]:
        """In which it can be shown, the quickest first."""
        return (*self.smaller, "full")


def read_plate(
    path: Path, options: ApplyOptions, most_pixels: int = MOST_PIXELS
) -> Plate:
    """A frame with what is shown of it.

    Parameters
    ----------
    most_pixels : Of its proxy.

    Raises
    ------
    ImageError : It cannot be read, is deep, or has no colours.
    """
    if is_deep(path):
        raise ImageError(
            "is a deep plate, which the view does not show",
            where=path,
            remedy='render it with "lensfit apply", or view a flat one',
        )
    view = plate_views(read_exr(path), path)[0]
    image = view.view.image
    wanted = None if options.layers is None else tuple(options.layers)
    layer = first_layer(image, wanted)
    if layer is None:
        raise ImageError(
            "holds no R, G, B to render", where=path, remedy="give a colour plate"
        )
    # A map from outside has the size of the plate.
    smaller = {} if options.stmap else smaller_plates(image, most_pixels)
    return Plate(path, image, view.header, smaller, layer)


def smaller_plates(image: ExrImage, most_pixels: int) -> dict[Quality, ExrImage]:
    """A plate for a quick look, and one between it and the plate, if there is room."""
    factor = proxy_factor(image.parts[0].display_window, most_pixels)
    factors: dict[Quality, int] = {"proxy": factor, "finer": factor // _FINER}
    found: dict[Quality, ExrImage] = {}
    for name, n in factors.items():
        proxy = proxy_of(image, n) if n > 1 else None
        if proxy is not None:
            found[name] = proxy
    return found


def proxy_factor(display: Window, most_pixels: int = MOST_PIXELS) -> int:
    """How many pixels of a plate lie along the side of one of its proxy; 1 where the
    plate is as small as a proxy."""
    factor = 1
    while display.area / factor**2 > most_pixels and factor < _MOST_FACTOR:
        factor *= 2
    return factor


def proxy_of(image: ExrImage, factor: int) -> ExrImage | None:
    """The plate with blocks of `factor` x `factor` pixels as one; None where a part has
    no whole block."""
    parts = [_smaller(part, factor) for part in image.parts]
    return None if None in parts else ExrImage(tuple(p for p in parts if p is not None))


def _smaller(part: ExrPart, factor: int) -> ExrPart | None:
    display, data = part.display_window, part.data_window
    low = [
        -(-(start - corner) // factor)
        for start, corner in zip(data[:2], display[:2], strict=True)
    ]
    high = [
        (end + 1 - corner) // factor - 1
        for end, corner in zip(data[2:], display[:2], strict=True)
    ]
    window = Window(*low, *high)
    if window.width < 1 or window.height < 1:
        return None
    left = low[0] * factor + display.x_min - data.x_min
    top = low[1] * factor + display.y_min - data.y_min
    rows = slice(top, top + window.height * factor)
    columns = slice(left, left + window.width * factor)
    mixed = {name for layer in colour_layers(part) for name in layer.names}
    channels = {
        name: (_mean if name in mixed else _middle)(samples[rows, columns], factor)
        for name, samples in part.channels.items()
    }
    size = Window.of_size(
        max(display.width // factor, 1), max(display.height // factor, 1)
    )
    return replace(part, channels=channels, data_window=window, display_window=size)


def _mean(samples: np.ndarray, factor: int) -> np.ndarray:
    rows, columns = (side // factor for side in samples.shape)
    blocks = samples.reshape(rows, factor, columns, factor).astype(np.float32)
    return blocks.mean(axis=(1, 3)).astype(samples.dtype)


def _middle(samples: np.ndarray, factor: int) -> np.ndarray:
    return np.ascontiguousarray(samples[factor // 2 :: factor, factor // 2 :: factor])
