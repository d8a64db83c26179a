"""The renderer on a path-traced scene and synthetic frames: error, time, bars, peers.

The scene is a CG plate with its depth and the same frame path-traced through a thin
lens. Peers are run in the same process on the same pixels: no defocus at all, a plain
script of layered discs, `cv2.remap` for the warp, and Blender's compositor node where
`bpy` can be imported. Wall seconds count; those of the processor stand beside them,
since other work on the machine does not lengthen them.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np

from data_synth.bench.floor import measured_rates
from data_synth.bench.plot import write_render_plot
from data_synth.bench.render.blender import blender_defocus, python_with_bpy
from data_synth.bench.render.photographed import (
    photographed_rows,
    photographed_scenes,
    preset_of_scene,
)
from data_synth.bench.render.point_images import bundled_preset, point_rows
from data_synth.bench.render.profile import render_profile
from data_synth.bench.render.scenes import (
    Scene,
    camera_of_plate,
    layered_discs,
    plate_scene,
    synthetic_scene,
)
from data_synth.bench.render.whole_processes import process_rows
from data_synth.bench.result import Row, as_tables, bench_result, machine
from data_synth.bench.start import start_rows
from data_synth.bench.times import RUNS, best
from data_synth.bench.warp import warp_row
from lensfit.preset.schema import Preset
from lensfit.preset.store import load_preset
from lensfit.preset.thin_lens import ThinCamera, thin_lens_preset
from lensfit.progress import Progress, silent

TOLERANCES = (3e-4, 1e-3, 3e-3, 1e-2, 3e-2)
_UHD_TOLERANCES = (1e-3, 2e-3, 5e-3, 1e-2, 3e-2)
_FINEST = 0.5
"""Tolerance of what the others are compared with, over the tightest of them."""
_FASTER_THAN_BLENDER = 20
_BLENDER_LIMIT_PX = 64.0
"""Which does not cut the blur of near things short, as a careful artist sets it."""
_UHD = (3840, 2160)
_AREAS_PX = (2.0, 4.0, 8.0, 16.0)
NO_GPU = "no GPU is used: the loops over rays are compiled for the processor"


def bench_render(
    data: str | Path,
    out_dir: str | Path | None = None,
    *,
    preset: str | Path | None = None,
    scene: str | Path | None = None,
    quick: bool = False,
    blender: str | None = None,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Measure everything.

    Parameters
    ----------
    data : Folder with plates/ (camera.json, plate.0001.exr, reference.0001.exr) and,
        for scenes that were photographed through a real lens, oracle/; or the folder
        of the plate itself.
    out_dir : Folder for bench_render.json and a plot of error against time.
    preset : A fitted preset whose blur was measured, for images of points, scenes and
        times; by default that of the first photographed scene, fitted now, or else
        that of a checkout of lensfit.
    scene : Folder of one more CG scene, with its photograph through the lens of
        `preset`.
    quick : Leave the frames of eight million pixels out.
    blender : Interpreter that has `bpy`, for Blender's Defocus node; this one, if it
        has, when None.

    Returns
    -------
    "rows", "curves" (error against time; time against pixels and blur), "profiles"
    (seconds by stage), "floors", "machine" and "notes".

    Raises
    ------
    LensfitError : Something cannot be read or written.
    """
    on, rates = machine(), measured_rates()
    folder = _folder_of_plate(Path(data))
    camera = camera_of_plate(folder)
    blender = blender or python_with_bpy()
    notes = [NO_GPU]
    notes += [] if blender else ["Blender's Defocus node: bpy is not installed"]
    progress("render", 0, 6)
    seen, fitted = _photographed(Path(data), preset, scene)
    progress("render", 1, 6)
    traced = plate_scene(folder, thin_lens_preset(camera), camera)
    plate, rows = _error_against_time(traced, TOLERANCES)
    rows = [*seen, *_plate_rows(traced, camera, blender), *rows, *_law_rows(camera)]
    progress("render", 2, 6)
    rows += process_rows(fitted, camera, quick=quick)
    curves = {"plate": plate, "pixels": _pixels(camera), "blur": _areas(camera)}
    progress("render", 4, 6)
    if not quick:
        uhd = synthetic_scene(camera, *_UHD)
        curves["uhd"], _ = _error_against_time(uhd, _UHD_TOLERANCES, runs=1)
        rows.append(warp_row(*_UHD))
    progress("render", 5, 6)
    if fitted is None:
        notes.append("no fitted preset (--preset): its point images are not measured")
    else:
        rows += point_rows(fitted, quick=quick)
    profile = render_profile(traced, rates, fitted)
    rows += [*profile.rows, *start_rows("render", folder), _memory_row()]
    found = {"rows": as_tables(rows), "curves": curves, "notes": notes}
    where = {"profiles": profile.profiles, "floors": profile.floors}
    where["rates"] = rates._asdict()
    result = bench_result("render", on, out_dir, **found, **where)
    if out_dir is not None:
        write_render_plot(result, Path(out_dir))
    progress("render", 6, 6)
    return result


def _folder_of_plate(data: Path) -> Path:
    """The folder itself if it holds the plate, or that of plates in it."""
    return data if (data / "camera.json").is_file() else data / "plates"


def _photographed(
    data: Path, preset: str | Path | None, scene: str | Path | None
) -> tuple[list[Row], Preset | None]:
    """Rows of photographed scenes, and the fitted lens for everything else."""
    given = None if preset is None else load_preset(preset)
    rows, fitted = [], given
    for folder in photographed_scenes(data):
        own = given or preset_of_scene(folder)
        if own is not None:
            rows += photographed_rows(folder, own)
            fitted = fitted or own
    if scene is not None and fitted is not None:
        rows += photographed_rows(Path(scene), fitted)
    if fitted is None:
        bundled = bundled_preset()
        fitted = None if bundled is None else load_preset(bundled)
    return rows, fitted


