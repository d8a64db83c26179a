"""Photographs of dot grids: rays from every hole, or pupil maps, through all the pupil.

Each hole radiates evenly over its disc and its hemisphere (Lambertian). A ray from hole
area dA to entrance-pupil area dB at distance s carries dA cos(chart) dB cos(axis)/s^2:
no assumption about the pupil enters, so vignetting and natural fall-off come out of the
trace. Hole and pupil points are drawn jointly from a scrambled Sobol sequence, another
copy for each dot. Rays are counted in the pixel where they land, which is exactly the
integral over the pixel's area.

Pupil maps make the same photograph with far less noise. The spot of each hole's centre
is drawn from an interpolated pupil map on sub-pixels and convolved with the image of
the hole: a disc that the local chief-ray map makes an ellipse, applied by its transform
2 J1(u)/u. Approximation: over one hole the spot's shape is constant, which for holes of
a few pixels is far below the noise of any camera. A test compares the two ways.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.special import j1

from data_synth.aim import (
    chief_landings_mm,
    pupil_bounds_mm,
    rays_through_pupil,
    tracer_from_object,
)
from data_synth.chart import Chart, Pose
from data_synth.irradiance import ray_weights, shifted_sobol, white_irradiance
from data_synth.lens import SetLens
from data_synth.pupilmap import deposit, open_bounds_mm, pupil_map
from data_synth.sensor import Band, Frame

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
    samples = shifted_sobol(4, rays_per_wavelength, len(index), seed)
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


SUBPIXELS = 4
CELLS = 24
RAY_SPACING_PX = 0.25
"""Interpolated rays stand about this far apart on the sensor."""
ACROSS = (48, 200)
DOTS_AT_ONCE = 24
MARGIN_PX = 3
ONE_SUBPIXEL = np.ones(2)


def expose_dots_from_maps(
    lens: SetLens, chart: Chart, pose: Pose, frame: Frame, bands: tuple[Band, ...]
) -> tuple[Float[np.ndarray, "height width 3"], DotTruth]:
    """Photograph a dot grid; 1.0 is the brightness of an open white chart on axis.

    Returns
    -------
    image, truth : As `data_synth.dots.expose_dots` gives them.
    """
    index, chart_mm = dots_in_frame(lens, chart, pose, frame)
    chief_px = np.stack([_band_chiefs(lens, pose, frame, chart_mm, b) for b in bands])
    width, height = frame.size_px
    image = np.zeros((height, width, 3))
    moments = np.zeros((3, len(index), 3))
    white = white_irradiance(lens, pose.distance_mm, bands) * np.prod(frame.pitch_mm)
    # From the centre outwards, so that spots of a batch are of a size.
    order = np.argsort(np.hypot(*(chief_px[1] - np.array(frame.size_px) / 2).T))
    for start in range(0, len(index), DOTS_AT_ONCE):
        dots = order[start : start + DOTS_AT_ONCE]
        hole_px = _hole_axes_px(lens, chart, pose, frame, chart_mm[dots])
        scene = tracer_from_object(pose.placed(chart_mm[dots])[0])
        bounds = open_bounds_mm(lens, scene)
        for channel, band in enumerate(bands):
            patches, corner, moment = _spots(
                lens, pose, frame, chart_mm[dots], band, bounds, _reach_px(hole_px)
            )
            scale = np.pi / 4 * chart.mark_mm**2 / white[channel]
            seen = _through_holes(patches, hole_px) * scale
            _place(image[..., channel], seen, corner)
            moments[channel, dots] = moment * scale
    flux = moments[..., 0]
    with np.errstate(invalid="ignore"):
        centroid_px = moments[..., 1:] / flux[..., None]
    return image, DotTruth(index, chart_mm, chief_px, centroid_px, flux)


def _reach_px(hole_px) -> float:
    return float(np.nanmax(np.abs(hole_px))) + MARGIN_PX


def _spots(lens, pose, frame, chart_mm, band: Band, bounds, margin_px: float):
    """Sub-pixel pictures of points, the pixel of each one's corner, and moments."""
    object_mm, normal = pose.placed(chart_mm)
    points, normals = tracer_from_object(object_mm), tracer_from_object(normal)
    maps = [
        pupil_map(lens, points, normals, bounds, wavelength_nm, CELLS)
        for wavelength_nm in band.wavelengths_nm
    ]
    extent = np.stack([m.extent_mm(lens.stop) for m in maps])
    low = frame.px_from_mm(extent[:, :, 0].min(axis=0))
    high = frame.px_from_mm(extent[:, :, 1].max(axis=0))
    spread_px = float((high - low).max())
    size = int(np.ceil(spread_px + 2 * margin_px)) + 1
    corner = np.floor((low + high - size) / 2).astype(int)
    # The box of a map is about a quarter wider than the opening in it.
    across = int(np.clip(1.25 * spread_px / RAY_SPACING_PX, *ACROSS))
    fine = size * SUBPIXELS
    patches = np.zeros((len(points), fine, fine))
    moments = np.zeros((len(points), 3))
    number = np.arange(len(points))
    pitch_mm = np.array(frame.pitch_mm)
    for one, share in zip(maps, band.weights, strict=True):
        rays = one.refined(lens.stop, across)
        flux = rays.flux * share
        landing_px = np.moveaxis(rays.landing_mm, 1, -1) / pitch_mm
        landing_px += np.array(frame.size_px) / 2
        lit = flux > 0
        which = np.broadcast_to(number[:, None, None], lit.shape)[lit]
        local = (landing_px[lit] - corner[which]) * SUBPIXELS
        patches += deposit(local, ONE_SUBPIXEL, flux[lit], which, patches.shape)
        moments[:, 0] += flux.sum(axis=(1, 2))
        moments[:, 1:] += (flux[..., None] * landing_px).sum(axis=(1, 2))
    return patches, corner, moments


