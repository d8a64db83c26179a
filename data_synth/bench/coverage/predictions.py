"""What a calibration predicts, with stated deviations, where a tracer knows the truth.

Each quantity is one array of values, one of stated standard deviations and one of true
values, all in the unit of its name:

    distortion_px     green chief rays over the frame, x and y in turn, after the pose
                      of the camera that brings them closest to the truth: a pose would
                      undo that part, and so it is no error of the lens
    red_px, blue_px   displacement against green
    light_percent     logarithm of the illumination less its mean over the frame
    defocus_um        of each group of takes; the tracer has no such number
    psf_percent       of the peak, green, pixels above a tenth of it, in focus and out
    psf_error_percent relative L2 error of whole point-spread functions; the value is
                      0 and the truth how far it is off

What a tracer knows of the lens is compared with that. It counts millimetres on the
sensor, x right and y down from its centre; object points from the axis. Every array
holds what lies in the frame, thinned out.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from lensfit.batches import in_batches
from lensfit.fitting.lens_state import LensState
from lensfit.fitting.lens_states import FittedLens
from lensfit.fitting.uncertainty import position_deviations_mm
from lensfit.lens import Lens
from lensfit.optics.distortion import Distortion, jacobian_at
from lensfit.optics.many_points import (
    displaced_positions_mm,
    distort,
    illuminate,
    undistort,
)
from lensfit.optics.map_deviations import pose_moves


@dataclass(frozen=True)
class TracedChiefs:
    """Where chief rays of a flat object land, at one focus.

    Attributes
    ----------
    focus_distance_mm : As on the barrel.
    object_mm : Across the object, in a plane square to the axis.
    landed_mm : Of red, green and blue.
    """

    focus_distance_mm: float
    object_mm: Float[np.ndarray, "points 2"]
    landed_mm: Float[np.ndarray, "points 3 2"]


@dataclass(frozen=True)
class TracedLight:
    """Relative illumination at points of a photograph, at one setting."""

    f_number: float
    focus_distance_mm: float
    points_mm: Float[np.ndarray, "points 2"]
    light: Float[np.ndarray, "points 3"]


@dataclass(frozen=True)
class TracedSpots:
    """Green point-spread functions at one setting, each of sum 1."""

    f_number: float
    focus_distance_mm: float
    object_distance_mm: float
    pitch_mm: float
    points_mm: Float[np.ndarray, "points 2"]
    psf: Float[np.ndarray, "points size size"]


@dataclass(frozen=True)
class Traced:
    """All that is compared; every array holds what lies in the frame."""

    focal_length_mm: float
    pixel_mm: float
    chiefs: tuple[TracedChiefs, ...]
    light: tuple[TracedLight, ...]
    spots: tuple[TracedSpots, ...]


_ALIGNED = 4
_BATCH = 256
_BRIGHT, _TOLERANCE = 0.1, 0.02


class Prediction(NamedTuple):
    """Values with their stated deviations; `truth` is NaN where nobody knows it."""

    value: Float[np.ndarray, " values"]
    deviation: Float[np.ndarray, " values"]
    truth: Float[np.ndarray, " values"]


def predictions(
    fitted: FittedLens, lens_at: Callable[[float, float], Lens], traced: Traced
) -> dict[str, Prediction]:
    """Every quantity of a calibration.

    Parameters
    ----------
    lens_at : Function (f_number, focus_distance_mm) -> lens of its preset.
    """
    state_of = {state.focus_distance_mm: state for state in fitted.states}
    parts: dict[str, list[Prediction]] = {}

    def add(name: str, one: Prediction) -> None:
        parts.setdefault(name, []).append(one)

    for chiefs in traced.chiefs:
        state = state_of[chiefs.focus_distance_mm]
        add("distortion_px", _distortion(state, chiefs, traced.pixel_mm))
        for quantity, channel in (("red_px", "r"), ("blue_px", "b")):
            add(quantity, _colour(state, channel, chiefs, traced.pixel_mm))
    for light in traced.light:
        for one in _illumination(state_of[light.focus_distance_mm], light):
            add("light_percent", one)
    for spots in traced.spots:
        lens = lens_at(spots.f_number, spots.focus_distance_mm)
        pixels, whole = _psf(lens, spots)
        add("psf_percent", pixels)
        add("psf_error_percent", whole)
    found = {name: _joined(some) for name, some in parts.items()}
    return found | {"defocus_um": _defocus(fitted)}


def _joined(some: list[Prediction]) -> Prediction:
    return Prediction(*map(np.concatenate, zip(*some, strict=True)))


def _distortion(state: LensState, traced: TracedChiefs, pixel_mm: float) -> Prediction:
    """What is left after the best homography, zero being the truth."""
    adjustment, lens = state.geometry.adjustment, state.distortion
    radius_mm = float(lens.reference_radius_mm)
    landed = traced.landed_mm[:, 1]
    straight = _undistorted(landed, lens)
    # The picture of a flat object is a homography of it, but for distortion.
    straight = _homography(traced.object_mm, straight)
    for _ in range(_ALIGNED):
        moves = pose_moves(_slopes(straight, lens), straight, radius_mm)
        away = (_distorted(straight, lens) - landed).reshape(-1)
        step = np.linalg.lstsq(moves, away, rcond=1e-10)[0]
        still = np.tile(np.eye(2), (len(straight), 1, 1))
        moved = pose_moves(still, straight, radius_mm)
        straight = straight - (moved @ step).reshape(-1, 2)
    left = (_distorted(straight, lens) - landed).reshape(-1) / pixel_mm
    known = position_deviations_mm(adjustment, state.uncertainty, straight)
    return Prediction(left, known.reshape(-1) / pixel_mm, 0 * left)


def _distorted(points: np.ndarray, lens: Distortion) -> np.ndarray:
    return in_batches(lambda p: distort(p, lens), points, _BATCH)


def _undistorted(points: np.ndarray, lens: Distortion) -> np.ndarray:
    return in_batches(lambda p: undistort(p, lens), points, _BATCH)


def _slopes(points: np.ndarray, lens: Distortion) -> np.ndarray:
    """d distorted / d undistorted."""
    return in_batches(lambda p: _SLOPE(jnp.asarray(p), lens), points, _BATCH)


def _homography(board: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Points of a plane under the homography that brings them closest to `seen`."""
    matrix, _ = cv2.findHomography(board, seen)
    return cv2.perspectiveTransform(board[None], matrix)[0]


