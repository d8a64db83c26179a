"""Blender's compositor Defocus node, on the plate that the renderer is measured on.

`bpy` exists for one version of Python only, so the interpreter that has it may be
another than this one. Blender runs in a process of its own; its start is not counted.
"""

import json
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from jaxtyping import Float32

from data_synth.bench.own_process import output_of
from data_synth.bench.render.scenes import Scene
from lensfit.io.exr import ExrImage, ExrPart, read_exr, write_exr
from lensfit.preset.thin_lens import ThinCamera

_SCRIPT = Path(__file__).with_name("blender_defocus.py")
_PATIENCE_S = 900
_NAME = "defocused_"


def python_with_bpy() -> str | None:
    """This interpreter, if it can run Blender itself."""
    return sys.executable if find_spec("bpy") else None


def blender_defocus(
    scene: Scene, camera: ThinCamera, python: str, largest_blur_px: float
) -> tuple[Float32[np.ndarray, "height width 3"], float]:
    """The display window through the Defocus node, and the seconds it took.

    Parameters
    ----------
    python : Interpreter that has `bpy`.
    largest_blur_px : The node's limit. Its time grows with the square of the limit,
        whatever the picture's own blur is.

    Raises
    ------
    LensfitError : Blender did not run.
    """
    with tempfile.TemporaryDirectory() as folder:
        told = task_of(scene, camera, Path(folder))
        task = told | {"largest_blur_px": largest_blur_px}
        path = Path(folder) / "task.json"
        path.write_text(json.dumps(task))
        lines = output_of(
            [python, str(_SCRIPT), str(path)],
            patience_s=_PATIENCE_S,
            failed="Blender did not run",
            where=python,
            remedy="give --blender a Python in which `import bpy` works",
        )
        line = next(x for x in lines if x.startswith('{"seconds"'))
        made = read_exr(next(Path(folder).glob(f"{_NAME}*.exr"))).parts[0].channels
        return np.stack([made[c] for c in "RGB"], -1), json.loads(line)["seconds"]


def task_of(scene: Scene, camera: ThinCamera, folder: Path) -> dict[str, object]:
    """Write what Blender reads; what the script is told."""
    shown = scene.display_window
    depth_m = np.where(np.isfinite(scene.depth_mm), scene.depth_mm / 1000, 1e6)
    inside = scene.inside
    pictures = {
        "colour": scene.rgb[inside],
        "depth_m": np.repeat(depth_m[inside][..., None], 3, -1),
    }
    paths = {}
    for name, pixels in pictures.items():
        paths[name] = str(folder / f"{name}.exr")
        channels = {
            c: np.asarray(pixels[..., k], np.float32) for k, c in enumerate("RGB")
        }
        write_exr(paths[name], ExrImage((ExrPart(channels, shown, shown),)))
    return paths | {
        "focal_length_mm": camera.focal_length_mm,
        "f_number": camera.f_number,
        "focus_distance_m": camera.focus_distance_m,
        "sensor_width_mm": camera.sensor_width_mm,
        "size_px": [shown.width, shown.height],
        "folder": str(folder),
        "name": _NAME,
    }
