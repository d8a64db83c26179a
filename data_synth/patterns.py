"""Photographs of line grids and checkerboards: one warp for each cell of the pupil.

A photograph is the sum over cells of the pupil and wavelengths of nearly sharp
pictures, each the chart seen through that one cell: from pixels to the chart. For each
the exactly traced pairs (sensor position, chart position) over the field are fitted by
a polynomial, which is evaluated at every pixel; the pattern is then averaged over the
footprint of pixel and cell on the chart in closed form. The sum of all pictures is
scaled so that an open chart has its traced irradiance.

Approximations, and how they are kept honest: (1) the polynomial's largest misfit is
returned, px; (2) the pupil is a grid of cells, each weighted by the part of it that is
open, seen through its middle, moved to where the open part lands on average and blurred
by a box of the variance of its rays, so that no steps show; (3) a rotated footprint
counts as a box of the same variance. `data_synth.dots` makes the same picture without
them, and a test compares the two.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32
from scipy.ndimage import distance_transform_edt

from data_synth.aim import (
    chief_aim_mm,
    chief_landings_mm,
    chief_rays,
    pupil_bounds_mm,
    rays_through_pupil,
    tracer_from_object,
)
from data_synth.chart import Chart, Pose, pattern_coverage
from data_synth.irradiance import open_chart_flux, white_irradiance
from data_synth.lens import SetLens
from data_synth.raymap import (
    FIELD_NODES,
    RayMap,
    Steps,
    basis,
    evaluated,
    hats,
    node_places,
)
from data_synth.sensor import Band, Frame

SUBCELLS = 5
"""Rays across a cell of the pupil grid that measure how far and where it is open."""
ROWS_AT_ONCE = 48


@dataclass(frozen=True, eq=False)
class _Field:
    """Nodes over the frame and a little beyond, on the chart and in the scene."""

    chart_mm: Float[np.ndarray, "nodes 2"]
    points_mm: Float[np.ndarray, "nodes 3"]
    normal: Float[np.ndarray, "nodes 3"]


def expose_pattern(
    lens: SetLens,
    chart: Chart,
    pose: Pose,
    frame: Frame,
    bands: tuple[Band, ...],
    *,
    pupil_cells_across: int = 7,
) -> tuple[Float[np.ndarray, "height width 3"], float]:
    """Photograph any chart; 1.0 is the brightness of an open white chart on axis.

    Parameters
    ----------
    pupil_cells_across : Cells of the pupil grid across its diameter.

    Returns
    -------
    image : Noise-free irradiance.
    misfit_px : Largest error of the interpolated ray maps, of cells of the pupil that
        are open all over the field.
    """
    image = np.zeros((frame.size_px[1], frame.size_px[0], 3))
    field = _field_over(lens, pose, frame)
    offsets_mm = _pupil_grid(lens, field, pupil_cells_across)
    misfit_px = 0.0
    whites = _whites(lens, pose, field, frame, bands)
    for channel, (band, white) in enumerate(zip(bands, whites, strict=True)):
        cells = _open_cells(lens, field, frame, offsets_mm, white.middle_nm)
        pictures = [
            picture
            for wavelength_nm, share in zip(
                band.wavelengths_nm, band.weights, strict=True
            )
            for picture in _pictures(
                lens,
                field,
                frame,
                wavelength_nm,
                share,
                cells,
                white.ray_map,
            )
        ]
        misfit_px = max(misfit_px, *(picture.misfit_px for picture in pictures))
        image[..., channel] = _render(chart, pictures, white, frame)
    return image, misfit_px


def expose_white(
    lens: SetLens, pose: Pose, frame: Frame, bands: tuple[Band, ...]
) -> Float[np.ndarray, "height width 3"]:
    """Photograph a chart that is white all over, as `expose_pattern` would."""
    field = _field_over(lens, pose, frame)
    return np.stack([w.light for w in _whites(lens, pose, field, frame, bands)], -1)


@dataclass(frozen=True, eq=False)
class _White:
    """A chart that is white all over, as one channel sees it.

    `chief` holds Chebyshev coefficients of chart X and chart Y along the chief rays
    over the frame, `right_mm` and `down_mm` how far these move from one pixel to the
    next; `light` is that of every pixel.
    """

    middle_nm: float
    ray_map: RayMap
    chief: Float[np.ndarray, "2 order order"]
    right_mm: Float[np.ndarray, "2 height width"]
    down_mm: Float[np.ndarray, "2 height width"]
    light: Float[np.ndarray, "height width"]


def _whites(
    lens: SetLens, pose: Pose, field: _Field, frame: Frame, bands: tuple[Band, ...]
) -> Iterator[_White]:
    """Of every band: what a unit of chart sends, times how much of it a pixel sees."""
    width, height = frame.size_px
    columns, slope_x = basis(np.arange(width) + 0.5, width)
    rows, slope_y = basis(np.arange(height) + 0.5, height)
    irradiance = white_irradiance(lens, pose.distance_mm, bands)
    irradiance = irradiance * np.prod(frame.pitch_mm)
    for channel, band in enumerate(bands):
        middle_nm = band.wavelengths_nm[len(band.wavelengths_nm) // 2]
        chief_px = frame.px_from_mm(chief_landings_mm(lens, field.points_mm, middle_nm))
        ray_map = RayMap(chief_px, frame.size_px)
        chief, _ = ray_map.fit(chief_px, field.chart_mm)
        right, down = (
            evaluated(chief, rows, slope_x),
            evaluated(chief, slope_y, columns),
        )
        area_mm2 = np.abs(right[0] * down[1] - right[1] * down[0])
        sent = open_chart_flux(lens, field.points_mm, field.normal, middle_nm)
        at_nodes = (sent / irradiance[channel]).reshape(FIELD_NODES[::-1])
        light = hats(FIELD_NODES[1], np.arange(height) + 0.5, height) @ at_nodes
        light = light @ hats(FIELD_NODES[0], np.arange(width) + 0.5, width).T
        yield _White(middle_nm, ray_map, chief, right, down, light * area_mm2)


def _pupil_grid(
    lens: SetLens, field: _Field, cells_across: int
) -> Float[np.ndarray, "points 2"]:
    """Points over the box that holds every field point's pupil, from its chief ray."""
    some = field.points_mm[::4]
    centre = chief_aim_mm(lens, some, 540.0)
    lower, upper = pupil_bounds_mm(lens, some, 540.0)
    low = np.nanmin(lower - centre, axis=0)
    high = np.nanmax(upper - centre, axis=0)
    steps = (np.arange(cells_across) + 0.5) / cells_across
    axes = [a + (b - a) * steps for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes), -1).reshape(-1, 2)


