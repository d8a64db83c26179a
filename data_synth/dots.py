"""Photographs of dot grids by brute force: rays from every hole through all the pupil.

Each hole radiates evenly over its disc and its hemisphere (Lambertian). A ray from hole
area dA to entrance-pupil area dB at distance s carries dA cos(chart) dB cos(axis)/s^2:
no assumption about the pupil enters, so vignetting and natural fall-off come out of the
trace. Hole and pupil points are drawn jointly from a scrambled Sobol sequence, another
copy for each dot. Rays are counted in the pixel where they land, which is exactly the
integral over the pixel's area.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from data_synth.aim import (
    chief_landings_mm,
    pupil_bounds_mm,
    rays_through_pupil,
    tracer_from_object,
)
from data_synth.bands import Band
from data_synth.chart import Chart, Pose
from data_synth.frame import Frame
from data_synth.irradiance import ray_weights, shifted_sobol, white_irradiance
from data_synth.lens import SetLens

RAYS_PER_BATCH = 1 << 18
_MARGIN = 0.02
"""Beyond each side of the frame, in its width and height."""


@dataclass(frozen=True, eq=False)
class DotTruth:
    """What the tracer knows of each dot.

    Attributes
    ----------
    index : Lattice index i right, j down of every dot.
    chart_mm : Its centre on the chart.
    chief_px : Where its chief ray lands, mean over the band, per channel.
    centroid_px : Mean of all its rays, per channel.
    flux : Light in white-level x pixels, per channel.
    """

    index: Int[np.ndarray, "dots 2"]
    chart_mm: Float[np.ndarray, "dots 2"]
    chief_px: Float[np.ndarray, "3 dots 2"]
    centroid_px: Float[np.ndarray, "3 dots 2"]
    flux: Float[np.ndarray, "3 dots"]


def expose_dots(
    lens: SetLens,
    chart: Chart,
    pose: Pose,
    frame: Frame,
    bands: tuple[Band, ...],
    *,
    rays_per_wavelength: int = 1024,
    seed: int = 0,
) -> tuple[Float[np.ndarray, "height width 3"], DotTruth]:
    """Photograph a dot grid; 1.0 is the brightness of an open white chart on axis.

    Parameters
    ----------
    rays_per_wavelength : Per dot and wavelength; a power of two is best.

    Returns
    -------
    image : Noise-free irradiance.
    truth : Chief rays, centroids and fluxes of the dots in and near the frame.
    """
    index, chart_mm = dots_in_frame(lens, chart, pose, frame)
    chief_px = np.stack([_band_chiefs(lens, pose, frame, chart_mm, b) for b in bands])
    centre_mm, _ = pose.placed(chart_mm)
    bounds = pupil_bounds_mm(lens, tracer_from_object(centre_mm), 540.0)
    width, height = frame.size_px
    image = np.zeros((height, width, 3))
    moments = np.zeros((3, len(index), 3))
    samples = shifted_sobol(rays_per_wavelength, len(index), seed)
    white = white_irradiance(lens, pose.distance_mm, bands) * np.prod(frame.pitch_mm)
    per_batch = max(1, RAYS_PER_BATCH // rays_per_wavelength)
    for channel, band in enumerate(bands):
        for wavelength_nm, share in zip(band.wavelengths_nm, band.weights, strict=True):
            for start in range(0, len(index), per_batch):
                dots = slice(start, start + per_batch)
                box = (bounds[0][dots], bounds[1][dots])
                landing_px, flux = _trace_dots(
                    lens, chart, pose, frame, chart_mm[dots], box,
                    samples[dots], wavelength_nm,
                )  # fmt: skip
                flux *= share / white[channel]
                _collect(image[..., channel], landing_px, flux)
                moments[channel, dots] += _moments(landing_px, flux)
    flux = moments[..., 0]
    with np.errstate(invalid="ignore"):
        centroid_px = moments[..., 1:] / flux[..., None]
    return image, DotTruth(index, chart_mm, chief_px, centroid_px, flux)


def dots_in_frame(
    lens: SetLens, chart: Chart, pose: Pose, frame: Frame
) -> tuple[Int[np.ndarray, "dots 2"], Float[np.ndarray, "dots 2"]]:
    """Indices and chart positions of the dots whose light may touch the frame."""
    scale = pose.distance_mm / lens.focal_length_mm
    reach_mm = 1.6 * scale * max(frame.size_mm) * max(1.0, lens.prescription.squeeze)
    count = int(np.ceil(reach_mm / chart.pitch_mm / 2)) + 1
    steps = np.arange(-count, count + 1)
    index = np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2)
    chart_mm = index * chart.pitch_mm
    object_mm, _ = pose.placed(chart_mm)
    landing = chief_landings_mm(lens, tracer_from_object(object_mm), 540.0)
    limit = np.array(frame.size_mm) * (0.5 + _MARGIN)
    with np.errstate(invalid="ignore"):
        seen = (np.abs(landing) < limit).all(axis=1) & (object_mm[:, 2] > 0)
    seen &= chart.is_printed(chart_mm)
    seen &= _is_unfolded(lens, object_mm)
    return index[seen], chart_mm[seen]


def _is_unfolded(lens: SetLens, object_mm: Float[np.ndarray, "dots 3"]):
    """Whether light gets through: far outside the field chief rays can fold back."""
    lower, upper = pupil_bounds_mm(lens, tracer_from_object(object_mm), 540.0, cells=8)
    return (upper > lower).all(axis=1)


def _band_chiefs(lens, pose, frame, chart_mm, band: Band):
    object_mm, _ = pose.placed(chart_mm)
    points = tracer_from_object(object_mm)
    landing = sum(
        share * chief_landings_mm(lens, points, wavelength_nm)
        for wavelength_nm, share in zip(band.wavelengths_nm, band.weights, strict=True)
    )
    return frame.px_from_mm(landing)


def _trace_dots(lens, chart, pose, frame, chart_mm, box, samples, wavelength_nm):
    """Landing pixels (dots, rays, 2) and fluxes (dots, rays) of all rays."""
    dots, rays = samples.shape[:2]
    radius = chart.mark_mm / 2 * np.sqrt(samples[..., 0])
    azimuth = 2 * np.pi * samples[..., 1]
    hole = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth)], -1)
    object_mm, normal = pose.placed((chart_mm[:, None] + hole).reshape(-1, 2))
    points = tracer_from_object(object_mm)
    lower, upper = box
    pupil = lower[:, None] + (upper - lower)[:, None] * samples[..., 2:]
    traced, direction = rays_through_pupil(
        lens, points, pupil.reshape(-1, 2), wavelength_nm
    )
    area = np.prod(upper - lower, axis=1) * (np.pi / 4 * chart.mark_mm**2) / rays
    weights = ray_weights(lens, points, tracer_from_object(normal), direction)
    flux = weights * traced.passed
    landing_px = frame.px_from_mm(
        np.where(traced.passed[:, None], -traced.landing_mm, 0)
    )
    return (
        landing_px.reshape(dots, rays, 2),
        flux.reshape(dots, rays) * area[:, None],
    )


def _collect(plane: Float[np.ndarray, "height width"], landing_px, flux) -> None:
    """Add each ray's flux to the pixel it lands in."""
    height, width = plane.shape
    cell = np.floor(landing_px).astype(np.int64).reshape(-1, 2)
    inside = (cell >= 0).all(axis=1) & (cell[:, 0] < width) & (cell[:, 1] < height)
    flat = cell[inside, 1] * width + cell[inside, 0]
    weights = flux.reshape(-1)[inside]
    plane += np.bincount(flat, weights, minlength=height * width).reshape(plane.shape)


def _moments(landing_px, flux):
    """Sum of flux and of flux times position, per dot."""
    first = (flux[..., None] * landing_px).sum(axis=1)
    return np.concatenate([flux.sum(axis=1)[:, None], first], axis=1)
