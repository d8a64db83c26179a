"""Chief rays of objects that stand where the lens is focused, wherever the chart stood.

That is where CG stands. A shoot photographs its chart at one distance, and the truth of
every setting of the lens (`truth_lens.json`) is of a flat object at its focus distance.
Keys are focus distances, mm:

    chief_ray_at_focus_px       rms inside the frame after one affine map
    lateral_colour_at_focus_px  r-g and b-g, rms
    covered_at_focus            percent of the errors along x and y within one stated
                                deviation, of a lens that says how well it knows them

A verdict is of the worst place: `frame_errors` are those of the corners, and of the
image scale, which the affine map takes away.
"""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import ArrayLike, Float

from data_synth.judge_spots import GREEN
from data_synth.judged_lens import affinely_aligned
from data_synth.sensor import CHANNELS, Channel, Frame
from lensfit.errors import LensfitError

TRUTH = "truth_lens.json"
_OUTERMOST = 0.9
"""From this share of the largest radius on lie the corners."""


class Projects(Protocol):
    """What is judged here of a lens."""

    def project(self, object_points_mm: ArrayLike, channel: Channel = "g") -> ArrayLike:
        """Sensor mm of object points."""
        ...


@runtime_checkable
class KnowsObjects(Protocol):
    """A lens that says how well it knows where objects land."""

    def object_standard_deviation_mm(self, object_points_mm: ArrayLike) -> ArrayLike:
        """Along x and y, but for an affine map of each plane."""
        ...


class Setting(NamedTuple):
    """What the tracer says of one focus distance.

    Attributes
    ----------
    object_mm : Points (points, 3), z from the sensor.
    landed_mm : Red, green and blue chief rays (points, 3, 2), those inside the frame.
    """

    f_number: float
    focus_mm: float
    object_mm: Float[np.ndarray, "points 3"]
    landed_mm: Float[np.ndarray, "points 3 2"]


def depth_figures(
    make: Callable[[float, float], Projects], folder: Path, frame: Frame
) -> dict[str, Any]:
    """The figures of the module docstring; empty where the folder lacks the truth.

    Parameters
    ----------
    make : Of f-number and focus distance, mm.
    """
    pitch_mm = np.array(frame.pitch_mm)
    chief: dict[str, float] = {}
    colour: dict[str, dict[str, float]] = {}
    covered: dict[str, float] = {}
    for setting in settings_in(folder, frame):
        lens, key = make(setting.f_number, setting.focus_mm), f"{setting.focus_mm:g}"
        points, true = setting.object_mm, np.moveaxis(setting.landed_mm, 1, 0)
        made = np.stack([np.asarray(lens.project(points, channel=c)) for c in CHANNELS])
        off = affinely_aligned(made[GREEN], true[GREEN]) - true[GREEN]
        chief[key] = _rms(off / pitch_mm)
        colour[key] = {
            name: _rms((made[k] - made[GREEN] - true[k] + true[GREEN]) / pitch_mm)
            for name, k in (("r-g", 0), ("b-g", 2))
        }
        stated = _stated_mm(lens, points)
        if stated is not None:
            covered[key] = 100.0 * float(np.mean(np.abs(off) <= stated))
    if not chief:
        return {}
    return {
        "chief_ray_at_focus_px": chief,
        "lateral_colour_at_focus_px": colour,
        "covered_at_focus": covered,
    }


class FrameErrors(NamedTuple):
    """Errors of chief rays where a verdict looks: the worst of all focus distances.

    Attributes
    ----------
    corner_px : Rms over the outermost tenth of the radius, after one affine map.
    scale_px : What the error of the image scale moves the furthest point by.
    """

    corner_px: float
    scale_px: float


def frame_errors(
    make: Callable[[float, float], Projects], folder: Path, frame: Frame
) -> FrameErrors:
    """The errors of a lens in the corners of its frame, and of its image scale.

    Parameters
    ----------
    make : Of f-number and focus distance, mm.
    """
    pitch_mm, found = np.array(frame.pitch_mm), []
    for setting in settings_in(folder, frame):
        lens = make(setting.f_number, setting.focus_mm)
        made_mm = lens.project(setting.object_mm, channel=CHANNELS[GREEN])
        made = np.asarray(made_mm) / pitch_mm
        true = setting.landed_mm[:, GREEN] / pitch_mm
        radius = np.linalg.norm(true, axis=-1)
        outermost = radius > _OUTERMOST * radius.max()
        corner = _rms((affinely_aligned(made, true) - true)[outermost])
        here, there = made - made.mean(0), true - true.mean(0)
        scale = float(np.sum(here * there) / np.sum(here**2)) - 1
        found.append((corner, abs(scale) * float(radius.max())))
    return FrameErrors(*map(max, zip(*found, strict=True)))


def settings_in(folder: Path, frame: Frame) -> Iterator[Setting]:
    """The widest stop at every focus distance."""
    path = folder / TRUTH
    if not path.is_file():
        return
    table = json.loads(path.read_text(encoding="utf-8"))
    widest: dict[float, tuple[float, list]] = {}
    for key, rows in table.items():
        parts = key.split("_")
        if len(parts) != 3 or not parts[1].startswith("f"):
            continue
        f_number, focus_mm = float(parts[1][1:]), float(parts[2].removesuffix("mm"))
        if focus_mm not in widest or f_number < widest[focus_mm][0]:
            widest[focus_mm] = f_number, rows
    middle = np.array(frame.size_px) / 2
    for focus_mm, (f_number, rows) in widest.items():
        known = np.array(rows, float)
        landed = (known[:, 3:9].reshape(-1, 3, 2) - middle) * frame.pitch_mm
        half_mm = np.array(frame.size_mm) / 2
        inside = (np.abs(landed[:, GREEN]) <= half_mm).all(-1)
        yield Setting(f_number, focus_mm, known[inside, :3], landed[inside])


def _stated_mm(lens: Projects, points: np.ndarray) -> np.ndarray | None:
    if not isinstance(lens, KnowsObjects):
        return None
    try:
        return np.asarray(lens.object_standard_deviation_mm(points))
    except LensfitError:
        return None


def _rms(vectors: Float[np.ndarray, "points 2"]) -> float:
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=-1))))
