"""Point-spread functions over the field, for the report: one sheet per state.

Tiles lie as their points do on the frame: at the middle, half way and near the edge.
Each shows the light to the power `GAMMA`, against its own brightest pixel, since the
skirt of a spot is what differs from lens to lens. All tiles of a sheet have the same
width, found from coarse kernels first and then from finer ones.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from lensfit.errors import LensfitError
from lensfit.lens import Lens
from lensfit.preset.schema import Preset
from lensfit.preset.store import load_preset
from lensfit.report.pictures import png, sheet_of, with_bar
from lensfit.report.plain_numbers import distance_of, round_up

MOST_SHEETS = 24
GAMMA = 0.4
_COLUMNS, _ROWS = (-0.9, -0.45, 0.0, 0.45, 0.9), (-0.9, 0.0, 0.9)
_ENDS = (-0.9, 0.0, 0.9)
_AT_ONCE = len(_COLUMNS) * len(_ROWS)
_THREADS = 2
SIZE_PX = 48
_TOLERANCE, _GLANCE = 0.02, 0.2
_DRAWS = 12
"""Random errors that stand for all: what is expected of whole kernels is within a fifth
then, in a quarter of the time."""
_FIRST_SHARE, _LOOKS = 0.1, 2
"""Width of the first look, as a share of the sensor's; how often to look."""
_INSIDE, _ROOM = 0.97, 1.3
_LEAST_PIXELS = 6.0
_RADIALS = (
    lambda lens: lens.distortion.radial,
    lambda lens: lens.lateral_colour and lens.lateral_colour[0].radial,
    lambda lens: lens.lateral_colour and lens.lateral_colour[1].radial,
)


class KernelState(NamedTuple):
    """What was photographed: a lens state and an object distance."""

    focal_length_mm: float | None
    focus_distance_mm: float | None
    f_number: float
    object_distance_mm: float


@dataclass(frozen=True)
class KernelSheet:
    """The point-spread functions of one state as a picture.

    Attributes
    ----------
    png : The picture.
    width_px, bar_px : Of one tile and of the bar below, in pixels of the camera.
    expected_error : Relative (L2, one standard deviation) of the kernels at the middle
        of the frame and near its edges and corners, rows as they lie; None when the
        preset does not state it.
    """

    state: KernelState
    png: bytes
    width_px: float
    bar_px: float
    expected_error: tuple[tuple[float, ...], ...] | None = None


def kernel_sheets(report: dict, preset_path: Path) -> list[KernelSheet]:
    """Sheets of the states in a report's blur; none if the preset lacks the data."""
    pixel_mm = pixel_of_blur_mm(report)
    if pixel_mm is None:
        return []
    try:
        preset = load_preset(preset_path)
        states = kernel_states(report, preset)[:MOST_SHEETS]
        lenses = lenses_at(preset, states)
    except LensfitError:
        return []
    # Each is many small programs, one after the other, which leave other cores idle.
    with ThreadPoolExecutor(_THREADS) as pool:
        return list(pool.map(_sheet, lenses, states, [pixel_mm] * len(states)))


def pixel_of_blur_mm(report: dict) -> float | None:
    """Pitch of the pixels, where a report tells it and of blur; None elsewhere."""
    camera = report.get("camera") or {}
    across, width_mm = camera.get("image_width_px"), camera.get("sensor_width_mm")
    return width_mm / across if report.get("blur") and across and width_mm else None


def lenses_at(preset: Preset, states: list[KernelState]) -> list[Lens]:
    """The lens at every state, all of which one compiled program serves.

    Raises
    ------
    LensfitError : The preset lacks the data.
    """
    return _with_equal_shapes(
        [
            preset.at(one.focal_length_mm, one.f_number, one.focus_distance_mm)
            for one in states
        ]
    )


def kernel_states(report: dict, preset: Preset) -> list[KernelState]:
    """Distinct states of the takes that the blur was fitted to, in order.

    A take whose chart distance nobody stated counts only if no other shows its state;
    one without an f-number shows the only stop that there is.
    """
    names = {t.get("image") for b in report["blur"] for t in b.get("takes") or []}
    takes = [t for t in report.get("takes") or [] if t.get("image") in names]
    blurs = [entry.blur for entry in preset.entries if entry.blur]
    if not blurs:
        return []
    only = blurs[0].round_f_number
    found: dict[tuple[float | None, float | None, float], set[float]] = {}
    for take in sorted(takes, key=lambda t: t.get("target_distance_mm") is None):
        focal, focus = take.get("focal_length_mm"), take.get("focus_distance_mm")
        lens = distance_of(focal), distance_of(focus), take.get("f_number") or only
        target = take.get("target_distance_mm")
        if target is not None or lens not in found:
            distance = float(target or blurs[0].reference_distance_mm)
            found.setdefault(lens, set()).add(distance)
    states = [
        KernelState(*lens, far) for lens, all_far in found.items() for far in all_far
    ]
    return sorted(states, key=lambda s: tuple(-1.0 if v is None else v for v in s))


def _sheet(lens: Lens, state: KernelState, pixel_mm: float) -> KernelSheet:
    width_mm = width_of_field_mm(lens, state.object_distance_mm, pixel_mm)
    tiles = field_tiles(lens, state.object_distance_mm, width_mm)
    width_px = width_mm / pixel_mm
    bar_px = round_up(width_px / 4)
    picture = with_bar(sheet_of(tiles), bar_px / width_px * SIZE_PX)
    error = expected_errors(lens, state.object_distance_mm, width_mm)
    return KernelSheet(state, png(picture), width_px, bar_px, error)