@dataclass(frozen=True, eq=False)
class _OpenCell:
    """A cell of the pupil grid that is open for some node of the field.

    Attributes
    ----------
    offset_mm : Of its middle, from the chief ray.
    usable : Where light passes its middle; what no light takes may land anywhere.
    opening : Which part is open.
    moved_px : Where the open part lands on average, from where the middle does.
    box_px : Sides of a box, along the sensor's axes, of the variance of its rays.
    """

    offset_mm: Float[np.ndarray, "2"]
    usable: Bool[np.ndarray, " nodes"]
    opening: Float[np.ndarray, " nodes"]
    moved_px: Float[np.ndarray, "nodes 2"]
    box_px: Float[np.ndarray, "nodes 2"]


@dataclass(frozen=True, eq=False)
class _Picture:
    """The chart through one cell of the pupil at one wavelength.

    `maps` holds Chebyshev coefficients of chart X and chart Y over the frame.
    """

    maps: Float[np.ndarray, "2 order order"]
    cell: _OpenCell
    share: float
    misfit_px: float


def _field_over(lens: SetLens, pose: Pose, frame: Frame) -> _Field:
    """Chart points whose chief rays land on a regular grid over the enlarged frame.

    Found by correcting a pinhole guess a few times; they need not be exact.
    """
    axes = [node_places(n) for n in FIELD_NODES]
    wanted = np.stack(np.meshgrid(*axes), -1).reshape(-1, 2)
    wanted = wanted * np.array(frame.size_mm) / 2
    step = 10.0 * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    object_mm, _ = pose.placed(step)
    landing = chief_landings_mm(lens, tracer_from_object(object_mm), 540.0)
    sides = np.stack([landing[1] - landing[0], landing[2] - landing[0]], -1)
    chart_per_mm = np.linalg.inv(sides / 10.0)
    chart_mm = (wanted - landing[0]) @ chart_per_mm.T
    for _ in range(6):
        object_mm, _ = pose.placed(chart_mm)
        landing = chief_landings_mm(lens, tracer_from_object(object_mm), 540.0)
        error = np.where(np.isfinite(landing), wanted - landing, -0.05 * wanted)
        chart_mm = chart_mm + error @ chart_per_mm.T
    object_mm, normal = pose.placed(chart_mm)
    return _Field(chart_mm, tracer_from_object(object_mm), tracer_from_object(normal))