def psnr_db(picture: np.ndarray, reference: np.ndarray) -> float:
    """Both clipped to 0..1, linear."""
    away = np.clip(picture, 0, 1) - np.clip(reference, 0, 1)
    return float(-10 * np.log10(np.mean(away**2)))


def _error_against_time(
    scene: Scene, tolerances: tuple[float, ...], runs: int = RUNS
) -> tuple[list[dict[str, float]], list[Row]]:
    """One point for each tolerance, against the finest and against the truth."""
    finest = np.clip(scene.render(_FINEST * min(tolerances)), 0, 1)
    points, rows = [], []
    for tolerance in tolerances:
        if runs > 1:
            scene.render(tolerance)  # programs and rays are made once
        found, wall, cpu = best(lambda t=tolerance: scene.render(t), runs)
        away = np.clip(found, 0, 1) - finest
        point = {
            "tolerance": tolerance,
            "expected": scene.expected_error(tolerance),
            "rms": float(np.sqrt(np.mean(away**2))),
            "seconds": wall,
            "cpu_seconds": cpu,
            "seconds_per_megapixel": wall / scene.megapixels,
        }
        if scene.reference is not None:
            point["psnr_db"] = psnr_db(found, scene.reference)
        points.append(point)
        if tolerance >= 1e-3:
            what = f"rms at tolerance {tolerance:g}, of the finest"
            rows.append(Row(scene.name, what, point["rms"], bar=1.5 * tolerance))
    return points, rows


def _plate_rows(scene: Scene, camera: ThinCamera, blender: str | None) -> list[Row]:
    """Against the path-traced reference, with peers; Blender's time sets the bar."""
    assert scene.reference is not None
    scene.render(1e-3, mattes=True)
    found, wall, cpu = best(lambda: scene.render(1e-3, mattes=True))
    discs, discs_s, _ = best(lambda: layered_discs(scene), 1)
    pictures = {
        "no defocus": scene.undefocused(),
        "layered discs": discs,
        "without mattes": scene.render(1e-3),
    }
    seconds, bar = {"processor": cpu, "layered discs": discs_s}, None
    if blender is not None:
        radius_px = np.abs(scene.circle().radius_px(scene.depth_mm[scene.inside]))
        tight_px = float(np.ceil(radius_px.max()))
        for name, limit_px in (
            ("Blender Defocus", _BLENDER_LIMIT_PX),
            (f"Blender Defocus, limit {tight_px:g} px", tight_px),
        ):
            run = blender_defocus(scene, camera, blender, limit_px)
            pictures[name], seconds[name] = run
        bar = seconds["Blender Defocus"] / _FASTER_THAN_BLENDER
    peers = {name: psnr_db(one, scene.reference) for name, one in pictures.items()}
    value, size = psnr_db(found, scene.reference), scene.megapixels
    return [
        Row("plate", "PSNR, dB", value, bar=38.0, aim=40.0, peers=peers, least=True),
        Row("plate", "seconds", wall, bar=bar, aim=size, peers=seconds),
        Row("plate", "seconds per megapixel", wall / size, bar=None, aim=1.0),
    ]


def _law_rows(camera: ThinCamera) -> list[Row]:
    """Energy, constancy, identity, on a small frame."""
    scene = synthetic_scene(camera, 480, 270)
    near = np.full_like(scene.depth_mm, 500 * camera.focus_distance_m)
    worst = 0.0
    for row, column in ((135, 240), (40, 60), (230, 430)):
        for value in (0.5, 300.0):
            point = np.zeros_like(scene.rgb)
            point[row, column] = value
            lit = scene.render(1e-3, rgb=point, depth_mm=near)
            worst = max(worst, abs(float(lit.sum()) / (3 * value) - 1))
    flat = np.full_like(scene.rgb, 0.6)
    moved = float(np.abs(scene.render(1e-3, rgb=flat) - flat).max())
    focus = np.full_like(near, 1000 * camera.focus_distance_m)
    same = scene.render(1e-3, depth_mm=focus).tobytes() == scene.rgb.tobytes()
    return [
        Row("laws", "energy of a point, relative error", worst, bar=1e-3),
        Row("laws", "a constant, largest change", moved, bar=1e-5),
        Row("laws", "zero blur, frames that lost a bit", float(not same), bar=0.0),
    ]


def _pixels(camera: ThinCamera) -> list[dict[str, float]]:
    """Seconds against pixels, blur growing with the frame."""
    points = []
    for width in (480, 960, 1920):
        scene = synthetic_scene(camera, width, width * 9 // 16)
        scene.render(3e-3)
        _, wall, cpu = best(lambda s=scene: s.render(3e-3), 2)
        size = scene.megapixels
        points.append({"megapixels": size, "seconds": wall, "cpu_seconds": cpu})
    return points


def _areas(camera: ThinCamera) -> list[dict[str, float]]:
    """Seconds against the area of the blur, one distance."""
    scene = synthetic_scene(camera, 1280, 720)
    points = []
    for radius in _AREAS_PX:
        depth = np.full_like(scene.depth_mm, scene.circle().depth_mm(radius))
        scene.render(3e-3, depth_mm=depth)
        _, wall, cpu = best(lambda d=depth: scene.render(3e-3, depth_mm=d), 2)
        area = math.pi * radius**2
        points.append({"blur_area_px": area, "seconds": wall, "cpu_seconds": cpu})
    return points


def _memory_row() -> Row:
    import resource

    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    return Row("memory", "of the whole run so far, GiB", most, bar=4.0)
