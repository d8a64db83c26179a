"""Spots, chief rays and fall-off over the frame: what a fit is held to.

For field points all over the frame, each channel, photographed stops and focus states,
and for settings that were never photographed: a stop between, and an object at another
depth. Everything goes into one file, `truth_wavefront.npz`.
"""

import json
import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from data_synth.irradiance import plane_irradiance
from data_synth.lens import SetLens
from data_synth.sensor import Band, Frame
from data_synth.spots import band_chiefs_mm, field_points_mm, spots_of
from lensfit.atomic import atomic_path

FILE_NAME = "truth_wavefront.npz"
FIELD_PARTS = ((-0.92, -0.46, 0.0, 0.46, 0.92), (-0.9, -0.3, 0.3, 0.9))
TABLE_STEPS = (13, 11)
TABLE_REACH = 1.1
"""Chief rays are known over the frame and this much beyond."""

DEPTH_PART = 0.6
"""The unphotographed depth is this part of the largest defocus away, in dioptres."""
DEPTH_CHANGE = 0.35

LensMaker = Callable[[float, float], SetLens]
"""Makes the lens at an f-number and a focus distance (mm)."""


@dataclass(frozen=True)
class Group:
    """Spots of all field points at one setting of the lens and one object distance.

    Attributes
    ----------
    f_number, focus_distance_mm, object_distance_mm : The setting.
    photographed : Whether a fit may have seen it.
    subpixels : Array samples to a pixel.
    size : Side of the arrays, in samples.
    """

    f_number: float
    focus_distance_mm: float
    object_distance_mm: float
    photographed: bool
    subpixels: int = 1
    size: int = 0


@dataclass(frozen=True, eq=False)
class WavefrontTruth:
    """Everything that the tracer says about the lens of one shoot.

    Attributes
    ----------
    frame, focal_length_mm, chart_distance_mm : As a photographer states them.
    groups : Settings with spots; of group k, over field points and r, g, b:
    psf : spots[k] (fields, 3, size, size), each summing to 1; NaN where no light is.
    spot_chief_mm : Where the green chief rays land, mm (groups, fields, 2).
    spot_object_mm : The field points (groups, fields, 3), object space.
    focus_mm : The photographed focus distances.
    chief_object_mm, chief_mm : Grid of object points (points, 3) and where their chief
        rays land (focus, points, 3 channels, 2); NaN where none passes.
    settings : f-number and focus distance of each table of relative illumination.
    light_mm, light : Its points (settings, points, 2) and values (settings, points, 3).
    """

    frame: Frame
    focal_length_mm: float
    chart_distance_mm: float
    groups: tuple[Group, ...]
    psf: tuple[Float[np.ndarray, "fields 3 size size"], ...]
    spot_chief_mm: Float[np.ndarray, "groups fields 2"]
    spot_object_mm: Float[np.ndarray, "groups fields 3"]
    focus_mm: tuple[float, ...]
    chief_object_mm: Float[np.ndarray, "points 3"]
    chief_mm: Float[np.ndarray, "focus points 3 2"]
    settings: tuple[tuple[float, float], ...]
    light_mm: Float[np.ndarray, "settings points 2"]
    light: Float[np.ndarray, "settings points 3"]


@dataclass(frozen=True)
class Settings:
    """Which settings the truth is made for.

    Attributes
    ----------
    photographed, unseen : f-number, focus and object distance of each.
    """

    photographed: tuple[tuple[float, float, float], ...]
    unseen: tuple[tuple[float, float, float], ...] = field(default=())


def settings_for(photographed: tuple[tuple[float, float, float], ...]) -> Settings:
    """Photographed settings, a stop between them at each focus, and another depth.

    Parameters
    ----------
    photographed : f-number, focus and object distance of every take of a square chart.
    """
    stops = sorted({s[0] for s in photographed})
    focus_mm = tuple(dict.fromkeys(s[1] for s in photographed))
    chart_mm = photographed[0][2]
    between = round(math.sqrt(stops[0] * stops[-1]), 2)
    if len(stops) == 1:
        between = round(math.sqrt(2) * stops[0], 2)
    away = max(abs(1 / s - 1 / chart_mm) for s in focus_mm) or DEPTH_CHANGE / chart_mm
    depth_mm = round(1 / (1 / chart_mm - DEPTH_PART * away), 1)
    same = min(focus_mm, key=lambda s: abs(1 / s - 1 / chart_mm))
    unseen = [(between, s, chart_mm) for s in focus_mm]
    unseen += [(n, same, depth_mm) for n in stops]
    return Settings(photographed, tuple(unseen))


