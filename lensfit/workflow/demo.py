"""The bundled small shoot, from photographs to a finished frame.

The photographs were made by an exact ray trace of a published lens
(`data_synth`), so that the demonstration needs no download and has a known truth.
"""

from importlib.resources import as_file, files
from pathlib import Path
from typing import Any, NamedTuple

from lensfit.errors import LensfitError
from lensfit.plate.apply_options import ApplyOptions
from lensfit.preset.store import load_preset
from lensfit.progress import Progress, silent
from lensfit.workflow.apply import apply
from lensfit.workflow.calibrate import calibrate
from lensfit.workflow.shoot.shoot_file import load_shoot

PLATE = "plate.0001.exr"


class Demonstration(NamedTuple):
    """What a demonstration made.

    Attributes
    ----------
    report : Of the calibration.
    preset : The preset file.
    frame : The CG frame with the lens put on it.
    """

    report: dict[str, Any]
    preset: Path
    frame: Path


def run_demo(out_dir: Path, *, progress: Progress = silent) -> Demonstration:
    """Calibrate the bundled shoot and put its lens on the bundled plate.

    Parameters
    ----------
    out_dir : Folder for everything; results of an earlier run are replaced.
    progress : Receives the progress.

    Raises
    ------
    LensfitError : The bundled shoot is missing, or the results cannot be written.
    """
    bundled = files("data_synth") / "demo"
    if not bundled.is_dir():
        raise LensfitError(
            "the bundled shoot is missing from this installation",
            where="data_synth/demo",
            remedy="install lensfit again",
        )
    with as_file(bundled) as folder:
        shoot = load_shoot(folder / "shoot.toml")
        report = calibrate(shoot, out_dir, progress=progress)
        preset = out_dir / "preset.json"
        applied = apply(
            load_preset(preset),
            folder / PLATE,
            out_dir / "frames",
            options=ApplyOptions(overwrite=True),
            progress=progress,
        )
    if applied.failures:
        raise LensfitError(applied.failures[0])
    return Demonstration(report, preset, applied.written[0])
