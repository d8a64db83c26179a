"""How near every format of other programs is to a lens, both ways, in one table.

The lens is exported, the file is read back as the other program's own model, and both
are asked at a grid of points over the frame: where rays land on the photograph, and
where its points lie in the undistorted picture. Then lensfit's terms are fitted to the
file, as `lensfit preset import` does, which has an error of its own.

What is a camera of a path tracer is rendered by it, where a Python has Blender's `bpy`
(`data_synth.bench.cycles`).
"""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from data_synth.bench.cycles.benchmark import bench_cycles
from data_synth.bench.render.blender import python_with_bpy
from data_synth.bench.result import as_tables, bench_result, machine
from lensfit.batches import in_batches
from lensfit.errors import LensfitError
from lensfit.exchange.export import FORMATS, export_preset
from lensfit.exchange.export_request import ExportRequest, WantedState
from lensfit.exchange.foreign import ForeignState, StatedValues
from lensfit.exchange.imports import preset_of_foreign, read_foreign
from lensfit.exchange.samples import ExchangeFrame
from lensfit.lens import Lens
from lensfit.preset.schema import Preset
from lensfit.progress import Progress, silent

_POINTS = 41
_SUFFIX = {
    "usd": ".usda",
    "opencv": ".yaml",
    "opentrackio": ".json",
    "lensfun": ".xml",
    "mrcal-opencv": ".cameramodel",
    "mrcal-splined": ".cameramodel",
    "unreal": ".ulens",
    "syntheyes": ".lni",
    "cycles-osl": ".osl",
}
_ONLY_WRITTEN = ("cycles-osl",)
_KNOWS_NO_DISTANCE = ("lensfun", "stmap")
"""Formats that relate two pictures and know no rays."""


def bench_exchange(
    preset: Preset,
    state: WantedState,
    frame: ExchangeFrame,
    out_dir: str | Path | None = None,
    *,
    blender: str | None = None,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Export a lens in every format and read it back; render through it by Cycles.

    Parameters
    ----------
    state : Which of its states.
    frame : Pixels that the points lie in; every file is made for them.
    out_dir : Folder for bench_exchange.json and cycles.jpg; none if None.
    blender : Interpreter that has `bpy`; this one, if it has, where None is given.

    Returns
    -------
    "formats": for each "format" the "landed" px (rms, worst) on the photograph, the
    "straight" px in the undistorted picture, the "imported" px of lensfit's own terms
    against the file; of a camera of rays, which nobody reads back, "landed" and the
    "rays" of the whole pupil; or the "error". "cycles": bars of Cycles; "notes",
    "errors" and "machine".

    Raises
    ------
    LensfitError : The preset does not reach the state, or the results cannot be
        written.
    """
    on, lens, rows = machine(), preset.at(*state), []
    formats = [name for name in FORMATS if name != "nuke-stmap"]  # the same maps
    for done, to in enumerate(formats):
        progress("formats", done, len(formats))
        with tempfile.TemporaryDirectory() as folder:
            try:
                found = _nearness(to, lens, preset, state, frame, Path(folder))
            except LensfitError as error:
                found = {"error": error.what}
        rows.append({"format": to} | found)
    progress("formats", len(formats), len(formats))
    cycles, notes, errors = [], [], []
    python = blender or python_with_bpy()
    if python is None:
        notes.append("Cycles: bpy is not installed (--blender names its Python)")
    else:
        try:
            cycles = bench_cycles(preset, state, python, out_dir, progress=progress)
        except LensfitError as error:
            errors.append(str(error))
    said = {"cycles": as_tables(cycles), "notes": notes, "errors": errors}
    return bench_result("exchange", on, out_dir, formats=rows, **said)


def _nearness(
    to: str,
    lens: Lens,
    preset: Preset,
    state: WantedState,
    frame: ExchangeFrame,
    folder: Path,
) -> dict[str, Any]:
    out = folder if to == "stmap" else folder / f"lens{_SUFFIX.get(to, '.nk')}"
    written = export_preset(to, ExportRequest(preset, state, frame, out))
    if to in _ONLY_WRITTEN:
        chief, rays, _ = (one.residual for one in written.nearness)
        assert chief is not None
        assert rays is not None
        return {"landed": list(chief), "rays": list(rays)}
    stated = StatedValues(
        sensor_width_mm=frame.sensor_width_mm,
        focal_length_mm=lens.focal_length_mm,
        focus_distance_mm=lens.focus_distance_mm,
        size_px=frame.size_px,
    )
    foreign = read_foreign(written.paths[-1], stated)
    theirs = min(
        foreign.states,
        key=lambda one: abs(one.focal_length_mm - (lens.focal_length_mm or 0)),
    )
    landed, straight = _apart_px(lens, theirs, frame, to in _KNOWS_NO_DISTANCE)
    fitted = preset_of_foreign(foreign, written.paths[-1]).fits[0].distortion
    return {
        "landed": _rms_and_worst(landed),
        "straight": _rms_and_worst(straight),
        "imported": [fitted.rms_px, fitted.worst_px],
    }


def _apart_px(
    lens: Lens, theirs: ForeignState, frame: ExchangeFrame, as_pictures: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Distances of the same rays on the photograph, and of the same points of the
    photograph in the undistorted picture, px."""
    # From the first pixel's centre to the last one's: maps know no more.
    half = (np.array(frame.area_mm) - frame.pitch_mm) / 2
    t = np.linspace(-1, 1, _POINTS)
    points = np.stack(np.meshgrid(t, t), -1).reshape(-1, 2) * half
    straight = in_batches(lens.undistorted_from_distorted, points)
    mine = np.asarray(lens.distortion.principal_point_mm, float)
    scale, own, other = 1.0, np.zeros(2), np.zeros(2)
    if not as_pictures:
        own, other = mine, np.array(theirs.principal_point_mm)
        scale = float(lens.distortion.principal_distance_mm)
        scale = theirs.principal_distance_mm / scale
    landed = theirs.map.distorted(other + (straight - own) * scale)
    back = own + (theirs.map.undistorted(points) - other) / scale
    return (
        np.linalg.norm(landed - points, axis=-1) / frame.pitch_mm,
        np.linalg.norm(back - straight, axis=-1) / frame.pitch_mm,
    )


def _rms_and_worst(off: np.ndarray) -> list[float]:
    """Where both know the point."""
    return [float(np.sqrt(np.nanmean(off**2))), float(np.nanmax(off))]
