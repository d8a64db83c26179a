"""Spots: the light of one point on the sensor, and the field points that are asked.

Spots are drawn from pupil maps (`data_synth.pupilmap`) of 64 x 64 traced rays a
wavelength and integrated over the samples of an array, row 0 on top, with the green
chief ray exactly at its centre. Chief rays of a band are the mean over its wavelengths.
"""

import numpy as np
from jaxtyping import Float

from data_synth.aim import chief_landings_mm, tracer_from_object
from data_synth.lens import SetLens
from data_synth.pupilmap import PupilMap, deposit, open_bounds_mm, pupil_map
from data_synth.sensor import Band, Frame

CELLS = 64
RAY_SPACING_PX = 0.15
ACROSS = (96, 384)
SIZES = (32, 48, 64, 96, 128, 160, 192, 256, 320, 384)
"""Sides of arrays in samples: few, since a lens may be compiled for each."""
INVERSION_STEPS = 12
INVERSION_MM = 1e-4


def field_points_mm(
    lens: SetLens,
    frame: Frame,
    parts: tuple[tuple[float, ...], tuple[float, ...]],
    distance_mm: float,
) -> Float[np.ndarray, "points 3"]:
    """Object points at a distance whose green chief rays land on a grid of the frame.

    Parameters
    ----------
    parts : Columns and rows as parts of the half frame.
    """
    wanted = np.stack(np.meshgrid(*parts), -1).reshape(-1, 2)
    return object_points_mm(lens, wanted * np.array(frame.size_mm) / 2, distance_mm)


def object_points_mm(
    lens: SetLens, wanted_mm: Float[np.ndarray, "points 2"], distance_mm: float
) -> Float[np.ndarray, "points 3"]:
    """Object points at a distance whose green chief rays land at sensor positions.

    Found by correcting a first guess; a point that no ray reaches stays near its guess.
    """

    def landing_of(place_mm):
        points = np.column_stack([place_mm, np.full(len(place_mm), distance_mm)])
        return chief_landings_mm(lens, tracer_from_object(points), 540.0)

    steps = 1e-3 * distance_mm * np.array([[0.0, 0], [1, 0], [0, 1]])
    near_axis = landing_of(steps)
    sides = np.stack([near_axis[1] - near_axis[0], near_axis[2] - near_axis[0]], -1)
    object_per_mm = np.linalg.inv(sides / (1e-3 * distance_mm))
    place = (wanted_mm - near_axis[0]) @ object_per_mm.T
    for _ in range(INVERSION_STEPS):
        landing = landing_of(place)
        error = np.where(np.isfinite(landing), wanted_mm - landing, -0.05 * wanted_mm)
        if np.abs(error).max() < INVERSION_MM:
            break
        place = place + error @ object_per_mm.T
    return np.column_stack([place, np.full(len(place), distance_mm)])


def spots_of(
    wide: SetLens,
    lenses: list[SetLens],
    object_mm: Float[np.ndarray, "points 3"],
    frame: Frame,
    bands: tuple[Band, ...],
) -> tuple[Float[np.ndarray, "points 2"], list[tuple[np.ndarray, int]]]:
    """Green chief rays, and the spots of lenses that differ from `wide` by the iris.

    Returns
    -------
    chief_mm : Where the green chief rays land.
    drawn : Per lens the spots (points, 3, size, size), each summing to 1 (NaN where no
        light is), and the samples to a pixel: 4, or fewer for large spots.
    """
    chief_mm = band_chiefs_mm(wide, object_mm, bands[1])
    maps = [band_maps(wide, object_mm, band) for band in bands]
    drawn = []
    for lens in lenses:
        extent = np.stack([m.extent_mm(lens.stop) for row in maps for m in row])
        away = np.abs(extent - chief_mm[:, None]) / np.array(frame.pitch_mm)
        half_px = float(np.max(away[np.isfinite(away)], initial=1.0))
        subpixels = 4 if half_px < 24 else 2 if half_px < 64 else 1
        wanted = 2 * (half_px + 1) * subpixels
        size = next((s for s in SIZES if s >= wanted), SIZES[-1])
        pitch_mm = np.array(frame.pitch_mm) / subpixels
        spots = [
            drawn_spots(row, band, lens, chief_mm, pitch_mm, size, 1 / subpixels)
            for row, band in zip(maps, bands, strict=True)
        ]
        drawn.append((np.stack(spots, axis=1), subpixels))
    return chief_mm, drawn


def band_maps(
    lens: SetLens, object_mm: Float[np.ndarray, "points 3"], band: Band
) -> list[PupilMap]:
    """Traced pupils of object points, one for each wavelength of a band."""
    points = tracer_from_object(object_mm)
    normals = np.broadcast_to([0.0, 0.0, 1.0], points.shape)
    bounds = open_bounds_mm(lens, points)
    return [
        pupil_map(lens, points, normals, bounds, wavelength_nm, CELLS)
        for wavelength_nm in band.wavelengths_nm
    ]


def drawn_spots(
    maps: list[PupilMap],
    band: Band,
    lens: SetLens,
    centre_mm: Float[np.ndarray, "points 2"],
    pitch_mm: Float[np.ndarray, "2"],
    size: int,
    px_per_sample: float = 1.0,
) -> Float[np.ndarray, "points size size"]:
    """Spots of one band through the iris of `lens`, summing to 1; NaN without light.

    Parameters
    ----------
    maps : From `band_maps`, of this lens or of one with a wider iris.
    centre_mm : Sensor position of the centre of each array.
    pitch_mm : Of the array's samples.
    px_per_sample : Rays stand closer than a fixed part of a pixel.
    """
    spots = np.zeros((len(centre_mm), size, size))
    nowhere = np.zeros(1, int)
    for k, centre in enumerate(centre_mm):
        for one, share in zip(maps, band.weights, strict=True):
            point = one.of_point(k)
            extent = point.extent_mm(lens.stop)[0]
            if not np.isfinite(extent).all():
                continue
            spread_px = float(((extent[1] - extent[0]) / pitch_mm).max())
            spread_px *= px_per_sample
            # The iris may fill a small part of the traced box only.
            part = lens.stop.radius_mm / np.abs(point.fields[0, 2:4]).max()
            across = int(np.clip(spread_px / part / RAY_SPACING_PX, *ACROSS))
            rays = point.refined(lens.stop, across)
            lit = rays.flux > 0
            landing = np.moveaxis(rays.landing_mm, 1, -1)[lit] - centre
            width = np.moveaxis(rays.width_mm, 1, -1)[lit] / pitch_mm
            which = np.broadcast_to(nowhere, len(landing))
            place = landing / pitch_mm + size / 2
            spots[k] += deposit(
                place, width, rays.flux[lit] * share, which, (1, size, size)
            )[0]
    total = spots.sum(axis=(1, 2), keepdims=True)
    return np.where(total > 0, spots / np.maximum(total, 1e-300), np.nan)


def band_chiefs_mm(
    lens: SetLens, object_mm: Float[np.ndarray, "points 3"], band: Band
) -> Float[np.ndarray, "points 2"]:
    """Where chief rays land, mean over a band."""
    points = tracer_from_object(object_mm)
    return np.sum(
        [
            share * chief_landings_mm(lens, points, nm)
            for nm, share in zip(band.wavelengths_nm, band.weights, strict=True)
        ],
        axis=0,
    )
