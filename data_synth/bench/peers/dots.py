"""Dots of a photograph as anyone has them: small pictures, places, and what was stated.

Nothing here comes from a fit of a lens. Millimetres on the sensor, x right and y down
from its centre; cells are those of `detect.dot_images`.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from lensfit.coords import mm_from_px
from lensfit.fitting.chart_view import View
from lensfit.fitting.wavefront.dot_data import farthest_point_rows
from lensfit.fitting.wavefront.dot_patches import centroids_mm


class PicturedDots(NamedTuple):
    """The dots of one photograph whose setting was stated.

    Attributes
    ----------
    f_number, focus_distance_mm, object_distance_mm : The setting.
    focal_length_mm : As on the barrel.
    half_diagonal_mm : Of the sensor.
    place_mm : Where each dot is.
    light, use : Of every cell, and whether it may be used.
    centre_cells : Of each channel's light, x and y from the corner of the dot image.
    cell_mm : Width and height of a cell.
    hole_mm2 : Covariance of the image of a hole.
    """

    f_number: float
    focus_distance_mm: float
    object_distance_mm: float
    focal_length_mm: float
    half_diagonal_mm: float
    place_mm: Float[np.ndarray, "dots 2"]
    light: Float[np.ndarray, "dots 3 rows columns"]
    use: Bool[np.ndarray, "dots 3 rows columns"]
    centre_cells: Float[np.ndarray, "dots 3 2"]
    cell_mm: Float[np.ndarray, "2"]
    hole_mm2: Float[np.ndarray, "2 2"]


def pictured(takes: list[View]) -> list[PicturedDots]:
    """Of the takes that state f-number, focus and where the chart was."""
    return [
        _dots_of(take)
        for take in takes
        if take.dot_images is not None
        and take.f_number is not None
        and take.focus_distance_mm is not None
        and take.target_distance_mm is not None
    ]


def some_of(dots: PicturedDots, most: int) -> PicturedDots:
    """Up to `most` of them, as far from each other as can be."""
    rows = farthest_point_rows(dots.place_mm, np.arange(len(dots.place_mm)), most)
    parts = ("place_mm", "light", "use", "centre_cells")
    return dots._replace(**{name: getattr(dots, name)[rows] for name in parts})


def _dots_of(take: View) -> PicturedDots:
    cut, detections = take.dot_images, take.observations
    assert cut is not None
    assert None not in (take.f_number, take.focus_distance_mm, take.target_distance_mm)
    cell_mm = take.pixel_mm * cut.cell_px
    lattice_mm = detections.lattice[cut.marks] * np.asarray(take.pitch_mm)
    place_mm = mm_from_px(
        detections.points_px[cut.marks], detections.image_size_px, take.sensor_size_mm
    )
    hole_mm2 = _imaged(lattice_mm, place_mm, (take.mark_diameter_mm or 0.0) / 2)
    return PicturedDots(
        f_number=float(take.f_number or 0.0),
        focus_distance_mm=float(take.focus_distance_mm or 0.0),
        object_distance_mm=float(take.target_distance_mm or 0.0),
        focal_length_mm=take.focal_length_mm,
        half_diagonal_mm=float(np.hypot(*take.sensor_size_mm) / 2),
        place_mm=place_mm,
        light=np.asarray(cut.light, float),
        use=cut.valid & ~cut.clipped,
        centre_cells=centroids_mm(take, cut) / cell_mm,
        cell_mm=cell_mm,
        hole_mm2=hole_mm2,
    )


def _imaged(
    board_mm: np.ndarray, place_mm: np.ndarray, radius_mm: float
) -> Float[np.ndarray, "2 2"]:
    """Covariance of a disc of that radius as the chart is imaged: r^2/4 along each
    axis, under the affine map that the dots' places show."""
    design = np.column_stack([board_mm, np.ones(len(board_mm))])
    across = np.linalg.lstsq(design, place_mm)[0][:2]
    return radius_mm**2 / 4 * across.T @ across
