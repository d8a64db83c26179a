"""Detections in one channel and in green, from which lateral colour is measured.

Chromatic coma biases centroids at wide apertures. Centroids are therefore used only at
the smallest aperture with enough detections, where the bias is least. Detections that
were moved to chief rays are used at every aperture; the subtracted bias has errors of
the wavefront, which move detections of all apertures and focus distances together.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from lensfit.coords import mm_from_px
from lensfit.detect.observations import POINT, Observations
from lensfit.fitting.chart_view import View
from lensfit.fitting.view_stack import variance_of

FEWEST_DETECTIONS = 40

LeftOut = Callable[[Observations], Bool[np.ndarray, " detections"]]
"""Which detections a fit does without."""


def overlapping_or_saturated(o: Observations) -> Bool[np.ndarray, " detections"]:
    """Detections that overlap a neighbour or hold a saturated pixel."""
    return o.overlapping | o.saturated


def overlapping(o: Observations) -> Bool[np.ndarray, " detections"]:
    """Detections that overlap a neighbour."""
    return o.overlapping


class ColouredDetections(NamedTuple):
    """Detections seen in one channel and in green.

    Attributes
    ----------
    place_mm : From the principal point.
    moved_mm : From where green is.
    normal : Of lines; NaN for points.
    variance_mm2 : Of the displacement; of a line, along its normal.
    pixel_mm : Width of a pixel.
    shared_mm : How displacements move together.
    by_colour_mm : How they move by the wavefront's terms of colour.
    take : Which photograph each detection is on.
    colour_orders : Of the terms of colour.
    """

    place_mm: Float[np.ndarray, "detections 2"]
    moved_mm: Float[np.ndarray, "detections 2"]
    normal: Float[np.ndarray, "detections 2"]
    variance_mm2: Float[np.ndarray, " detections"]
    pixel_mm: Float[np.ndarray, " detections"]
    shared_mm: Float[np.ndarray, "detections moves 2"]
    by_colour_mm: Float[np.ndarray, "detections terms 2"]
    take: Int[np.ndarray, " detections"]
    colour_orders: tuple[int, ...]


def colour_takes(takes: tuple[View, ...], left_out: LeftOut) -> list[View]:
    """The takes at the smallest aperture that has enough detections in colour, and all
    that have detections at chief rays."""
    coloured = [t for t in takes if np.isfinite(t.observations.channel_points_px).any()]
    least = _views_at_smallest_aperture(coloured, left_out)
    return [t for t in coloured if t.chief_rays or any(t is one for one in least)]


def _views_at_smallest_aperture(coloured: list[View], left_out: LeftOut) -> list[View]:
    for number in sorted({t.f_number or 0.0 for t in coloured}, reverse=True):
        takes_there = [t for t in coloured if (t.f_number or 0.0) == number]
        usable = sum(_usable(t.observations, left_out) for t in takes_there)
        if usable >= FEWEST_DETECTIONS:
            return takes_there
    return coloured


def _usable(o: Observations, left_out: LeftOut) -> int:
    """How many detections are seen in all three channels."""
    seen = np.isfinite(o.channel_points_px).all((0, 2))
    return int((seen & ~left_out(o)).sum())


def detections_of(
    take: View, index: int, left_out: LeftOut, centre_mm: Float[np.ndarray, "2"]
) -> ColouredDetections:
    """Of the channel `index` in one take."""
    o = take.observations
    places = o.channel_points_px
    keep = np.isfinite(places[index]).all(-1) & np.isfinite(places[1]).all(-1)
    keep &= ~left_out(o)
    mm_per_px = take.sensor_size_mm[0] / o.image_size_px[0]
    moved = (places[index] - places[1])[keep] * mm_per_px
    covariance = (o.channel_covariance_px2[index] + o.channel_covariance_px2[1])[keep]
    normal = np.where((o.family != POINT)[:, None], o.normal, np.nan)[keep]
    green = mm_from_px(places[1][keep], o.image_size_px, take.sensor_size_mm)

    def of_detections(
        moves_mm: Float[np.ndarray, "moves 3 detections 2"] | None,
    ) -> np.ndarray:
        if moves_mm is None:
            return np.zeros((len(moved), 0, 2))
        by_channel = moves_mm[:, :, keep]
        return (by_channel[:, index] - by_channel[:, 1]).swapaxes(0, 1)

    return ColouredDetections(
        place_mm=green - centre_mm,
        moved_mm=moved,
        normal=normal,
        variance_mm2=variance_of(covariance, normal) * mm_per_px**2,
        pixel_mm=np.full(len(moved), mm_per_px),
        shared_mm=of_detections(take.shared_moves_mm),
        by_colour_mm=of_detections(take.colour_moves_mm),
        colour_orders=take.colour_orders,
        take=np.zeros(len(moved), int),
    )


def joined_detections(seen: list[ColouredDetections]) -> ColouredDetections:
    """Of all takes; moves that a take lacks are zero there."""
    shared = with_as_many_columns([detections.shared_mm for detections in seen])
    by_colour = with_as_many_columns([detections.by_colour_mm for detections in seen])
    alike = [
        detections._replace(
            shared_mm=shared[k],
            by_colour_mm=by_colour[k],
            take=np.full(len(detections.take), k),
        )
        for k, detections in enumerate(seen)
    ]
    orders = max((detections.colour_orders for detections in seen), key=len)
    joined = [
        np.concatenate([getattr(detections, name) for detections in alike])
        for name in ColouredDetections._fields
        if name != "colour_orders"
    ]
    return ColouredDetections(*joined, colour_orders=orders)


def with_as_many_columns(
    moves: Sequence[Float[np.ndarray, "rows columns *shape"]],
) -> list[Float[np.ndarray, "rows most *shape"]]:
    """Each with as many columns as that with the most; zeros, where it lacks them."""
    most = max(one.shape[1] for one in moves)
    beside = [(0, 0)] * (moves[0].ndim - 2)
    return [np.pad(one, [(0, 0), (0, most - one.shape[1]), *beside]) for one in moves]
