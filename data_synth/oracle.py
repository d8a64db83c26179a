"""Photographs and truth of another ray tracer, read as a shoot of this one.

The folder holds a shoot and what its tracer knows, z from scene to sensor, x right, y
up, origin in the middle of the frame's picture as it is seen:

    truth_lens.json    the frame, the plan: chart and focus distances, f-numbers
    NAME_truth.json    of each photograph, per dot: indices, place on the chart, pixels
                       of the chief rays and centroids in r, g, b, flux
    truth_psf.npz      spots: a row of `index` for each (focus, f-number, field point,
                       channel, samples to a pixel, first column and row in samples,
                       height, width, offset into `data`, ...)
    truth_tables.npz   irradiance over a quadrant of the frame

All of it becomes a `WavefrontTruth`. Fall-off is known for green alone (red and blue
are NaN); no setting is known that was not photographed.
"""

import json
import shutil
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.interpolate import RBFInterpolator

from data_synth.judge_spots import GREEN
from data_synth.psf_truth import TABLE_STEPS, Group, WavefrontTruth, write_truth
from data_synth.sensor import CHANNELS, Frame
from data_synth.spots import SIZES

FOCUS_STATES = ("in", "near", "far")
_SHOOT = "shoot.toml"
_MARGIN = 2
"""Samples around a spot."""


def write_oracle_shoot(oracle: Path, folder: Path) -> None:
    """Copy the photographs of such a folder, and write their truth beside them.

    Raises
    ------
    OSError : A file is missing.
    """
    folder.mkdir(parents=True, exist_ok=True)
    takes = tomllib.loads((oracle / _SHOOT).read_text())["take"]
    for take in takes:
        shutil.copyfile(oracle / take["image"], folder / take["image"])
    write_truth(folder, oracle_truth(oracle))
    shutil.copyfile(oracle / _SHOOT, folder / _SHOOT)


def oracle_truth(oracle: Path) -> WavefrontTruth:
    """What such a folder knows of its lens.

    Raises
    ------
    OSError : A file is missing.
    """
    about = json.loads((oracle / "truth_lens.json").read_text())
    frame, plan = _frame(about["frame"]), about["plan"]
    chart_mm = float(plan["D"])
    stops = [float(stop) for stop in plan["stops"]]
    focus_mm = {"in": chart_mm, "near": float(plan["near"]), "far": float(plan["far"])}
    dots = {s: _dots(oracle, stops[0], s) for s in FOCUS_STATES}
    table, chief_mm = _chief_table(dots, frame, chart_mm)
    groups, spots, chiefs, field_mm = _spots(oracle, focus_mm, chart_mm, dots, frame)
    light_mm, light = _light(oracle, stops)
    return WavefrontTruth(
        frame=frame,
        focal_length_mm=float(plan["focal"]),
        chart_distance_mm=chart_mm,
        groups=tuple(groups),
        psf=tuple(spots),
        spot_chief_mm=np.array(chiefs),
        spot_object_mm=np.array(field_mm),
        focus_mm=tuple(focus_mm.values()),
        chief_object_mm=table,
        chief_mm=chief_mm,
        settings=tuple((stop, chart_mm) for stop in stops),
        light_mm=light_mm,
        light=light,
    )


def _frame(about: dict[str, Any]) -> Frame:
    width, height, pitch_mm = int(about["W"]), int(about["H"]), float(about["pitch_mm"])
    return Frame((width, height), (width * pitch_mm, height * pitch_mm))


def _dots(oracle: Path, stop: float, state: str) -> Float[np.ndarray, "dots columns"]:
    stem = f"dots_f{stop:g}".replace(".", "p")
    text = (oracle / f"{stem}_{state}_truth.json").read_text()
    return np.array(json.loads(text)["dots"])


