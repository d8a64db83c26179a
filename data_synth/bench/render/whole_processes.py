"""Frames as a farm job makes them: `lensfit apply` in a process of its own.

Start, reading, rays, the frame and writing count, as do all threads and the largest
memory that the process ever held; the operating system's own accounting of a finished
process tells them. Programs compiled by an earlier run are kept on disk, as they are on
any machine that has rendered a frame before.
"""

import json
import math
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

from data_synth.bench.render.scenes import synthetic_scene
from data_synth.bench.result import Row
from lensfit.errors import LensfitError
from lensfit.io.exr import ExrImage, ExrPart, write_exr
from lensfit.preset.schema import Preset
from lensfit.preset.store import save_preset
from lensfit.preset.thin_lens import ThinCamera, thin_lens_preset

HALF_HD, HD, UHD = (960, 540), (1920, 1080), (3840, 2160)
_F_NUMBER = 2.0
_PULL = 24
_STEP_OF_FOCUS = 0.02
"""Of the focus distance, from frame to frame of a pull."""
_FOCUS_OF_A_LENS = 40.0
"""In focal lengths, where the preset states none."""
_GIB = 2.0**30
_COMMAND = "from lensfit.cli.main import main; main()"
_ACCOUNTANT = """
import json, os, subprocess, sys, tempfile, time
with tempfile.TemporaryFile() as said:
    began = time.perf_counter()
    process = subprocess.Popen(sys.argv[1:], stdout=said, stderr=subprocess.STDOUT)
    _, status, used = os.wait4(process.pid, 0)
    seconds = time.perf_counter() - began
    said.seek(0)
    print(json.dumps({
        "exit_code": os.waitstatus_to_exitcode(status),
        "said": said.read().decode(errors="replace"),
        "seconds": seconds,
        "cpu_seconds": used.ru_utime + used.ru_stime,
        "most": used.ru_maxrss,
    }))
"""
"""Starts the command from a small process: the memory that the system states for a
process includes what the one that started it held at that moment."""


class Spent(NamedTuple):
    """What a process took.

    Attributes
    ----------
    seconds, cpu_seconds : On the wall, and of all processors.
    memory_gib : The most it held at a time.
    """

    seconds: float
    cpu_seconds: float
    memory_gib: float

    def rows(self, name: str, what: str, bars: "Bars", frames: int = 1) -> list[Row]:
        """Seconds (of two cores: half of the processors' where the machine is busy)
        and memory."""
        busy = {"processor, s": self.cpu_seconds / frames}
        seconds = self.seconds / frames
        return [
            Row(name, f"{what}, s", seconds, bars.seconds, bars.aim_seconds, busy),
            Row(name, f"{what}, GiB", self.memory_gib, bars.memory_gib),
        ]


class Bars(NamedTuple):
    """What a frame may take, and should."""

    seconds: float | None = None
    aim_seconds: float | None = None
    memory_gib: float | None = None


FITTED = {
    HALF_HD: Bars(6.0, 3.0, 2.0),
    HD: Bars(20.0, 10.0, 3.0),
    UHD: Bars(45.0, 22.5, 6.0),
}
THIN = {UHD: Bars(20.0, 8.0)}
PULL = Bars(4.0, 2.0)


def process_rows(
    fitted: Preset | None, camera: ThinCamera, *, quick: bool = False
) -> list[Row]:
    """Whole processes at the default tolerance, of a synthetic scene at f/2.

    Parameters
    ----------
    fitted : A lens whose blur was measured; only the ideal one is timed if None.
    camera : The ideal lens.
    quick : Leave the frames of over a million pixels out.

    Raises
    ------
    LensfitError : `lensfit apply` fails.
    """
    rows = []
    lenses = {"thin lens": (thin_lens_preset(camera), THIN)}
    if fitted is not None:
        lenses["fitted lens"] = fitted, FITTED
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for lens, (preset, sizes) in lenses.items():
            save_preset(preset, folder / "preset.json")
            # The first run of all compiles what the others load.
            spent_on(folder, preset, HALF_HD)
            for size in sizes:
                if quick and size != HALF_HD:
                    continue
                spent = spent_on(folder, preset, size)
                what = f"{size[0]} x {size[1]}, a new process"
                rows += spent.rows(lens, what, sizes[size])
        if fitted is not None and not quick:
            spent = spent_on(folder, fitted, HALF_HD, frames=_PULL)
            what = f"{HALF_HD[0]} x {HALF_HD[1]}, a frame of a pull of focus"
            rows += spent.rows("fitted lens", what, PULL, _PULL)
    return rows


def spent_on(
    folder: Path, preset: Preset, size_px: tuple[int, int], *, frames: int = 1
) -> Spent:
    """What `lensfit apply` takes for plates of a size; the focus moves from frame to
    frame.

    Parameters
    ----------
    folder : Holds preset.json; plates and results are written beside it.

    Raises
    ------
    LensfitError : It fails.
    """
    camera = _camera(preset, size_px)
    scene = synthetic_scene(camera, *size_px)
    channels = {c: scene.rgb[..., k] for k, c in enumerate("RGB")}
    channels["Z"] = scene.depth_mm
    for frame in range(frames):
        focus_m = camera.focus_distance_m * (1 + _STEP_OF_FOCUS * frame)
        state = {
            "nominalFocalLength": float(camera.focal_length_mm),
            "aperture": camera.f_number,
            "focus": focus_m,
        }
        part = ExrPart(channels, scene.data_window, scene.display_window, state)
        path = folder / f"plate.{1001 + frame}.exr"
        write_exr(path, ExrImage((part,)), compression="zips")
    plates = folder / ("plate.####.exr" if frames > 1 else "plate.1001.exr")
    command = [sys.executable, "-c", _COMMAND, "apply"]
    command += [str(folder / "preset.json"), str(plates), "--depth-unit", "mm"]
    command += ["--overwrite", "--out", str(folder / "out")]
    return _spent(command)


def _camera(preset: Preset, size_px: tuple[int, int]) -> ThinCamera:
    entry = preset.entries[0]
    focus_mm = entry.focus_distance_mm or math.inf
    if not math.isfinite(focus_mm):
        focus_mm = _FOCUS_OF_A_LENS * entry.focal_length_mm
    return ThinCamera(
        focal_length_mm=entry.focal_length_mm,
        f_number=_F_NUMBER,
        focus_distance_m=focus_mm / 1000,
        sensor_width_mm=preset.camera.sensor_width_mm,
        width_px=size_px[0],
        height_px=size_px[1],
    )


def _spent(command: list[str]) -> Spent:
    run = [sys.executable, "-S", "-c", _ACCOUNTANT, *command]
    process = subprocess.run(run, capture_output=True, text=True, check=True)
    account = json.loads(process.stdout)
    if account["exit_code"]:
        lines = account["said"].strip().splitlines()
        raise LensfitError(
            f"lensfit apply failed ({lines[-1] if lines else 'without a word'})",
            remedy="apply the preset to a plate by itself",
        )
    unit = 1 if sys.platform == "darwin" else 1024
    memory_gib = account["most"] * unit / _GIB
    return Spent(account["seconds"], account["cpu_seconds"], memory_gib)
