"""What a judge asks of a lens, and what no lens may do.

Sensor mm with x right and y down, object points with z from the sensor. It is what
lenses of `lensfit` answer, written again: the tracer and its judge import none of them.

On the frame and 10 % around it no lens may fold the picture, or go dark.
"""

from typing import Protocol

import numpy as np
from jaxtyping import ArrayLike, Float

from data_synth.psf_truth import TABLE_REACH, TABLE_STEPS, WavefrontTruth
from data_synth.sensor import CHANNELS, Channel


class SpotLens(Protocol):
    """What is judged of point-spread functions alone."""

    def psf(
        self,
        image_point_mm: ArrayLike,
        object_distance_mm: float,
        channel: Channel = "g",
        *,
        pixel_pitch_mm: float,
        size_px: int,
    ) -> ArrayLike:
        """Spot around the green chief ray, summing to 1."""
        ...


class Lens(SpotLens, Protocol):
    """What is judged: the part of a lensfit lens that a photograph can prove."""

    def project(self, object_points_mm: ArrayLike, channel: Channel = "g") -> ArrayLike:
        """Sensor mm of object points."""
        ...

    def relative_illumination(
        self, points_mm: ArrayLike, channel: Channel = "g"
    ) -> ArrayLike:
        """Brightness against the middle."""
        ...


FINER = 4
LIGHT_STEPS = (17, 13)


def affinely_aligned(
    moving: Float[np.ndarray, "points 2"], fixed: Float[np.ndarray, "points 2"]
) -> Float[np.ndarray, "points 2"]:
    """`moving` under the affine map that brings it closest to `fixed`."""
    design = np.column_stack([moving, np.ones(len(moving))])
    return design @ np.linalg.lstsq(design, fixed)[0]


def flags_of(
    lens: Lens,
    truth: WavefrontTruth,
    landed_mm: Float[np.ndarray, "points 3 2"],
    where: str,
) -> list[str]:
    """One sentence for each thing that is wrong with a lens at one setting."""
    flags = []
    for channel in CHANNELS:
        if not _is_monotone(lens, truth, landed_mm, channel):
            flags.append(f"{where}: the {channel} picture folds or is not a number")
        light = _light(lens, truth, channel)
        if not (np.isfinite(light).all() and (light > 0).all()):
            flags.append(f"{where}: the {channel} illumination is not positive")
    return flags


def _is_monotone(lens, truth: WavefrontTruth, landed_mm, channel: str) -> bool:
    """Whether small squares of the scene keep their orientation on the sensor."""
    shape = (TABLE_STEPS[1], TABLE_STEPS[0])
    objects = _finer(truth.chief_object_mm.reshape(*shape, 3))
    seen = np.isfinite(landed_mm).all(axis=(1, 2)).reshape(*shape, 1).astype(float)
    whole = _finer(seen)[..., 0] > 1 - 1e-9
    made = np.asarray(lens.project(objects.reshape(-1, 3), channel=channel), float)
    made = made.reshape(*objects.shape[:2], 2)
    right = made[:-1, 1:] - made[:-1, :-1]
    down = made[1:, :-1] - made[:-1, :-1]
    turned = right[..., 0] * down[..., 1] - right[..., 1] * down[..., 0]
    counts = whole[:-1, :-1] & whole[1:, :-1] & whole[:-1, 1:] & whole[1:, 1:]
    return bool((turned[counts] > 0).all())


def _finer(grid: Float[np.ndarray, "rows columns values"]):
    """Interpolated linearly to several times as many nodes."""
    for axis in (0, 1):
        count = grid.shape[axis]
        place = np.linspace(0, count - 1, (count - 1) * FINER + 1)
        low = np.minimum(place.astype(int), count - 2)
        part = (place - low).reshape([-1 if k == axis else 1 for k in range(3)])
        first, second = np.take(grid, low, axis), np.take(grid, low + 1, axis)
        grid = first * (1 - part) + second * part
    return grid


def _light(lens, truth: WavefrontTruth, channel: str) -> np.ndarray:
    half_mm = np.array(truth.frame.size_mm) / 2 * TABLE_REACH
    axes = [np.linspace(-h, h, n) for h, n in zip(half_mm, LIGHT_STEPS, strict=True)]
    points = np.stack(np.meshgrid(*axes), -1).reshape(-1, 2)
    return np.asarray(lens.relative_illumination(points, channel=channel), float)