def _hole_axes_px(lens, chart: Chart, pose: Pose, frame: Frame, chart_mm):
    """Image of each hole's X and Y radius: (dots, 2 axes, 2 components)."""
    radius = chart.mark_mm / 2
    steps = radius * np.array([[1.0, 0], [-1, 0], [0, 1], [0, -1]])
    object_mm, _ = pose.placed((chart_mm[:, None] + steps).reshape(-1, 2))
    landing = chief_landings_mm(lens, tracer_from_object(object_mm), 540.0)
    landing = frame.px_from_mm(landing).reshape(-1, 4, 2)
    return (
        np.stack([landing[:, 0] - landing[:, 1], landing[:, 2] - landing[:, 3]], 1) / 2
    )


def _through_holes(patches, hole_px) -> Float[np.ndarray, "dots rows columns"]:
    """Spots convolved with the holes' images, summed to whole pixels."""
    dots, fine, _ = patches.shape
    down = np.fft.fftfreq(fine)[None, :, None] * SUBPIXELS
    right = np.fft.rfftfreq(fine)[None, None, :] * SUBPIXELS
    along = [
        hole_px[:, k, 0, None, None] * right + hole_px[:, k, 1, None, None] * down
        for k in (0, 1)
    ]
    argument = 2 * np.pi * np.maximum(np.hypot(*along), 1e-9)
    # Rays were spread over a sub-pixel each, against aliasing; that is undone here.
    spread = np.sinc(down / SUBPIXELS) * np.sinc(right / SUBPIXELS)
    transfer = 2 * j1(argument) / argument / spread
    seen = np.fft.irfft2(np.fft.rfft2(patches) * transfer, s=(fine, fine))
    size = fine // SUBPIXELS
    whole = seen.reshape(dots, size, SUBPIXELS, size, SUBPIXELS).sum(axis=(2, 4))
    # The transform of a sharp disc rings a little on sub-pixels.
    return np.maximum(whole, 0.0)


def _place(plane: Float[np.ndarray, "height width"], patches, corner) -> None:
    """Add each patch to the plane where it lies, cut at the frame."""
    height, width = plane.shape
    size = patches.shape[1]
    for patch, (left, top) in zip(patches, corner, strict=True):
        x0, x1 = max(left, 0), min(left + size, width)
        y0, y1 = max(top, 0), min(top + size, height)
        if x0 < x1 and y0 < y1:
            part = patch[y0 - top : y1 - top, x0 - left : x1 - left]
            plane[y0:y1, x0:x1] += part