def field_tiles(
    lens: Lens, distance_mm: float, width_mm: float
) -> Float[np.ndarray, "rows columns size size"]:
    """Brightness of point-spread functions over the field, to show.

    Parameters
    ----------
    width_mm : Of each; `width_of_field_mm` holds them all.

    Raises
    ------
    LensfitError : The lens has no image of an object so near.
    """
    points = _field_points_mm(lens)
    far = np.full(len(points), distance_mm)
    tiles = tiles_of(kernels_at(lens, points, far, width_mm, _TOLERANCE))
    return tiles.reshape(len(_ROWS), len(_COLUMNS), SIZE_PX, SIZE_PX)


def width_of_field_mm(lens: Lens, distance_mm: float, pixel_mm: float) -> float:
    """Width of an array that holds every tile of the field.

    Parameters
    ----------
    pixel_mm : Of the camera; nothing is drawn narrower than a few.

    Raises
    ------
    LensfitError : The lens has no image of an object so near.
    """
    points = _field_points_mm(lens)
    return width_of_blur_mm(lens, points, np.full(len(points), distance_mm), pixel_mm)


def _field_points_mm(lens: Lens) -> Float[np.ndarray, "points 2"]:
    half_mm = np.asarray(lens.sensor_size_mm) / 2
    return np.array([(x, y) for y in _ROWS for x in _COLUMNS]) * half_mm


def width_of_blur_mm(
    lens: Lens,
    points_mm: Float[np.ndarray, "points 2"],
    distances_mm: Float[np.ndarray, " points"],
    pixel_mm: float,
) -> float:
    """Width of an array that holds every point-spread function, with some room.

    Raises
    ------
    LensfitError : The lens has no image of an object so near.
    """
    width_mm = _FIRST_SHARE * lens.sensor_size_mm[0]
    for _ in range(_LOOKS):
        seen = kernels_at(lens, points_mm, distances_mm, width_mm, _GLANCE)
        width_mm = max(_ROOM * reach_share(seen) * width_mm, _LEAST_PIXELS * pixel_mm)
    return width_mm


def expected_errors(
    lens: Lens, distance_mm: float, width_mm: float
) -> tuple[tuple[float, ...], ...] | None:
    """Expected relative error of the shape of point-spread functions, at the middle of
    the frame and near its edges and corners; None where the preset does not state
    it."""
    if lens.moved_blurs is None:
        return None
    half_mm = np.asarray(lens.sensor_size_mm) / 2
    points = np.array([(x, y) for y in _ENDS for x in _ENDS]) * half_mm
    known = lens.known_psfs(
        points,
        distance_mm,
        pixel_pitch_mm=width_mm / SIZE_PX,
        size_px=SIZE_PX,
        tolerance=_GLANCE,
        draws=_DRAWS,
    )
    rows = known.relative_shape_error().reshape(len(_ENDS), -1)
    return tuple(tuple(row) for row in rows.tolist())


def kernels_at(
    lens: Lens,
    points_mm: Float[np.ndarray, "points 2"],
    distances_mm: Float[np.ndarray, " points"],
    width_mm: float,
    tolerance: float,
) -> Float[np.ndarray, "points size size"]:
    """Green kernels on arrays of some width, as many at a time as fill a sheet.

    Raises
    ------
    LensfitError : The lens has no image of an object so near.
    """
    found = []
    for first in range(0, len(points_mm), _AT_ONCE):
        # The last batch is filled up: another number would be another program.
        rows = np.minimum(np.arange(first, first + _AT_ONCE), len(points_mm) - 1)
        kernels = lens.psfs(
            points_mm[rows],
            distances_mm[rows],
            ("g",),
            pixel_pitch_mm=width_mm / SIZE_PX,
            size_px=SIZE_PX,
            tolerance=tolerance,
        )
        found.append(np.asarray(kernels[:, 0]))
    return np.concatenate(found)[: len(points_mm)]


def tiles_of(
    kernels: Float[np.ndarray, "points size size"],
) -> Float[np.ndarray, "points size size"]:
    """Brightness to show, each against its own peak."""
    light = np.maximum(kernels, 0)
    peak = light.max((1, 2), keepdims=True)
    return (light / np.where(peak > 0, peak, 1.0)) ** GAMMA


def reach_share(kernels: Float[np.ndarray, "points size size"]) -> float:
    """Width of the middle square that holds nearly all light of every kernel, as a
    share of the array's; at most 1."""
    size = kernels.shape[-1]
    away = np.abs(np.arange(size) + 0.5 - size / 2)
    square = np.maximum(away[:, None], away[None]) + 0.5
    inside = [
        np.min((kernels * (square <= half)).sum((1, 2)) / kernels.sum((1, 2)))
        for half in range(1, size // 2 + 1)
    ]
    enough = np.flatnonzero(np.array(inside) >= _INSIDE)
    return 2 * float(enough[0] + 1 if len(enough) else size // 2) / size


def _with_equal_shapes(lenses: list[Lens]) -> list[Lens]:
    """The same lenses with as many coefficients each: zeros at the end of a radial
    series change nothing, and one compiled program then serves all."""
    for where in _RADIALS:
        series = [where(one) for one in lenses]
        if any(one is None for one in series):
            continue
        longest = max(len(one) for one in series)
        lenses = [
            eqx.tree_at(where, lens, jnp.pad(one, (0, longest - len(one))))
            for lens, one in zip(lenses, series, strict=True)
        ]
    return lenses
