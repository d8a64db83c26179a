"""CG scenes with their photograph by exact ray tracing, through the fitted lens.

A folder holds what `lensfit synth scene` writes: a flat plate with Z, its layers, and
the photograph. The lens is fitted to photographs of charts alone: those of a shoot in a
folder beside it that has the lens' name. The frame is compared display-clipped after a
4 x 4 mean, which takes most of the photograph's own noise away.
"""

import json
import tempfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from data_synth.bench.result import Row
from lensfit.coords import Window
from lensfit.errors import ImageError
from lensfit.io.exr import read_exr
from lensfit.lens import Lens
from lensfit.preset.schema import Preset
from lensfit.preset.store import load_preset
from lensfit.rendering.frame import render
from lensfit.rendering.layer_stack import LayerStack
from lensfit.workflow.calibrate import calibrate
from lensfit.workflow.shoot.shoot_file import load_shoot

_MEAN = 4


def photographed_scenes(data: Path) -> list[Path]:
    """Scenes of a data folder whose photographs are there."""
    return sorted(path.parent for path in data.glob("oracle/*/scene.json"))


def preset_of_scene(folder: Path) -> Preset | None:
    """The lens of a scene, fitted to photographs of charts; None where there are none.

    Raises
    ------
    LensfitError : They cannot be calibrated, or the folder is not such a scene.
    """
    shoot = folder.parent / _facts(folder)["lens"] / "shoot.toml"
    if not shoot.is_file():
        return None
    with tempfile.TemporaryDirectory() as out:
        calibrate(load_shoot(shoot), out)
        return load_preset(Path(out) / "preset.json")


def photographed_rows(folder: Path, preset: Preset) -> list[Row]:
    """PSNR of a scene as a deep plate and as a flat one, and of no defocus.

    Parameters
    ----------
    folder : Of the scene.
    preset : Of the lens that photographed it, fitted to photographs of charts.

    Raises
    ------
    ImageError : The folder is not such a scene.
    """
    scene = _facts(folder)
    lens = preset.at(
        focal_length_mm=preset.entries[0].focal_length_mm,
        f_number=scene["f_number"],
        focus_distance_mm=scene["focus_from_sensor_mm"],
    )
    flat = read_exr(folder / "cg_flat.exr").parts[0]
    photograph = _colours(folder / "photo_reference.exr", "RGB")
    data, shown = _windows(flat.data_window, scene["photo_size"])
    rgba = np.stack([flat.channels[c] for c in "RGBA"], -1).astype(np.float32)
    depth = flat.channels["Z"].astype(np.float32)
    stack = _layers(folder, scene)

    def value(pixels: Any, depth_mm: np.ndarray | None) -> float:
        return _psnr_db(_frame(pixels, depth_mm, lens, data, shown), photograph)

    peers = {"no defocus": value(rgba, None)}
    return [
        Row(folder.name, "its layers, PSNR, dB", value(stack, None), 33.0, 35.0, peers,
            least=True),
        Row(folder.name, "flat plate, PSNR, dB", value(rgba, depth), 26.5, 29.0, peers,
            least=True),
    ]  # fmt: skip


def _facts(folder: Path) -> dict[str, Any]:
    try:
        return json.loads((folder / "scene.json").read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ImageError(
            "holds no scene.json of a photographed CG scene",
            where=folder,
            remedy='make one with "lensfit synth scene"',
        ) from error


def _layers(folder: Path, scene: dict[str, Any]) -> LayerStack:
    """Front to back, each at the distance that its own Z or the scene states."""
    paths = sorted(folder.glob("cg_layer*.exr"))
    colours = [_colours(path, "RGBA") for path in paths]
    stated = scene.get("layers_depth_from_pupil_mm")
    depths = [
        np.full(rgba.shape[:2], stated[n], np.float32)
        if stated is not None
        else read_exr(paths[n]).parts[0].channels["Z"].astype(np.float32)
        for n, rgba in enumerate(colours)
    ]
    return LayerStack(np.stack(colours), np.stack(depths))


def _colours(path: Path, names: str) -> np.ndarray:
    channels = read_exr(path).parts[0].channels
    return np.stack([channels[c] for c in names], -1).astype(np.float32)


def _windows(data: Window, photo_size: list[int]) -> tuple[Window, Window]:
    """Of the plate, and of the photograph in the middle of it."""
    left = data.x_min + (data.width - photo_size[0]) // 2
    top = data.y_min + (data.height - photo_size[1]) // 2
    right, bottom = left + photo_size[0] - 1, top + photo_size[1] - 1
    return data, Window(left, top, right, bottom)


def _frame(
    pixels: Any,
    depth_mm: np.ndarray | None,
    lens: Lens,
    data: Window,
    shown: Window,
) -> np.ndarray:
    found = render(pixels, depth_mm, lens, data_window=data, display_window=shown)
    return found[..., :3]


def _psnr_db(picture: np.ndarray, photograph: np.ndarray) -> float:
    height, width = photograph.shape[:2]
    size = width // _MEAN, height // _MEAN
    first, second = (
        cv2.resize(np.clip(p, 0, 1), size, interpolation=cv2.INTER_AREA)
        for p in (picture, photograph)
    )
    return float(-10 * np.log10(np.mean((first - second) ** 2)))