def wavefront_truth(
    make: LensMaker,
    frame: Frame,
    bands: tuple[Band, ...],
    settings: Settings,
    focal_length_mm: float,
) -> WavefrontTruth:
    """Trace everything; `make` sets the lens."""
    every = [(s, True) for s in settings.photographed]
    every += [(s, False) for s in settings.unseen]
    widest = min(f_number for (f_number, _, _), _ in every)

    def traced(focus_mm: float, object_mm: float) -> list[tuple]:
        wide = make(widest, focus_mm)
        points = field_points_mm(wide, frame, FIELD_PARTS, object_mm)
        same = [(s, seen) for s, seen in every if s[1:] == (focus_mm, object_mm)]
        lenses = [make(s[0], focus_mm) for s, _ in same]
        chief_mm, drawn = spots_of(wide, lenses, points, frame, bands)
        return [
            (Group(*setting, seen, subpixels, psf.shape[-1]), psf, chief_mm, points)
            for (setting, seen), (psf, subpixels) in zip(same, drawn, strict=True)
        ]

    focused = dict.fromkeys((s[1], s[2]) for s, _ in every)
    with ThreadPoolExecutor() as pool:
        rows = list(chain.from_iterable(pool.map(traced, *zip(*focused, strict=True))))
    groups, spots, chiefs, objects = zip(*rows, strict=True)
    chart_mm = settings.photographed[0][2]
    seen_focus = tuple(dict.fromkeys(s[1] for s in settings.photographed))
    tables = _chief_tables(make, widest, seen_focus, frame, bands, chart_mm)
    stops = tuple(dict.fromkeys(s[:2] for s in settings.photographed))
    light = [_light_table(make(*s), frame, bands, chart_mm) for s in stops]
    return WavefrontTruth(
        frame, focal_length_mm, chart_mm, groups, spots,
        np.array(chiefs), np.array(objects), seen_focus, *tables, stops,
        np.array([points for points, _ in light]), np.array([v for _, v in light]),
    )  # fmt: skip


def geometry_truth(
    make: LensMaker,
    frame: Frame,
    bands: tuple[Band, ...],
    setting: tuple[float, float, float],
    focal_length_mm: float,
) -> WavefrontTruth:
    """Chief rays and fall-off at one f-number, focus and object distance; no spots."""
    f_number, focus_mm, object_mm = setting
    tables = _chief_tables(make, f_number, (focus_mm,), frame, bands, object_mm)
    light_mm, light = _light_table(make(f_number, focus_mm), frame, bands, object_mm)
    return WavefrontTruth(
        frame, focal_length_mm, object_mm, (), (),
        np.zeros((0, 0, 2)), np.zeros((0, 0, 3)), (focus_mm,), *tables,
        ((f_number, focus_mm),), light_mm[None], light[None],
    )  # fmt: skip


def _chief_tables(make: LensMaker, widest, focus_mm, frame, bands, chart_mm):
    """Object points over the frame and beyond, and their chief rays per focus."""
    parts = _table_parts(TABLE_REACH)
    points = field_points_mm(make(widest, focus_mm[0]), frame, parts, chart_mm)
    landed = [
        np.stack([band_chiefs_mm(make(widest, s), points, b) for b in bands], 1)
        for s in focus_mm
    ]
    return points, np.array(landed)


def _table_parts(reach: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    columns, rows = (
        tuple(np.linspace(-reach, reach, steps).tolist()) for steps in TABLE_STEPS
    )
    return columns, rows


def _light_table(lens: SetLens, frame: Frame, bands, chart_mm: float):
    """Where points of an even plane land, and its irradiance against the middle's."""
    parts = _table_parts(1.0)
    points = field_points_mm(lens, frame, parts, chart_mm)
    middle = len(points) // 2
    light = np.stack(
        [
            plane_irradiance(lens, points, b.wavelengths_nm[len(b.wavelengths_nm) // 2])
            for b in bands
        ],
        axis=1,
    )
    return band_chiefs_mm(lens, points, bands[1]), light / light[middle]


def write_truth(folder: Path, truth: WavefrontTruth) -> None:
    """Write the truth into a shoot's folder, in single precision where it may be."""
    meta = {
        "frame": asdict(truth.frame),
        "focal_length_mm": truth.focal_length_mm,
        "chart_distance_mm": truth.chart_distance_mm,
        "groups": [asdict(group) for group in truth.groups],
        "focus_mm": truth.focus_mm,
        "settings": truth.settings,
    }
    arrays: dict[str, Any] = {"meta": np.array(json.dumps(meta))}
    for k, psf in enumerate(truth.psf):
        arrays[f"psf_{k}"] = psf.astype(np.float32)
    for name in _ARRAYS:
        arrays[name] = getattr(truth, name)
    with atomic_path(folder / FILE_NAME) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **arrays)


_ARRAYS = (
    "spot_chief_mm",
    "spot_object_mm",
    "chief_object_mm",
    "chief_mm",
    "light_mm",
    "light",
)


def read_truth(folder: Path) -> WavefrontTruth:
    """What `write_truth` wrote.

    Raises
    ------
    OSError : The folder holds none.
    """
    with np.load(folder / FILE_NAME) as table:
        meta = json.loads(str(table["meta"]))
        groups = tuple(Group(**group) for group in meta["groups"])
        return WavefrontTruth(
            frame=Frame(*(tuple(side) for side in meta["frame"].values())),
            focal_length_mm=meta["focal_length_mm"],
            chart_distance_mm=meta["chart_distance_mm"],
            groups=groups,
            psf=tuple(table[f"psf_{k}"].astype(float) for k in range(len(groups))),
            focus_mm=tuple(meta["focus_mm"]),
            settings=tuple((n, s) for n, s in meta["settings"]),
            **{name: table[name] for name in _ARRAYS},
        )
