"""Plates whose data window is smaller than the frame: elements of a composite, regions.

Outside a data window a picture is empty, not unknown (OpenEXR, "Technical
Introduction"). So an element needs no overscan on the sides where its window ends
inside the frame, and its result is no larger than its light: the warped window of its
pixels, grown by their blur.
"""

import math
from collections.abc import Iterable
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float32, Num

from lensfit.coords import Window
from lensfit.rendering.filters import Filter, first_tap
from lensfit.rendering.layer_stack import LayerStack, Mattes
from lensfit.rendering.render_stages import Stages

_FAR_PX = 1 << 30
_UNSEEN = 1e-3
"""Of the tolerance: less light than that, absolute, ends a window."""
_RING_PX = 4
_SPARE, _SPARE_PX = 2.0, 16
"""Blur is wider than its circle of confusion by what the lens' aberrations add."""


def is_tight(data_window: Window, display_window: Window) -> bool:
    """Whether a plate ends inside its frame, on any side."""
    return data_window.joined(display_window) != data_window


def known_window(data_window: Window, display_window: Window) -> Window:
    """Where a plate is known: without end on the sides where it ends inside the frame,
    since it is empty there."""
    a, b = data_window, display_window
    return Window(
        -_FAR_PX if a.x_min > b.x_min else a.x_min,
        -_FAR_PX if a.y_min > b.y_min else a.y_min,
        _FAR_PX if a.x_max < b.x_max else a.x_max,
        _FAR_PX if a.y_max < b.y_max else a.y_max,
    )


class EmptyRing(NamedTuple):
    """Empty pixels about a plate that ends inside its frame, so that the warp's filter
    reads emptiness there and not the plate's last pixels again.

    Attributes
    ----------
    inner, outer : Data window of the plate, and with the ring.
    """

    inner: Window
    outer: Window

    @classmethod
    def about(cls, data_window: Window, display_window: Window) -> "EmptyRing":
        """As wide as any filter reads, on the sides that end inside the frame."""
        known = known_window(data_window, display_window)
        wide = data_window.grown(_RING_PX, _RING_PX)
        return cls(data_window, wide.common(known) or data_window)

    def empty(self, samples: Num[np.ndarray, "..."], axis: int = 0) -> np.ndarray:
        """Samples with zeros about them.

        Parameters
        ----------
        axis : Of the rows; columns follow.
        """
        return self._padded_samples(samples, axis, "constant")

    def continued(self, depth_mm: Num[np.ndarray, "..."], axis: int = 0) -> np.ndarray:
        """Distances with the outermost ones about them: emptiness has none."""
        return self._padded_samples(depth_mm, axis, "edge")

    def about_layers(self, stack: LayerStack) -> LayerStack:
        """Layers with emptiness about them."""
        return LayerStack(self.empty(stack.rgba, 1), self.continued(stack.depth_mm, 1))

    def about_mattes(self, mattes: Mattes) -> Mattes:
        """Mattes with nobody about them."""
        return Mattes(self.empty(mattes.ids, 1), self.empty(mattes.coverage, 1))

    def _padded_samples(
        self, samples: np.ndarray, axis: int, mode: Literal["constant", "edge"]
    ) -> np.ndarray:
        a, b = self.inner, self.outer
        if a == b:
            return samples
        width = [(0, 0)] * samples.ndim
        width[axis] = (a.y_min - b.y_min, b.y_max - a.y_max)
        width[axis + 1] = (a.x_min - b.x_min, b.x_max - a.x_max)
        return np.pad(samples, width, mode)


def reached_window(
    stages: Stages, data_window: Window, window: Window, method: Filter, blur_px: float
) -> Window | None:
    """The part of `window` that light of a plate can come to; None if there is none.

    Parameters
    ----------
    stages : Maps, over `window` or more.
    data_window : Of the plate.
    method : Filter of the warp.
    blur_px : Radius of the widest circle of confusion.
    """
    taps = 1 - first_tap(method)
    found: Window | None = None
    for source_map in {id(m): m for m in stages.maps}.values():
        x, y = np.moveaxis(source_map.cropped(window).positions_px(), -1, 0)
        lit = (x >= data_window.x_min - taps) & (x <= data_window.x_max + 1 + taps)
        lit &= (y >= data_window.y_min - taps) & (y <= data_window.y_max + 1 + taps)
        own = _bounds(lit, window)
        if own is not None:
            found = own if found is None else found.joined(own)
    if found is None or blur_px == 0:
        return found
    margin = math.ceil(_SPARE * blur_px) + _SPARE_PX
    return found.grown(margin, margin).common(window)


def lit_window(
    pictures: Iterable[Float32[np.ndarray, "height width channels"]],
    window: Window,
    tolerance: float,
) -> Window | None:
    """The part of `window` where any of the pictures over it holds light or coverage;
    None if there is none."""
    lit = np.zeros((window.height, window.width), bool)
    for picture in pictures:
        lit |= ~(np.abs(picture) <= _UNSEEN * tolerance).all(-1)
    return _bounds(lit, window)


def first_pixel(window: Window) -> Window:
    """Stands for no pixel at all, which a file cannot hold."""
    return Window(window.x_min, window.y_min, window.x_min, window.y_min)


def _bounds(lit: np.ndarray, window: Window) -> Window | None:
    """The smallest window about pixels of `window`."""
    rows, columns = (np.flatnonzero(lit.any(axis)) for axis in (1, 0))
    if not rows.size:
        return None
    return Window(
        window.x_min + int(columns[0]),
        window.y_min + int(rows[0]),
        window.x_min + int(columns[-1]),
        window.y_min + int(rows[-1]),
    )
