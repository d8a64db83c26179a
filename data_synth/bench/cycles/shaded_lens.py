"""A lens at a state, and Cycles with its camera shader for a frame.

Cycles runs in a Python that has Blender's `bpy`, in a process of its own: `bpy` exists
for one version of Python only, so the interpreter that has it may be another than this
one.
"""

import json
import math
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float32

from data_synth.bench.own_process import output_of
from lensfit.errors import LensfitError
from lensfit.exchange.export import export_preset
from lensfit.exchange.export_request import ExportRequest, WantedState
from lensfit.exchange.samples import ExchangeFrame
from lensfit.io.exr import read_exr
from lensfit.lens import Lens
from lensfit.preset.schema import Preset

_SCRIPT = Path(__file__).with_name("cycles_job.py")
_PATIENCE_S = 3600
_REMEDY = "give --blender a Python in which `import bpy` works (Blender 4.5 or later)"


def require_blender(python: str) -> None:
    """Refuse a Python without `bpy`, before a shader is made for it.

    Raises
    ------
    LensfitError : It cannot import it.
    """
    _output([python, "-c", "import bpy"])


def _output(command: list[str]) -> list[str]:
    return output_of(
        command,
        patience_s=_PATIENCE_S,
        failed="Blender did not run",
        where=command[0],
        remedy=_REMEDY,
    )


class Cycles(NamedTuple):
    """A Python that has `bpy`, and the pixels that it renders."""

    python: str
    frame: ExchangeFrame

    def picture(self, **wanted: Any) -> Float32[np.ndarray, "height width channels"]:
        """A picture, with alpha if it is "transparent"; `cycles_job` lists the keys.

        Raises
        ------
        LensfitError : Blender does not run, or cannot use the shader.
        """
        channels = self._channels(wanted)
        names = "RGBA" if wanted.get("transparent") else "RGB"
        return np.stack([channels[c] for c in names], -1).astype(np.float32)

    def depth_mm(self, **wanted: Any) -> Float32[np.ndarray, "height width"]:
        """Distance along the axis of what the centre of each pixel shows.

        Raises
        ------
        LensfitError : Blender does not run.
        """
        channels = self._channels(wanted | {"depth": True, "samples": 1})
        name = next(c for c in channels if c.rpartition(".")[0].endswith("Depth"))
        return channels[name].astype(np.float32) * np.float32(1000)

    def _channels(self, wanted: dict[str, Any]) -> dict[str, np.ndarray]:
        size, width_mm = list(self.frame.size_px), self.frame.sensor_width_mm
        task = {"size_px": size, "sensor_width_mm": width_mm}
        with tempfile.TemporaryDirectory() as folder:
            out, path = Path(folder) / "picture.exr", Path(folder) / "task.json"
            path.write_text(json.dumps(task | wanted | {"out": str(out)}))
            lines = _output([self.python, str(_SCRIPT), str(path)])
            if not out.is_file():
                said = [line for line in lines if "rror" in line] or ["no picture"]
                raise LensfitError(
                    f"Cycles did not render ({said[-1]})",
                    where=self.python,
                    remedy=_REMEDY,
                )
            parts = read_exr(out).parts
            return {k: v for part in parts for k, v in part.channels.items()}


_FAR_FOCAL_LENGTHS = 40.0
"""Where a lens counts as focused that is focused at infinity."""


class ShadedLens(NamedTuple):
    """A lens that Cycles renders through.

    Attributes
    ----------
    state : Focal length, f-number and focus distance, all of them known.
    shader : The exported file.
    cycles : With the frame that it is rendered over.
    """

    preset: Preset
    state: tuple[float, float, float]
    lens: Lens
    shader: Path
    cycles: Cycles

    @property
    def frame(self) -> ExchangeFrame:
        return self.cycles.frame

    @property
    def principal_mm(self) -> float:
        return float(self.lens.distortion.principal_distance_mm)

    @property
    def pupil_mm(self) -> float:
        """The entrance pupil before the sensor."""
        return float(self.lens.entrance_pupil_offset_mm)

    @property
    def focus_mm(self) -> float:
        """What is in focus before the entrance pupil; far away if that is infinity."""
        focus_mm = self.state[2]
        if math.isinf(focus_mm):
            focus_mm = _FAR_FOCAL_LENGTHS * self.state[0]
        return focus_mm - self.pupil_mm

    @property
    def half_width_mm(self) -> float:
        """Of the frame, at the distance of focus."""
        return self.frame.sensor_width_mm / 2 / self.principal_mm * self.focus_mm

    def picture(self, **wanted: Any) -> np.ndarray:
        """By Cycles through the lens; `cycles_job` lists the keys."""
        return self.cycles.picture(shader=str(self.shader), **wanted)

    def on_finer_pixels(self, times: int) -> "ShadedLens":
        """The same frame, of more pixels."""
        width, height = self.frame.size_px
        size = width * times, height * times
        frame = ExchangeFrame(size, self.frame.sensor_width_mm)
        return self._replace(cycles=self.cycles._replace(frame=frame))


@contextmanager
def shaded_lens(
    preset: Preset, state: WantedState, cycles: Cycles
) -> Iterator[ShadedLens]:
    """Export the shader of a lens.

    Raises
    ------
    LensfitError : The preset does not reach the state, or no f-number is known.
    """
    lens = preset.at(*state)
    with TemporaryDirectory() as folder:
        out = Path(folder) / "lens.osl"
        export_preset("cycles-osl", ExportRequest(preset, state, cycles.frame, out))
        assert lens.f_number is not None  # or it were not exported
        focus_mm = lens.focus_distance_mm
        focus_mm = math.inf if focus_mm is None else focus_mm
        known = (lens.focal_length_mm, lens.f_number, focus_mm)
        yield ShadedLens(preset, known, lens, out, cycles)
