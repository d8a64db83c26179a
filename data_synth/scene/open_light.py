"""Irradiance on the sensor when everything before the lens has radiance 1.

The integral of cos^4 du dv over the slopes u, v from which light reaches a point of the
sensor: vignetting and natural fall-off, traced. The opening is an intersection of
nearly round apertures and so is convex; along each azimuth from its middle the edge is
found by bisection, and 1/2 r^2 cos^4 is summed over azimuths, with the cosine at two
Gauss nodes in r^2. Terms odd in r cancel about the middle of the opening. A test holds
it to brute force within 1e-3.
"""

import numpy as np
from jaxtyping import Float
from scipy.interpolate import RectBivariateSpline

from data_synth.scene.backward import SCAN_RADII, BackwardLens
from data_synth.sensor import Band, Frame

LIGHT_NODES = (25, 19)
AZIMUTHS = 64
BISECTIONS = 9
CELLS = 20
GAUSS_NODES = (0.5 - 0.5 / np.sqrt(3), 0.5 + 0.5 / np.sqrt(3))
"""Parts of r^2, each of half the weight."""


def axis_irradiance(backward: BackwardLens, band: Band) -> float:
    """Irradiance in the middle of the sensor: what a value of 1 means."""
    return float(irradiance_at(backward, np.zeros((1, 2)), band)[0])


def open_irradiance(
    backward: BackwardLens, frame: Frame, band: Band
) -> Float[np.ndarray, "height width"]:
    """Irradiance of every pixel: traced at grid nodes, cubics between them."""
    x_mm, y_mm = (
        np.linspace(-0.5, 0.5, n) * size
        for n, size in zip(LIGHT_NODES, frame.size_mm, strict=True)
    )
    nodes_mm = np.stack(np.meshgrid(x_mm, y_mm), -1).reshape(-1, 2)
    light = irradiance_at(backward, nodes_mm, band).reshape(LIGHT_NODES[::-1])
    smooth = RectBivariateSpline(y_mm, x_mm, light)
    width, height = frame.size_px
    diagonal = np.arange(max(width, height)) + 0.5
    centre_mm = frame.mm_from_px(np.stack([diagonal, diagonal], -1))
    return np.maximum(smooth(centre_mm[:height, 1], centre_mm[:width, 0]), 0.0)


def irradiance_at(
    backward: BackwardLens, sensor_mm: Float[np.ndarray, "points 2"], band: Band
) -> Float[np.ndarray, " points"]:
    """Irradiance at upright sensor positions, mean over a band; 0 in the dark."""
    light = np.zeros(len(sensor_mm))
    for wavelength_nm, weight in zip(band.wavelengths_nm, band.weights, strict=True):
        middle = _middle_of_opening(backward, sensor_mm, wavelength_nm)
        radius = _edge(backward, sensor_mm, middle, wavelength_nm)
        for part in GAUSS_NODES:
            offset = np.sqrt(part) * radius[..., None] * _outward()
            square = ((middle[:, None] + offset) ** 2).sum(axis=2)
            ring = (radius**2 / (1 + square) ** 2).mean(axis=1) * np.pi
            light += weight * np.nan_to_num(ring) / len(GAUSS_NODES)
    return light


def _outward() -> Float[np.ndarray, "azimuths 2"]:
    azimuth = 2 * np.pi * np.arange(AZIMUTHS) / AZIMUTHS
    return np.stack([np.cos(azimuth), np.sin(azimuth)], -1)


def _middle_of_opening(backward: BackwardLens, sensor_mm, wavelength_nm: float):
    """Mean slope of the rays of a grid that pass; NaN where none does."""
    steps = ((np.arange(CELLS) + 0.5) / CELLS * 2 - 1) * SCAN_RADII
    offset = np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2)
    slope = backward.middle_slope(sensor_mm)[:, None] + offset * backward.slope_radius
    _, clearance = backward.rays_into_scene(
        np.repeat(sensor_mm, len(offset), axis=0), slope.reshape(-1, 2), wavelength_nm
    )
    passed = (clearance >= 0).reshape(len(sensor_mm), len(offset), 1)
    with np.errstate(invalid="ignore"):
        return (slope * passed).sum(axis=1) / passed.sum(axis=1)


def _edge(
    backward: BackwardLens, sensor_mm, middle, wavelength_nm: float
) -> Float[np.ndarray, "points azimuths"]:
    """Slope from the middle of the opening to its edge, at each azimuth."""
    starts = np.repeat(sensor_mm, AZIMUTHS, axis=0)

    def clearance(radius):
        slope = middle[:, None] + radius[..., None] * _outward()
        _, clear = backward.rays_into_scene(starts, slope.reshape(-1, 2), wavelength_nm)
        return clear.reshape(radius.shape)

    inner = np.zeros((len(sensor_mm), AZIMUTHS))
    outer = np.full_like(inner, 2 * SCAN_RADII * backward.slope_radius.max())
    within, beyond = clearance(inner), np.full_like(inner, -np.inf)
    for _ in range(BISECTIONS):
        between = (inner + outer) / 2
        here = clearance(between)
        is_open = here >= 0
        inner, within = np.where(is_open, (between, here), (inner, within))
        outer, beyond = np.where(is_open, (outer, beyond), (between, here))
    with np.errstate(invalid="ignore"):
        part = np.where(np.isfinite(beyond), within / (within - beyond), 0.5)
    return inner + part * (outer - inner)
