"""Surfaces prepared for the loop over rays: smoothed to the ray spacing, downsampled,
contiguous in memory.

A ray stands for its part of the pupil, and so for a part of every surface, about
R sqrt(pi / rays) wide where the blur has radius R. Surfaces are smoothed by a Gaussian
of nearly half that; otherwise few rays would show as copies. Diffraction adds its own
width. A smoothed surface needs fewer pixels, so that wide blur costs no more than
narrow.
"""

import cv2
import numpy as np

from lensfit.rendering.gather import BLOCK, PackedSurfaces
from lensfit.rendering.ray_field import RayField
from lensfit.rendering.surfaces import Surface

_FOOTPRINT = 0.45
_LINEAR = 1 / 6
"""Variance of linear interpolation, in squares of its pixels."""
_COARSEST = 16
_SEEN = 1 / 4096


def packed_surfaces(
    surfaces: list[Surface],
    field: RayField,
    cubic_px: float = 0.0,
    *,
    smooth: bool = True,
) -> PackedSurfaces:
    """Surfaces front to back, ready to be read.

    Parameters
    ----------
    cubic_px : Blur of a smaller radius is read by a cubic, which takes nothing off.
    smooth : Whether for as many rays as the field has; else as they are.
    """
    ready = (
        [smoothed_surface(s, field, cubic_px) for s in surfaces] if smooth else surfaces
    )
    table = np.zeros((len(ready), 10), np.int32)
    radii, counts = [], []
    starts = np.zeros(3, int)
    for row, surface in zip(table, ready, strict=True):
        height, width = surface.radius_px.shape
        table_of_counts = _counts(surface)
        row[:4] = starts[0], height, width, surface.scale
        row[4] = -1 if surface.is_even else starts[1]
        row[5:7] = starts[2], table_of_counts.shape[1]
        row[7:] = surface.is_cubic, *surface.origin
        if not surface.is_even:
            radii.append(surface.radius_px.ravel())
            starts[1] += height * width
        counts.append(table_of_counts.reshape(-1, table_of_counts.shape[-1]))
        starts[0] += height * width
        starts[2] += len(counts[-1])
    none = [np.zeros(1, np.float32)]
    return PackedSurfaces(
        np.concatenate([s.rgba.reshape(-1) for s in ready]),
        np.concatenate(radii or none),
        np.concatenate(counts),
        table,
        np.array([_extent_px(s, field) for s in ready], np.float32),
    )


def _extent_px(surface: Surface, field: RayField) -> tuple[float, ...]:
    """A row of `PackedSurfaces.extent_px`."""
    ends = surface.least_px, surface.most_px
    spots = [field.spot_radius_px(r) for r in (*ends, min(max(0.0, ends[0]), ends[1]))]
    least = min(float(spot.min()) for spot in spots)
    most = max(float(spot.max()) for spot in spots)
    return surface.middle_px, *ends, least, most


def smoothed_surface(surface: Surface, field: RayField, cubic_px: float) -> Surface:
    """A surface smoothed to the spacing of the rays, and made coarse."""
    radius = float(np.median(field.spot_radius_px(surface.middle_px)))
    footprint = _FOOTPRINT * radius * (np.pi / field.rays) ** 0.5
    wanted = footprint**2 + field.diffraction_px**2
    rgba, radius_px, scale = surface.rgba, surface.radius_px, 1
    is_cubic = radius < cubic_px
    while not is_cubic and 2 * scale <= _COARSEST:
        taken = _taken(2 * scale)
        if taken > wanted:
            break
        scale *= 2
    if scale > 1:
        rgba = _shrunk(rgba, scale)
        radius_px = _shrunk_radii(surface, rgba, scale)
    own = 0.0 if is_cubic else _taken(scale)
    left = max(wanted - own, 0.0) ** 0.5 / scale
    if left > 0.05:
        rgba = cv2.GaussianBlur(rgba, (0, 0), left, borderType=cv2.BORDER_REPLICATE)
    # What smoothing adds to the second moments of the blur, rays leave to it.
    added = max(wanted - field.diffraction_px**2, own if radius > 1 else 0.0)
    share = float(np.clip(1 - 4 * added / max(radius, 1e-6) ** 2, 0.0, 1.0)) ** 0.5
    return Surface(
        np.ascontiguousarray(rgba),
        np.ascontiguousarray(radius_px) * np.float32(share),
        surface.least_px * share,
        surface.most_px * share,
        surface.origin,
        scale,
        is_cubic,
    )


def _taken(scale: int) -> float:
    """Variance of shrinking and of reading linearly, px^2."""
    return (scale**2 - 1) / 12 + _LINEAR * scale**2


def _shrunk(values: np.ndarray, scale: int) -> np.ndarray:
    """Means of squares; the border goes on to fill the last."""
    height, width = values.shape[:2]
    more = -height % scale, -width % scale
    filled = cv2.copyMakeBorder(values, 0, more[0], 0, more[1], cv2.BORDER_REPLICATE)
    size = filled.shape[1] // scale, filled.shape[0] // scale
    return cv2.resize(filled, size, interpolation=cv2.INTER_AREA)


def _shrunk_radii(surface: Surface, rgba: np.ndarray, scale: int) -> np.ndarray:
    """Means of the radii, weighed by coverage."""
    alpha = surface.rgba[..., 3]
    product = _shrunk(surface.radius_px * alpha, scale)
    cover = rgba[..., 3]
    plain = _shrunk(surface.radius_px, scale)
    return np.where(cover > _SEEN, product / np.maximum(cover, _SEEN), plain)


def _counts(surface: Surface) -> np.ndarray:
    """Summed-area table of blocks of the plate that hold anything, of those that one
    can see through, and of those with a colour below zero."""
    alpha = _blocks(surface.rgba[..., 3], surface.scale)
    darkest = _blocks(surface.rgba[..., :3].min(-1), surface.scale)
    holds = alpha.max((1, 3)) > _SEEN
    shows_through = alpha.min((1, 3)) < 1 - _SEEN
    is_negative = darkest.min((1, 3)) < 0
    rows, columns = holds.shape
    table = np.zeros((rows + 1, columns + 1, 3), np.int32)
    every = np.stack([holds, shows_through, is_negative], -1).astype(np.int32)
    table[1:, 1:] = every.cumsum(0).cumsum(1)
    return table


def _blocks(plane: np.ndarray, scale: int) -> np.ndarray:
    """Pixels of a surface by blocks of the plate: row and column of a block are axes 0
    and 2. The border goes on to fill the last."""
    side = max(BLOCK // scale, 1)
    height, width = (n * scale for n in plane.shape)
    blocks = -(-height // BLOCK), -(-width // BLOCK)
    if scale > BLOCK:
        times = scale // BLOCK
        plane = plane.repeat(times, 0).repeat(times, 1)[: blocks[0], : blocks[1]]
    else:
        more = blocks[0] * side - plane.shape[0], blocks[1] * side - plane.shape[1]
        plane = np.pad(plane, ((0, more[0]), (0, more[1])), mode="edge")
    return plane.reshape(blocks[0], side, blocks[1], side)
