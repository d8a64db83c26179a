"""Decompose a plate into surfaces, front to back, and continue what each one hides.

The depth range is cut where the plate has the fewest pixels, into slabs that blur
nearly alike. The pixels of one slab form one surface with its own distance at every
pixel, so that a floor stays a floor however many slabs it crosses. Slabs overlap a
little: beyond the cut the surface continues with its own pixels, so that no seam shows.

The background behind a slab is inpainted: slab by slab from the nearest, the front is
removed from the plate and the hole filled (`lensfit.rendering.inpainting`). Pixels that
show both sides of an outline are separated (`lensfit.rendering.outlines`).

All depths here are signed blur radii: depths that blur alike are one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import cv2
import numpy as np
from jaxtyping import Bool, Float32

from lensfit.rendering.inpainting import (
    farthest_sight_px,
    inpainted_background,
    sight_px,
)
from lensfit.rendering.outlines import outline_between, separated_near_surface
from lensfit.rendering.plate_surfaces import SharedPixels

Plane = Float32[np.ndarray, "height width"]
Colour = Float32[np.ndarray, "height width 4"]

_PARTS = 8
"""Of a slab, where a cut may lie."""
_OVERLAP = 0.5
"""Of the thickness of a slab."""
_GOING_ON_PX = 6
_ROOM_PX, _CELL_PX = 8, 16
EVEN_PX = 1e-3
"""Radii of a surface that differ by less are one."""
_SEEN = 1 / 4096
_CROSS = np.ones((3, 3), np.uint8)


@dataclass(eq=False)
class Surface:
    """One surface over a region.

    Attributes
    ----------
    rgba : Premultiplied; alpha 0 where it is not.
    radius_px : Signed radius of blur of each pixel, continued beside it.
    least_px, most_px : Of its radii.
    origin : Row and column of its first pixel; beyond its border it goes on as there.
    scale : Pixels of the plate per pixel.
    is_cubic : Whether it is read by a cubic rather than linearly.
    """

    rgba: Colour
    radius_px: Plane
    least_px: float
    most_px: float
    origin: tuple[int, int] = (0, 0)
    scale: int = 1
    is_cubic: bool = False

    @property
    def middle_px(self) -> float:
        return (self.least_px + self.most_px) / 2

    def with_middle_radius(self) -> "Surface":
        """The same, all of it blurring as its middle."""
        return replace(self, least_px=self.middle_px, most_px=self.middle_px)

    @property
    def is_even(self) -> bool:
        """Whether all of it blurs alike."""
        return self.most_px - self.least_px < EVEN_PX


@dataclass(frozen=True)
class Slabs:
    """How thick slabs of depth may be.

    Attributes
    ----------
    least_px : Thickness in focus, in radius of blur.
    growth : Thickness over radius where that is large.
    """

    least_px: float
    growth: float

    def scaled(self, radius_px: np.ndarray) -> np.ndarray:
        """Radius in thicknesses, counted from the focus."""
        return np.arcsinh(radius_px * (self.growth / self.least_px)) / self.growth

    def number_of(self, radius_px: np.ndarray) -> np.ndarray:
        """Which half of an even slab a radius lies in."""
        return np.floor(2 * self.scaled(radius_px)).astype(np.int32)

    def radius_px(self, scaled: np.ndarray) -> np.ndarray:
        """Inverse of `scaled`."""
        return self.least_px / self.growth * np.sinh(self.growth * np.asarray(scaled))

    def cuts_px(self, radius_px: Sequence[np.ndarray]) -> list[float]:
        """Radii between slabs, near to far, where few pixels lie.

        Parameters
        ----------
        radius_px : Of all that the plate shows.
        """
        scaled = np.concatenate([self.scaled(r).ravel() for r in radius_px])
        low, high = float(scaled.min()), float(scaled.max())
        parts = max(int(np.ceil((high - low) * _PARTS)), 1)
        count, edges = np.histogram(scaled, parts, (low, low + parts / _PARTS))
        cuts, first = [], parts
        while first > _PARTS:
            # The emptiest of the parts where this slab may end, the farthest of equals.
            ends = np.arange(first - _PARTS, first - _PARTS // 2)
            end = int(ends[np.argmin(count[ends])])
            if count[end:first].sum() > 0 and count[:end].sum() > 0:
                cuts.append(float(edges[end]))
            first = end
        return [float(r) for r in self.radius_px(np.array(cuts))]


def surfaces_of_plate(
    rgba: Colour,
    radius_px: Plane,
    cuts_px: Sequence[float],
    slabs: Slabs,
    guide: Colour | None = None,
    shared: SharedPixels | None = None,
) -> list[Surface]:
    """Surfaces of a flat plate, near to far.

    Parameters
    ----------
    rgba : Premultiplied, as the chief rays bring it.
    radius_px : Of what it shows.
    cuts_px : Between slabs, near to far.
    guide : The same picture with all colours where the depth is; `rgba` if None.
    shared : Pixels whose objects are known.
    """
    pictures = rgba if guide is None else np.concatenate([rgba, guide], -1)
    behind = _Behind(
        pictures.copy(),
        radius_px.copy(),
        known=np.ones(radius_px.shape, bool),
        farthest_px=float(radius_px.min()),
    )
    found = []
    for cut in cuts_px:
        front = (behind.radius_px > cut) & behind.known
        if not front.any():
            continue
        here = None
        if shared is not None:
            here, shared = _parted_by(shared, cut)
        margin = _OVERLAP * (slabs.least_px + slabs.growth * abs(cut))
        found.append(behind.taken_off(front, cut + margin, here))
    if (behind.pictures[..., 3] > 0).any():
        found.append(_surface(behind.pictures[..., :4], behind.radius_px))
    return found


@dataclass(eq=False)
class _Behind:
    """What is left of a plate when the nearest slabs are off it.

    Attributes
    ----------
    pictures : Its colours, and those of the guide where there is one.
    radius_px : Of what it shows.
    known : Where anything is known of it.
    farthest_px : The least of all radii.
    """

    pictures: Float32[np.ndarray, "height width channels"]
    radius_px: Plane
    known: Bool[np.ndarray, "height width"]
    farthest_px: float

    def taken_off(
        self,
        front: Bool[np.ndarray, "height width"],
        going_on_px: float,
        shared: SharedPixels | None,
    ) -> Surface:
        """The front by itself; what it hid is filled in here.

        Parameters
        ----------
        going_on_px : Up to this radius what lies behind goes on where the front is.
        shared : Pixels of the front and of what is behind it that are known apart.
        """
        own = self.radius_px[front]
        most, least = float(own.max()), float(own.min())
        smooth = max(abs(most), abs(least)) / 2
        widest = max(float(farthest_sight_px(most, self.farthest_px)), smooth)
        at = _box(front, shared, int(widest) + _ROOM_PX)
        source = self.known[at] & ~front[at]
        sight = sight_px(self.radius_px[at], front[at], source)
        # A part of it will do where nothing is in sight from far.
        widest = max(float(sight.max()), smooth)
        outer, at = at, _box(front, shared, int(widest) + _ROOM_PX)
        part = _within(at, outer)
        front, source, sight = front[at], source[part], sight[part]
        pictures = np.ascontiguousarray(self.pictures[at])
        radius_px = np.ascontiguousarray(self.radius_px[at])
        outline = outline_between(radius_px, front)
        if shared is not None:
            of = shared.rows - at[0].start, shared.columns - at[1].start
            outline.pixels[of], outline.front_px[of] = True, shared.front_px
        hidden = front & ~_going_on(radius_px <= going_on_px, front, outline.pixels)
        hidden |= outline.pixels
        source &= ~outline.pixels
        filled, filled_px, unknown = inpainted_background(
            pictures, radius_px, source, hidden, sight
        )
        rgba, beneath = (_colours(p, 0) for p in (pictures, filled))
        if shared is not None:
            both = (beneath[of] + shared.behind) / 2
            beneath[of] = np.where(beneath[of][:, 3:] > 0, both, shared.behind)
            filled[(*of, slice(4))] = beneath[of]
        guides = None
        if pictures.shape[-1] > 4:
            guides = _colours(pictures, 4), _colours(filled, 4)
        shown, shown_px = separated_near_surface(
            rgba, radius_px, front, outline, beneath, guides
        )
        if shared is not None:
            rest = (1 - shared.share)[:, None] * beneath[of]
            shown[of] = np.maximum(rgba[of] - rest, 0)
        found = _surface(shown, shown_px, (at[0].start, at[1].start))
        self.pictures[at], self.radius_px[at] = filled, filled_px
        self.known[at] &= ~unknown
        return found


def _colours(pictures: np.ndarray, first: int) -> Colour:
    return np.ascontiguousarray(pictures[..., first : first + 4])


def _box(
    front: np.ndarray, shared: SharedPixels | None, room: int
) -> tuple[slice, slice]:
    """Rows and columns around the front, in whole cells."""
    at = []
    for axis in (0, 1):
        where = np.flatnonzero(front.any(1 - axis))
        if shared is not None:
            where = np.concatenate([where, (shared.rows, shared.columns)[axis]])
        start, stop = int(where.min()) - room, int(where.max()) + 1 + room
        start, stop = start // _CELL_PX * _CELL_PX, -(-stop // _CELL_PX) * _CELL_PX
        at.append(slice(max(start, 0), min(stop, front.shape[axis])))
    return at[0], at[1]


def _within(at: tuple[slice, slice], outer: tuple[slice, slice]) -> tuple[slice, slice]:
    """Rows and columns of a box, counted from those of another."""
    rows, columns = (
        slice(max(inner.start - whole.start, 0), inner.stop - whole.start)
        for inner, whole in zip(at, outer, strict=True)
    )
    return rows, columns


def _parted_by(
    shared: SharedPixels, cut: float
) -> tuple[SharedPixels | None, SharedPixels]:
    """Pixels whose objects lie on both sides of a cut, and the others."""
    here = (shared.front_px > cut) & (shared.back_px <= cut)
    if not here.any():
        return None, shared
    found, others = (SharedPixels(*(p[at] for p in shared)) for at in (here, ~here))
    return found, others


def surfaces_of_layers(
    layers: Sequence[tuple[Colour, Plane]], cuts_px: Sequence[float], slabs: Slabs
) -> list[Surface]:
    """Surfaces of layers that hold what is hidden, near to far.

    Parameters
    ----------
    layers : Premultiplied and front to back, with radii.
    """
    found = []
    edges = [np.inf, *cuts_px, -np.inf]
    for nearest, farthest in pairwise(edges):
        margin = _OVERLAP * (slabs.least_px + slabs.growth * abs(nearest))
        if nearest == np.inf:
            margin = 0.0
        rgba = radius = None
        for colour, radius_px in layers:
            own = (radius_px > farthest) & (radius_px <= nearest + margin)
            own &= colour[..., 3] > 0
            if margin > 0 and own.any():
                front = (radius_px > nearest) & (colour[..., 3] > 0)
                outline = outline_between(radius_px, front).pixels
                behind = own & ~front
                own = behind | (own & _grown_into(behind, own & ~outline))
            if not own.any():
                continue
            part = np.where(own[..., None], colour, np.float32(0))
            if rgba is None:
                rgba, radius = part, radius_px.copy()
                radius[~own] = np.clip(radius[~own], farthest, nearest)
            else:
                assert radius is not None
                alone = own & (rgba[..., 3] <= 0)
                radius[alone] = radius_px[alone]
                rgba = rgba + (1 - rgba[..., 3:]) * part
        if rgba is not None and radius is not None:
            found.append(_surface(rgba, radius))
    return found


def _going_on(
    band: np.ndarray, front: np.ndarray, outline: np.ndarray
) -> Bool[np.ndarray, "height width"]:
    """Pixels before a cut on a surface that goes on behind it, near the cut."""
    may = band & ~outline
    return _grown_into(may & ~front, may)


def _grown_into(seeds: np.ndarray, may: np.ndarray) -> Bool[np.ndarray, "height width"]:
    """Pixels that may be reached from seeds in a few steps."""
    reached = seeds
    for _ in range(_GOING_ON_PX):
        reached = (cv2.dilate(reached.astype(np.uint8), _CROSS) > 0) & may
    return reached


def _surface(
    rgba: Colour, radius_px: Plane, origin: tuple[int, int] = (0, 0)
) -> Surface:
    """What is there of a part of a plate whose first pixel has this row and column."""
    there = rgba[..., 3] > _SEEN
    if not there.any():
        return Surface(rgba[:1, :1], radius_px[:1, :1], 0.0, 0.0)
    own = radius_px[there]
    least, most = float(own.min()), float(own.max())
    room = _ROOM_PX + int(max(abs(least), abs(most)) / 2)
    rows, columns = (
        _with_room(np.flatnonzero(there.any(axis)), room, there.shape[1 - axis])
        for axis in (1, 0)
    )
    return Surface(
        rgba[rows, columns].copy(),
        np.clip(radius_px[rows, columns], least, most),
        least,
        most,
        (origin[0] + rows.start, origin[1] + columns.start),
    )


def _with_room(at: np.ndarray, room: int, size: int) -> slice:
    """From the first to the last, and room around for what smooths them; whole cells,
    so that a coarse surface lies on the same squares wherever it starts."""
    start = max(int(at[0]) - room, 0) // _CELL_PX * _CELL_PX
    stop = -(-min(int(at[-1]) + 1 + room, size) // _CELL_PX) * _CELL_PX
    return slice(start, min(stop, size))
