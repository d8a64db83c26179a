"""A flat plate with depth, after the warp and before it is blurred.

Where a Cryptomatte knows which objects of different depth share a pixel, each object's
depth and colour beside it are those of its own pixels nearby, weighted towards those
that it fills; the coverage says how much of the pixel it has.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Int

from lensfit.coords import Window
from lensfit.rendering.buffers import crop
from lensfit.rendering.highlights import Highlights
from lensfit.rendering.layer_stack import Mattes
from lensfit.rendering.outlines import STEP_GROWTH, STEP_PX

_LEAST_SHARE = 0.02
_NEAR = 2


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


class SharedPixels(NamedTuple):
    """Pixels that two objects of different depth share.

    Attributes
    ----------
    rows, columns : Which.
    share : Of the pixel that the nearer one covers.
    front_px, back_px : Radius of blur of both.
    behind : Colour of the farther one.
    """

    rows: Int[np.ndarray, " n"]
    columns: Int[np.ndarray, " n"]
    share: Float32[np.ndarray, " n"]
    front_px: Float32[np.ndarray, " n"]
    back_px: Float32[np.ndarray, " n"]
    behind: Float32[np.ndarray, "n 4"]


def shared_pixels(plate: FlatPlate, window: Window, region: Window) -> SharedPixels:
    """Of a part of a plate that has mattes."""
    assert plate.mattes is not None
    rgba, radius_px = (crop(p, window, region) for p in (plate.rgba, plate.radius_px))
    mattes = Mattes(
        np.stack([crop(ids, window, region) for ids in plate.mattes.ids[:2]]),
        np.stack([crop(c, window, region) for c in plate.mattes.coverage[:2]]),
    )
    rows, columns = np.nonzero(mattes.coverage[1] > _LEAST_SHARE)
    first, second = (
        _object_around_pixels(rgba, radius_px, mattes, r, rows, columns) for r in (0, 1)
    )
    near_first = first[0] > second[0]
    front_px = np.where(near_first, first[0], second[0])
    back_px = np.where(near_first, second[0], first[0])
    cover = mattes.coverage[:2, rows, columns]
    share = np.where(near_first, cover[0], cover[1]) / np.maximum(cover.sum(0), 1e-3)
    behind = np.where(near_first[:, None], second[1], first[1])
    apart = front_px - back_px > STEP_PX + STEP_GROWTH * np.abs(front_px)
    keep = apart & (first[2] > 0) & (second[2] > 0)
    found = rows, columns, share, front_px, back_px, behind
    return SharedPixels(*(part[keep].astype(part.dtype) for part in found))


def _object_around_pixels(
    rgba: Float32[np.ndarray, "height width 4"],
    radius_px: Float32[np.ndarray, "height width"],
    mattes: Mattes,
    rank: int,
    rows: np.ndarray,
    columns: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Radius, colour and weight of the object of one rank, around each pixel."""
    wanted = mattes.ids[rank, rows, columns]
    radius = np.zeros(len(rows), np.float32)
    colour, weight = np.zeros((len(rows), 4), np.float32), np.zeros_like(radius)
    colours, radii = rgba.reshape(-1, 4), radius_px.ravel()
    first, covers = mattes.ids[0].ravel(), mattes.coverage[0].ravel()
    for dy, dx, at in _around(rows, columns, radius_px.shape):
        pure = np.square(np.square(np.maximum(covers[at] - 0.5, 0.01)))
        w = pure * (first[at] == wanted) / np.float32(1 + (dy * dy + dx * dx) / 2)
        radius += w * radii[at]
        colour += w[:, None] * colours.take(at, 0)
        weight += w
    total = np.maximum(weight, 1e-20)
    return radius / total, colour / total[:, None], weight


def _around(
    rows: np.ndarray, columns: np.ndarray, shape: tuple[int, ...]
) -> Iterator[tuple[int, int, np.ndarray]]:
    """Offsets to the neighbours of some pixels, and where they lie in a flat plane."""
    reach = range(-_NEAR, _NEAR + 1)
    across = [np.clip(columns + dx, 0, shape[1] - 1) for dx in reach]
    for dy in reach:
        down = np.clip(rows + dy, 0, shape[0] - 1) * shape[1]
        for dx, column in zip(reach, across, strict=True):
            yield dy, dx, down + column