def _open_cells(
    lens: SetLens, field: _Field, frame: Frame, offsets_mm, wavelength_nm: float
) -> list[_OpenCell]:
    """The cells of the pupil grid that are open, seen from every node."""
    across = round(np.sqrt(len(offsets_mm)))
    cell_mm = np.ptp(offsets_mm, axis=0) / (across - 1)
    steps = (np.arange(SUBCELLS) + 0.5) / SUBCELLS - 0.5
    fine = np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2) * cell_mm
    centre, chief_mm = chief_rays(lens, field.points_mm, wavelength_nm)
    chief_px = frame.px_from_mm(chief_mm)
    points = np.repeat(field.points_mm, len(fine), axis=0)
    cells = []
    for offset in offsets_mm:
        pupil = (centre[:, None] + offset + fine).reshape(-1, 2)
        traced, _ = rays_through_pupil(lens, points, pupil, wavelength_nm)
        passed = traced.passed.reshape(-1, len(fine))
        if passed.any():
            landed_px = frame.px_from_mm(-traced.landing_mm).reshape(*passed.shape, 2)
            off_px = landed_px - chief_px[:, None]
            cells.append(_open_cell(offset, off_px, passed))
    return cells


def _open_cell(
    offset_mm: Float[np.ndarray, "2"],
    off_px: Float[np.ndarray, "nodes rays 2"],
    passed: Bool[np.ndarray, "nodes rays"],
) -> _OpenCell:
    """From where its rays land, from the chief ray."""
    middle = passed.shape[1] // 2
    mean_px, variance = _mean_and_variance(off_px, passed)
    usable = passed[:, middle]
    moved_px = mean_px - _nearest_known(off_px[:, middle], usable)
    return _OpenCell(
        offset_mm,
        usable,
        passed.mean(1),
        np.where(passed.any(1, keepdims=True), moved_px, 0.0),
        # Rays at the middles of smaller cells spread less than the light between.
        np.sqrt(12 * variance * SUBCELLS**2 / (SUBCELLS**2 - 1)),
    )


def _mean_and_variance(
    rays: Float[np.ndarray, "nodes rays 2"], passed: Bool[np.ndarray, "nodes rays"]
) -> tuple[Float[np.ndarray, "nodes 2"], Float[np.ndarray, "nodes 2"]]:
    """Of the rays that passed; zero where none did."""
    count = np.maximum(passed.sum(1), 1)[:, None]
    mean = np.where(passed[..., None], rays, 0.0).sum(1) / count
    off = np.where(passed[..., None], rays - mean[:, None], 0.0)
    return mean, (off**2).sum(1) / count


def _nearest_known(
    values: Float[np.ndarray, "nodes 2"], known: Bool[np.ndarray, " nodes"]
) -> Float[np.ndarray, "nodes 2"]:
    """Every node's own value where it is known, else the nearest node's, else zero."""
    if not known.any():
        return np.zeros_like(values)
    unknown = ~known.reshape(FIELD_NODES[::-1])
    rows, columns = np.asarray(
        distance_transform_edt(unknown, return_distances=False, return_indices=True)
    )
    return values[(rows * FIELD_NODES[0] + columns).reshape(-1)]


