"""Shoots of a pinhole whose truth is drawn at random, as a right photographer has them.

The lens breathes as a thin one, give or take; its entrance pupil lies somewhere inside
it; pitches and tape measures err as such things do. Nothing is taken from the model
that judges the shoot.
"""

from dataclasses import dataclass, replace

import numpy as np
from found_marks import found_marks
from scipy.spatial.transform import Rotation

from lensfit.fitting.chart_view import View

SIZE_PX = (1200, 900)
FOCUS_STATES = (1.0, 0.72, 1.65)


@dataclass(frozen=True)
class Truth:
    """What a photographer does not know."""

    focal_length_mm: float
    pupil_mm: float
    breathing: float
    k1: float
    sensor_mm: tuple[float, float]
    distance_mm: float


def drawn(rng: np.random.Generator) -> Truth:
    """A lens for a sensor of 24 to 36 mm."""
    width = float(rng.uniform(24, 36))
    focal = float(np.exp(rng.uniform(np.log(0.7 * width), np.log(3 * width))))
    return Truth(
        focal_length_mm=focal * float(rng.uniform(0.98, 1.02)),
        pupil_mm=float(rng.uniform(0.8, 2.4)) * width,
        breathing=float(rng.normal(0, 0.01)),
        k1=float(rng.uniform(-0.06, 0.03)),
        sensor_mm=(width, 0.75 * width),
        distance_mm=40 * focal,
    )


def drawn_from_every_class(rng: np.random.Generator) -> Truth:
    """From telephoto lenses, whose pupils differ, to zooms that focus by their front
    group: focal length and picture change with focus by up to four times as much as of
    a thin lens, and distortion is up to 6 % at the corner of any of them."""
    truth = drawn(rng)
    corner = np.hypot(*truth.sensor_mm) / 2 / truth.focal_length_mm
    return replace(
        truth,
        breathing=float(rng.uniform(-0.5, 3.0)) / 20,
        k1=float(rng.uniform(-0.06, 0.04)) / corner**2,
    )


def right_shoot(truth: Truth, rng: np.random.Generator) -> list[View]:
    """Two targets: dots in three states of focus, tilted and at another place; lines'
    crossings once."""
    stated_mm = round(truth.focal_length_mm / 0.98)
    stated_mm = min(
        (round(truth.focal_length_mm), stated_mm),
        key=lambda f: abs(f - truth.focal_length_mm),
    )
    pitch = {
        "dots": truth.distance_mm * truth.sensor_mm[0] / truth.focal_length_mm / 26
    }
    pitch["lines"] = 1.4 * pitch["dots"]
    true_pitch = {name: p * (1 + rng.normal(0, 5e-4)) for name, p in pitch.items()}
    takes = []
    for k, (target, focus, turn, away) in enumerate(
        [
            ("dots", FOCUS_STATES[0], (0, 0), 1.0),
            ("dots", FOCUS_STATES[1], (0, 0), 1.0),
            ("dots", FOCUS_STATES[2], (0, 0), 1.0),
            ("dots", FOCUS_STATES[0], (14, -11), 1.02),
            ("lines", FOCUS_STATES[0], (0, 0), 1.0),
        ]
    ):
        distance = truth.distance_mm * away
        focus_mm = truth.distance_mm * focus
        where = distance, truth.distance_mm * focus
        points, lattice = _seen(truth, true_pitch[target], turn, where, rng)
        tape = None if k == 3 else round(distance + rng.normal(0, 5))
        takes.append(
            View(
                name=f"view_{k}.png",
                target=target,
                observations=found_marks(
                    points, SIZE_PX, deviation_px=0.05, lattice=lattice
                ),
                pitch_mm=(pitch[target],) * 2,
                mark_diameter_mm=None,
                focal_length_mm=float(stated_mm),
                sensor_size_mm=truth.sensor_mm,
                f_number=4.0,
                focus_distance_mm=focus_mm,
                target_distance_mm=tape,
            )
        )
    return takes


def _seen(truth: Truth, pitch_mm, turn_deg, where, rng):
    """Points on the frame and their lattice; where: target and focus distance, mm."""
    distance_mm, focus_mm = where
    i, j = np.meshgrid(np.arange(-24.0, 25), np.arange(-18.0, 19))
    lattice = np.stack([i.ravel(), j.ravel()], 1)
    board = np.column_stack([lattice * pitch_mm, np.zeros(len(lattice))])
    small = rng.normal(0, 0.3, 3)
    turned = np.append(turn_deg, 0.0) + small
    turn = Rotation.from_euler("xyz", turned, degrees=True)
    depth = distance_mm - truth.pupil_mm
    beside = rng.normal(0, 0.3, 2) * pitch_mm
    at = turn.apply(board) + np.append(beside, depth)
    slope = at[:, :2] / at[:, 2:]
    r2 = (slope**2).sum(1, keepdims=True)
    f = truth.focal_length_mm
    c_mm = f * (1 + f / (focus_mm - f)) ** (1 + truth.breathing * 20)
    image = c_mm * slope * (1 + truth.k1 * r2)
    pixel = truth.sensor_mm[0] / SIZE_PX[0]
    points = image / pixel + np.array(SIZE_PX) / 2 + rng.normal(0, 0.05, image.shape)
    inside = ((points > 4) & (points < np.array(SIZE_PX) - 4)).all(1)
    return points[inside], lattice[inside]


def stated_otherwise(takes: list[View], target: str | None = None, **changes):
    """The shoot with other statements, of one target's views or of all."""
    return [
        replace(take, **{k: v(take) for k, v in changes.items()})
        if target in (None, take.target)
        else take
        for take in takes
    ]
