"""Whether the deviations that a lens states are true: how many errors are within one.

An honest standard deviation covers 68 % of the errors, whatever made them: noise, or a
model that is not the lens. Shares are of all places over the frame and of all settings
that were photographed:

    chief_rays       green, along x and along y, after the homography of the undistorted
                     picture that brings them closest to the truth: a pose of the
                     camera would undo that part
    lateral_colour   displacement of red and of blue against green, along x and along y
    fall_off         of green, places on the axis left out, where it is 1 by definition
    psf              pixels of green spots brighter than a tenth of the peak, at the
                     fine pitch of the truth
"""

from collections.abc import Callable, Iterator
from typing import Any, Protocol, runtime_checkable

import cv2
import numpy as np
from jaxtyping import ArrayLike, Float

from data_synth.judge_spots import GREEN
from data_synth.judged_lens import Lens
from data_synth.psf_truth import WavefrontTruth
from data_synth.sensor import CHANNELS, Channel
from lensfit.errors import LensfitError

_SPOTS = 3
"""Field points of every setting."""
_DRAWS = 24
"""Random errors of the blur that stand for all."""
_FEWEST_FOR_A_POSE = 8
_TOLERANCE, _BRIGHT = 0.02, 0.1

Errors = tuple[np.ndarray, np.ndarray]
"""Errors and their stated deviations."""


@runtime_checkable
class KnownLens(Lens, Protocol):
    """A lens that says how well it is known."""

    def position_standard_deviation_mm(self, points_mm: ArrayLike) -> ArrayLike:
        """Along x and y, of undistorted points."""
        ...

    def lateral_colour_standard_deviation_mm(
        self, points_mm: ArrayLike, channel: Channel
    ) -> ArrayLike:
        """Along x and y, where green lands."""
        ...

    def illumination_standard_deviation(self, points_mm: ArrayLike) -> ArrayLike:
        """Of the light of green."""
        ...

    def undistorted_from_distorted(self, points_mm: ArrayLike) -> ArrayLike:
        """Of points of the photograph."""
        ...

    def distorted_from_undistorted(self, points_mm: ArrayLike) -> ArrayLike:
        """Where they lie on it."""
        ...

    def known_psfs(
        self,
        image_points_mm: ArrayLike,
        object_distance_mm: float,
        channel: Channel = "g",
        *,
        pixel_pitch_mm: float,
        size_px: int,
        tolerance: float,
        draws: int,
    ) -> Any:
        """Spots (`psf`) and how well each pixel is known (`deviation`)."""
        ...


def covered_figures(
    make: Callable[[float, float], Lens], truth: WavefrontTruth
) -> dict[str, float]:
    """Percent of errors within one stated deviation, of what the lens says."""
    asked = {
        "chief_rays": _chief_rays,
        "lateral_colour": _lateral_colour,
        "fall_off": _fall_off,
        "psf": _psf,
    }
    found = {}
    for name, errors_of in asked.items():
        try:
            parts = list(errors_of(make, truth))
        except LensfitError:
            continue
        if parts:
            off, stated = (np.concatenate(part) for part in zip(*parts, strict=True))
            found[name] = 100.0 * float(np.mean(np.abs(off) <= stated))
    return found


def _known(lens: Lens) -> KnownLens:
    if not isinstance(lens, KnownLens):
        raise LensfitError("this lens does not say how well it is known")
    return lens


def _in_focus_states(
    make: Callable[[float, float], Lens], truth: WavefrontTruth
) -> Iterator[tuple[KnownLens, np.ndarray, np.ndarray]]:
    """Lens, object points and where their red, green and blue land in the frame."""
    half_mm = np.array(truth.frame.size_mm) / 2
    widest = min(f_number for f_number, _ in truth.settings)
    for focus_mm, landed in zip(truth.focus_mm, truth.chief_mm, strict=True):
        inside = (np.abs(landed[:, GREEN]) <= half_mm).all(-1)
        inside &= np.isfinite(landed).all((1, 2))
        lens = _known(make(widest, focus_mm))
        yield lens, truth.chief_object_mm[inside], landed[inside]


def _chief_rays(
    make: Callable[[float, float], Lens], truth: WavefrontTruth
) -> Iterator[Errors]:
    for lens, points, landed in _in_focus_states(make, truth):
        true = landed[:, GREEN]
        straight = np.asarray(lens.undistorted_from_distorted(true))
        made = lens.undistorted_from_distorted(lens.project(points, channel="g"))
        made = np.asarray(made)
        seen = np.isfinite(made).all(-1) & np.isfinite(straight).all(-1)
        if seen.sum() < _FEWEST_FOR_A_POSE:
            continue
        made, straight, true = made[seen], straight[seen], true[seen]
        matrix, _ = cv2.findHomography(made, straight)
        posed = cv2.perspectiveTransform(made[None], matrix)[0]
        off = np.asarray(lens.distorted_from_undistorted(posed)) - true
        stated = np.asarray(lens.position_standard_deviation_mm(straight))
        yield off.ravel(), stated.ravel()


def _lateral_colour(
    make: Callable[[float, float], Lens], truth: WavefrontTruth
) -> Iterator[Errors]:
    for lens, points, landed in _in_focus_states(make, truth):
        made = {c: np.asarray(lens.project(points, channel=c)) for c in CHANNELS}
        for k, channel in enumerate(CHANNELS):
            if k == GREEN:
                continue
            true = landed[:, k] - landed[:, GREEN]
            off = made[channel] - made["g"] - true
            stated = lens.lateral_colour_standard_deviation_mm(
                landed[:, GREEN], channel
            )
            yield off.ravel(), np.asarray(stated).ravel()


def _fall_off(
    make: Callable[[float, float], Lens], truth: WavefrontTruth
) -> Iterator[Errors]:
    half_mm = np.array(truth.frame.size_mm) / 2
    for setting, points, light in zip(
        truth.settings, truth.light_mm, truth.light, strict=True
    ):
        inside = (np.abs(points) <= half_mm).all(-1) & np.isfinite(light[:, GREEN])
        places, true = points[inside], light[inside, GREEN]
        lens = _known(make(*setting))
        made = np.asarray(lens.relative_illumination(places))
        middle = int(np.argmin(np.hypot(*places.T)))
        stated = np.asarray(lens.illumination_standard_deviation(places))
        off = made / made[middle] - true / true[middle]
        elsewhere = np.arange(len(places)) != middle
        yield off[elsewhere], stated[elsewhere]


def _psf(
    make: Callable[[float, float], Lens], truth: WavefrontTruth
) -> Iterator[Errors]:
    for k, group in enumerate(truth.groups):
        true = truth.psf[k][:, GREEN]
        whole = np.flatnonzero(np.isfinite(true).all((1, 2)))
        if not (group.photographed and len(whole)):
            continue
        rows = whole[np.linspace(0, len(whole) - 1, _SPOTS).astype(int)]
        true = true[rows] / true[rows].sum((1, 2), keepdims=True)
        lens = _known(make(group.f_number, group.focus_distance_mm))
        known = lens.known_psfs(
            truth.spot_chief_mm[k][rows],
            group.object_distance_mm,
            "g",
            pixel_pitch_mm=truth.frame.pitch_mm[0] / group.subpixels,
            size_px=true.shape[-1],
            tolerance=_TOLERANCE,
            draws=_DRAWS,
        )
        bright = true > _BRIGHT * true.max((1, 2), keepdims=True)
        off: Float[np.ndarray, " pixels"] = (np.asarray(known.psf) - true)[bright]
        yield off, np.asarray(known.deviation)[bright]
