"""Focus on the object at a pixel of the plate.

The depth of a plate is measured from the pinhole of the CG camera
(`lensfit.plate.camera.plate_state` converts it to a focus distance).
"""

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float32

from lensfit.coords import Window
from lensfit.errors import ImageError
from lensfit.io.depth_channel import (
    FoundDepth,
    depth_over_window,
    find_depth,
    perpendicular_mm,
    ray_slant,
)
from lensfit.io.exr import ExrImage, ExrPart, read_exr
from lensfit.io.exr_deep import DeepPart, is_deep, read_deep
from lensfit.plate.plate_depth import DepthOptions, depth_meaning

if TYPE_CHECKING:
    from lensfit.rendering.uv import PlateGeometry

FOCUS_AT = "--focus-at"
_REMEDY = "give --focus-at another pixel or region, or --focus-distance-mm"


def picked_region(pick: tuple[float, ...], display: Window) -> Window:
    """The pixels of a pick: the one that holds x, y, or those whose centre lies
    between x0, y0 and x1, y1, counted from the display window's corner.

    Raises
    ------
    ImageError : The region holds no pixel, or none of the display window.
    """
    if len(pick) not in (2, 4) or not all(map(math.isfinite, pick)):
        raise ImageError(
            "--focus-at is no pixel and no region", remedy="write X,Y or X0,Y0,X1,Y1"
        )
    if len(pick) == 2:
        x, y = map(math.floor, pick)
        low, high = (x, y), (x, y)
    else:
        xs, ys = sorted(pick[::2]), sorted(pick[1::2])
        low = math.ceil(xs[0] - 0.5), math.ceil(ys[0] - 0.5)
        high = math.ceil(xs[1] - 0.5) - 1, math.ceil(ys[1] - 0.5) - 1
    region = Window(
        max(low[0], 0) + display.x_min,
        max(low[1], 0) + display.y_min,
        min(high[0], display.width - 1) + display.x_min,
        min(high[1], display.height - 1) + display.y_min,
    )
    if region.width < 1 or region.height < 1:
        shown = ",".join(f"{number:g}" for number in pick)
        raise ImageError(
            f"--focus-at {shown} holds no pixel of the {display.width} x "
            f"{display.height} frame",
            remedy="count pixels from the frame's upper left corner",
        )
    return region


def picked_depth_mm(
    image: ExrImage,
    path: Path,
    pick: tuple[float, ...],
    options: DepthOptions,
    geometry: "PlateGeometry",
    focal_length_mm: float,
) -> tuple[float, tuple[str, ...]]:
    """Perpendicular distance from the pinhole of what was picked, and what was assumed:
    the median of a region, of the pixels that hold something.

    Parameters
    ----------
    image : The plate; read again if it is its header alone.
    path : Its file; a deep one is seen from the front.
    options : What the user states about depth.
    geometry, focal_length_mm : Of the plate and its CG camera, for ray distance.

    Raises
    ------
    ImageError : The plate has no depth, or only sky there.
    """
    if not any(part.channels for part in image.parts):
        image = _front(read_deep(path), options) if is_deep(path) else read_exr(path)
    beside = image.parts[0]
    found = find_depth(image, options.channel, beside)
    if found is None:
        raise ImageError(
            "has no depth channel, which --focus-at needs",
            remedy="render Z, or name its channel with --depth-channel",
        )
    region = picked_region(pick, beside.display_window)
    meaning, notes = depth_meaning(image, found, options)
    samples = depth_over_window(_cut(found, region), found.name, region)
    slant = 1.0
    if meaning.kind == "ray":
        slant = ray_slant(geometry.mm(region.pixel_centres()), focal_length_mm)
    depth = perpendicular_mm(samples, meaning, slant)
    valid = depth[np.isfinite(depth)]
    if valid.size == 0:
        what = "only sky" if np.isposinf(depth).any() else "no depth"
        shown = ",".join(f"{number:g}" for number in pick)
        raise ImageError(f"has {what} at --focus-at {shown}", remedy=_REMEDY)
    return float(np.median(valid)), notes


def _cut(found: FoundDepth, region: Window) -> ExrPart:
    """The part as far as the region needs it, with its depth alone."""
    own = found.part.data_window
    low = np.maximum(region[:2], own[:2])
    high = np.minimum(region[2:], own[2:])
    if (low > high).any():
        low, high = np.array(own[:2]), np.array(own[:2])
    rows = slice(low[1] - own.y_min, high[1] - own.y_min + 1)
    columns = slice(low[0] - own.x_min, high[0] - own.x_min + 1)
    samples = found.part.channels[found.name][rows, columns]
    window = Window(*map(int, (*low, *high)))
    return ExrPart({found.name: samples}, window, found.part.display_window, {})


def _front(deep: DeepPart, options: DepthOptions) -> ExrImage:
    """A deep plate's nearest samples that show anything, as a flat one's depth."""
    name, flat = options.channel or "Z", deep.flat
    if name not in deep.samples:
        return ExrImage((flat,))
    counts = deep.counts.ravel()
    own = np.repeat(np.arange(counts.size), counts)
    seen = np.asarray(deep.samples.get("A", np.ones(len(own)))) > 0
    samples = deep.samples[name][seen].astype(np.float32)
    meaning, _ = depth_meaning(ExrImage((flat,)), FoundDepth(flat, name), options)
    inverse = meaning.kind == "inverse"
    plane: Float32[np.ndarray, " pixels"] = np.full(counts.size, np.inf, np.float32)
    if inverse:
        plane[:] = 0
    (np.maximum if inverse else np.minimum).at(plane, own[seen], samples)
    channels = {name: plane.reshape(deep.counts.shape)}
    part = ExrPart(channels, flat.data_window, flat.display_window, flat.attributes)
    return ExrImage((part,))