def _pictures(
    lens, field: _Field, frame, wavelength_nm, share, cells, ray_map
) -> list[_Picture]:
    """One picture for every cell of the pupil that is open somewhere."""
    centre, chief_mm = chief_rays(lens, field.points_mm, wavelength_nm)
    chief_px = frame.px_from_mm(chief_mm)
    pictures = []
    for cell in cells:
        traced, _ = rays_through_pupil(
            lens, field.points_mm, centre + cell.offset_mm, wavelength_nm
        )
        off_px = frame.px_from_mm(-traced.landing_mm) - chief_px
        usable = cell.usable & np.isfinite(off_px).all(-1)
        landing_px = chief_px + _nearest_known(off_px, usable)
        chart_maps, misfit_px = ray_map.fit(landing_px, field.chart_mm)
        # At the rim a map bends where the cell closes: that is no misfit of light.
        pictures.append(
            _Picture(chart_maps, cell, share, misfit_px if usable.all() else 0.0)
        )
    return pictures


def _render(chart, pictures, white: _White, frame) -> Float[np.ndarray, "h w"]:
    """The weighted sum of all pictures, brightened as an open chart would be.

    Chart positions are the chief ray's, exact at every pixel, plus each picture's small
    departure from it, which is interpolated linearly from every `STEP_PX`-th pixel.
    """
    width, height = frame.size_px
    columns, _ = basis(np.arange(width) + 0.5, width)
    rows, _ = basis(np.arange(height) + 0.5, height)
    chief_mm = evaluated(white.chief, rows, columns)
    across, upright = (
        Steps(size, nodes)
        for size, nodes in zip(frame.size_px, FIELD_NODES, strict=True)
    )
    picture = np.zeros((height, width))
    weight = np.full((height, width), 1e-12)
    for one in pictures:
        coarse = _coarse_planes(one, white, across, upright)
        for top in range(0, height, ROWS_AT_ONCE):
            rows_here = slice(top, top + ROWS_AT_ONCE)
            planes = across.between(upright.between(coarse, 1, rows_here), 2)
            departure_mm, box_mm, share = _seen_from(planes, white, rows_here)
            chart_mm = _chart_points(chief_mm[:, rows_here] + departure_mm)
            seen = pattern_coverage(chart, chart_mm, _chart_points(box_mm))
            picture[rows_here] += share * seen
            weight[rows_here] += share
    # Single precision may leave the dark a hair below zero.
    return np.maximum(white.light * picture / weight, 0.0)


def _coarse_planes(
    one: _Picture, white: _White, across: Steps, upright: Steps
) -> Float[np.ndarray, "7 steps_y steps_x"]:
    """Departure from the chief ray on the chart, and the cell's move, box and share."""
    departure_mm = evaluated(one.maps - white.chief, upright.basis, across.basis)
    cell = one.cell
    of_cell = np.column_stack([cell.moved_px, cell.box_px, one.share * cell.opening])
    at_nodes = of_cell.T.reshape(-1, *FIELD_NODES[::-1])
    return np.concatenate([departure_mm, upright.hats @ at_nodes @ across.hats.T])


def _seen_from(
    planes: Float[np.ndarray, "7 rows width"], white: _White, rows: slice
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where on the chart pixels look, from the chief ray, over which box, and how much
    of their light it is."""
    departure_mm, moved_px, box_px, (share,) = np.split(planes, (2, 4, 6))
    right_mm, down_mm = white.right_mm[:, rows], white.down_mm[:, rows]
    # Light that lands farther to the right comes from farther left.
    departure_mm = departure_mm - right_mm * moved_px[0] - down_mm * moved_px[1]
    box_px = np.hypot(1.0, box_px)
    return departure_mm, np.hypot(right_mm * box_px[0], down_mm * box_px[1]), share


def _chart_points(
    planes: Float[np.ndarray, "2 rows width"],
) -> Float32[np.ndarray, "rows width 2"]:
    """X and Y last and in single precision, as patterns take them."""
    return np.moveaxis(planes, 0, -1).astype(np.float32)