def _colour(
    state: LensState, channel: str, traced: TracedChiefs, pixel_mm: float
) -> Prediction:
    """Displacement against green, x and y in turn; none where none was found."""
    green, own = traced.landed_mm[:, 1], traced.landed_mm[:, "rgb".index(channel)]
    true = (own - green).reshape(-1) / pixel_mm
    if channel not in state.colour:
        return Prediction(0 * true, 0 * true, true)
    colour, d = state.colour[channel], state.distortion
    shift = colour.optics()
    moved = in_batches(lambda p: displaced_positions_mm(p, d, shift), green, _BATCH)
    radius_mm = float(d.reference_radius_mm)
    q = (green - np.asarray(d.principal_point_mm)) / radius_mm
    known = colour.deviations(q).reshape(-1) * radius_mm
    value = (moved - green).reshape(-1)
    return Prediction(value / pixel_mm, known / pixel_mm, true)


def _illumination(state: LensState, traced: TracedLight) -> list[Prediction]:
    """Of red, green and blue where this f-number was fitted."""
    centre_mm = state.distortion.principal_point_mm
    radius_mm = np.hypot(*(traced.points_mm - np.asarray(centre_mm)).T)
    found = []
    for fitted in state.fall_off:
        if fitted.f_number != traced.f_number:
            continue
        known = fitted.deviation_about_mean(radius_mm)
        edge_mm = jnp.asarray(fitted.valid_radius_mm)
        for channel, control in enumerate(fitted.control):
            given = centre_mm, edge_mm, jnp.asarray(control)
            light = in_batches(
                lambda p, given=given: illuminate(p, *given), traced.points_mm, _BATCH
            )
            value, true = np.log(light), np.log(traced.light[:, channel])
            found.append(
                Prediction(
                    100 * (value - value.mean()),
                    100 * known[channel],
                    100 * (true - true.mean()),
                )
            )
    return found


def _defocus(fitted: FittedLens) -> Prediction:
    values, deviations = [], []
    for wavefront in fitted.wavefronts.values():
        where = wavefront.stage.layout.blocks["defocus"]
        count = len(wavefront.dot_data.groups)
        values += list(1000 * wavefront.stage.parameters[where][:count])
        deviation = np.sqrt(np.diag(wavefront.total_covariance))[where][:count]
        deviations += list(1000 * deviation)
    nobody = np.full(len(values), np.nan)
    return Prediction(np.array(values), np.array(deviations), nobody)


def _psf(lens: Lens, traced: TracedSpots) -> tuple[Prediction, Prediction]:
    """Bright pixels in percent of the peak, and whole functions."""
    known = lens.known_psfs(
        traced.points_mm,
        traced.object_distance_mm,
        "g",
        pixel_pitch_mm=traced.pitch_mm,
        size_px=traced.psf.shape[-1],
        tolerance=_TOLERANCE,
    )
    peak = traced.psf.max((1, 2), keepdims=True)
    bright = traced.psf > _BRIGHT * peak
    pixels = Prediction(
        *((100 * a / peak)[bright] for a in (known.psf, known.deviation, traced.psf))
    )
    norm = np.sqrt(np.sum(traced.psf**2, (1, 2)))
    off = np.sqrt(np.sum((known.psf - traced.psf) ** 2, (1, 2)))
    whole = Prediction(0 * norm, 100 * known.relative_error(), 100 * off / norm)
    return pixels, whole


_SLOPE = jax.jit(jax.vmap(jacobian_at, (0, None)))