def _chief_table(dots: dict[str, np.ndarray], frame: Frame, chart_mm: float):
    """Every other dot, so that the table has as many points as this tracer's: object
    points, and where their chief rays land for each focus, (focus, points, 3, 2)."""
    columns, rows = (2 * np.arange(n) - (n - 1) for n in TABLE_STEPS)
    places = np.stack(np.meshgrid(columns, -rows), -1).reshape(-1, 2)
    points, landed = np.zeros((0, 3)), []
    for found in dots.values():
        number = {(int(i), int(j)): k for k, (i, j) in enumerate(found[:, :2])}
        wanted = found[[number[i, j] for i, j in places.tolist()]]
        points = _objects(wanted[:, 2:4], chart_mm)
        landed.append(frame.mm_from_px(wanted[:, 4:10].reshape(-1, 3, 2)))
    return points, np.array(landed)


def _objects(place_mm: Float[np.ndarray, "points 2"], distance_mm: float):
    """Points of an upright chart; its y runs up."""
    upright = place_mm * np.array([1.0, -1.0])
    return np.column_stack([upright, np.full(len(place_mm), distance_mm)])


def _spots(oracle, focus_mm: dict[str, float], chart_mm: float, dots, frame: Frame):
    """Groups of focus and f-number, and of each its spots, chief rays and objects."""
    with np.load(oracle / "truth_psf.npz") as known:
        index, data = known["index"], known["data"]
        field_mm = known["field_obj_mm"]
    groups, spots, chiefs, objects = [], [], [], []
    for k, state in enumerate(FOCUS_STATES):
        found = dots[state]
        chief_of = RBFInterpolator(found[:, 2:4], found[:, 6:8], kernel="quintic")
        chief_px = chief_of(field_mm)
        for stop in np.unique(index[:, 1]):
            rows = index[(index[:, 0] == k) & (index[:, 1] == stop)]
            samples = int(rows[0, 4])
            spot = _centred(rows, data, chief_px * samples, samples)
            setting = (float(stop), focus_mm[state], chart_mm)
            groups.append(Group(*setting, True, samples, spot.shape[-1]))
            spots.append(spot)
            chiefs.append(frame.mm_from_px(chief_px))
            objects.append(_objects(field_mm, chart_mm))
    return groups, spots, chiefs, objects


def _centred(
    rows: Float[np.ndarray, "spots columns"],
    data: np.ndarray,
    chief: Float[np.ndarray, "fields 2"],
    samples: int,
) -> Float[np.ndarray, "fields 3 size size"]:
    """Spots with the sample of their chief ray in the middle, each summing to 1."""
    if not (rows[:, 4] == samples).all():
        raise ValueError("spots of one setting are sampled differently")
    whole = np.round(chief).astype(int)
    low = rows[:, 5:7].astype(int) - whole[rows[:, 2].astype(int)]
    high = low + rows[:, [8, 7]].astype(int)
    reach = int(np.abs(np.concatenate([low, high])).max()) + _MARGIN
    size = next(n for n in SIZES if n >= 2 * reach and n % samples == 0)
    spots = np.full((len(chief), len(CHANNELS), size, size), np.nan)
    for row, first, last in zip(rows, low + size // 2, high + size // 2, strict=True):
        (height, width, offset) = row[7:10].astype(int)
        light = data[offset : offset + height * width].reshape(height, width)
        spot = np.zeros((size, size))
        spot[first[1] : last[1], first[0] : last[0]] = light
        spots[int(row[2]), int(row[3])] = spot / spot.sum()
    return spots


def _light(oracle: Path, stops: list[float]):
    """Irradiance over the whole frame from its quadrant, (stops, points, 3)."""
    with np.load(oracle / "truth_tables.npz") as known:
        x_mm, y_mm = known["ri_x_mm"], known["ri_y_mm"]
        tables = [known[f"ri_f{stop:g}".replace(".", "p")] for stop in stops]
    quadrant_mm = np.stack(np.meshgrid(x_mm, y_mm, indexing="ij"), -1).reshape(-1, 2)
    signs = np.array([[1, 1], [-1, 1], [1, -1], [-1, -1]])
    places = np.concatenate([quadrant_mm * sign for sign in signs])
    light = np.full((len(stops), len(places), len(CHANNELS)), np.nan)
    for k, table in enumerate(tables):
        light[k, :, GREEN] = np.tile(table.ravel(), len(signs))
    return np.array([places] * len(stops)), light
