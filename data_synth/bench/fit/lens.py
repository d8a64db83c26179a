"""Figures of a fitted lens beyond reprojection: straightness, colour, truth.

Straightness asks nothing of the chart but straight lines; colour at the edge asks
nothing of it at all; truth is an exact ray trace by code that shares no line with
lensfit (`truth_tables.npz`: quadrant tables of object points and of where their chief
rays land, z from scene to sensor, x right, y up, the optical image inverted).
"""

import json
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from msgspec.structs import replace

from lensfit.detect.observations import POINT
from lensfit.fitting.adjust import Adjustment
from lensfit.fitting.chief_ray import ChiefRayFit
from lensfit.fitting.geometry import distortion_of
from lensfit.fitting.held_out import HELD_OUT_SEEDS, fitted_to_half
from lensfit.fitting.lens_state import LensState
from lensfit.fitting.view_stack import line_numbers, observed_of
from lensfit.lens import Channel, Lens
from lensfit.preset.blocks import Camera
from lensfit.preset.lens_of_entry import lens_of_entry
from lensfit.workflow.calibration.entries import entry_of

_EDGE = 0.8
_QUADRANTS = ((1, 1), (-1, 1), (1, -1), (-1, -1))


def lens_of(state: LensState, camera: Camera) -> Lens:
    """The lens as a preset would have it, without fall-off."""
    return lens_of_entry(replace(entry_of(state), fall_off=()), camera)


def straightness_px(geometry: ChiefRayFit) -> float:
    """How far undistorted lines are from straight, rms px, mean over seeds.

    The lens is fitted to half of the samples; the other half is undistorted by it, a
    line is fitted to each of theirs by total least squares.
    """
    errors = []
    for seed in HELD_OUT_SEEDS:
        fitted, seen = fitted_to_half(geometry.adjustment, seed)
        errors.append(
            _straightness_px(geometry, fitted, geometry.adjustment.used & ~seen)
        )
    return float(np.mean(errors))


def _straightness_px(
    geometry: ChiefRayFit, fitted: Adjustment, chosen: np.ndarray
) -> float:
    lens = _green_lens(geometry, fitted)
    squared = []
    for take, mine in zip(geometry.takes, chosen, strict=True):
        detections = take.observations
        px_per_mm = detections.image_size_px[0] / take.sensor_size_mm[0]
        straight_mm = lens.undistorted_from_distorted(observed_of(take))
        straight = np.asarray(straight_mm) * px_per_mm
        number = line_numbers(detections.family, detections.lattice)
        keep = mine[: len(detections)] & (detections.family != POINT)
        family = detections.family
        for line in np.unique(np.column_stack([family, number])[keep], axis=0):
            mask = keep & (family == line[0]) & (number == line[1])
            squared.append(_squared_distances(straight[mask]))
    return float(np.sqrt(np.mean(np.concatenate(squared))))


def _green_lens(geometry: ChiefRayFit, fitted: Adjustment) -> Lens:
    first = geometry.takes[0]
    shared = jnp.asarray(fitted.parameters[: fitted.layout.shared])
    distortion = distortion_of(shared, fitted.layout, fitted.frame)
    return Lens(
        distortion=distortion,
        lateral_colour=None,
        illumination=None,
        entrance_pupil_offset_mm=distortion.principal_distance_mm,
        sensor_size_mm=first.sensor_size_mm,
        focal_length_mm=first.focal_length_mm,
    )


def _squared_distances(points: Float[np.ndarray, "points 2"]) -> np.ndarray:
    """From the line of total least squares through the points."""
    centred = points - points.mean(0)
    across = np.linalg.svd(centred, full_matrices=False)[2][1]
    return (centred @ across) ** 2


def edge_colour_px(
    geometry: ChiefRayFit, lens: Lens, camera: Camera
) -> dict[str, tuple[float, float]]:
    """Median radial shift of red and blue against green near the edge, px.

    By the lens and by the detections themselves, beyond 0.8 of the largest radius.
    """
    green = np.concatenate([observed_of(take) for take in geometry.takes])
    radius = np.hypot(*green.T)
    mm_per_px = camera.sensor_width_mm / camera.image_width_px
    edge = radius > _EDGE * radius.max()
    outward = (green / radius[:, None])[edge]
    undistorted = lens.undistorted_from_distorted(green[edge])
    places = np.concatenate(
        [t.observations.channel_points_px for t in geometry.takes], axis=1
    )[:, edge]
    found = {}
    channels: tuple[tuple[Channel, int], ...] = (("r", 0), ("b", 2))
    for channel, index in channels:
        moved = np.asarray(lens.distorted_from_undistorted(undistorted, channel))
        modelled = np.sum((moved - green[edge]) * outward, -1) / mm_per_px
        measured = np.sum((places[index] - places[1]) * outward, -1)
        found[channel] = float(np.median(modelled)), float(np.nanmedian(measured))
    return found


def truth_errors_px(lens: Lens, folder: Path) -> dict[str, float]:
    """Against the exact trace: chief rays and lateral colour over the frame, rms px.

    Chief rays are compared after the best affine map, which absorbs the pose of the
    chart, with the quadrant mirrored to the whole frame.
    """
    tables = np.load(folder / "truth_tables.npz")
    frame = json.loads((folder / "truth_lens.json").read_text())["frame"]
    objects = tables["in_obj"].reshape(-1, 3) * (1, -1, -1)
    landed = tables["in_chief_mm"].reshape(-1, 3, 2) * (-1, 1)
    half = np.array([frame["W"], frame["H"]]) * frame["pitch_mm"] / 2
    seen = np.isfinite(landed).all((1, 2)) & (np.abs(landed[:, 1]) < half).all(1)
    true = dict(zip("rgb", np.moveaxis(landed[seen], 1, 0), strict=True))
    made = {c: np.asarray(lens.project(objects[seen], c)) for c in ("r", "g", "b")}
    errors = {
        f"{c}-g": (made[c] - made["g"]) - (true[c] - true["g"]) for c in ("r", "b")
    }
    whole = [np.concatenate([m["g"] * q for q in _QUADRANTS]) for m in (made, true)]
    errors["chief"] = _aligned(*whole) - whole[1]
    return {
        name: float(np.sqrt(np.mean(np.sum(e**2, -1))) / frame["pitch_mm"])
        for name, e in errors.items()
    }


def _aligned(
    moving: Float[np.ndarray, "points 2"], fixed: Float[np.ndarray, "points 2"]
) -> np.ndarray:
    """`moving` under the affine map that brings it closest to `fixed`."""
    design = np.column_stack([moving, np.ones(len(moving))])
    return design @ np.linalg.lstsq(design, fixed)[0]
