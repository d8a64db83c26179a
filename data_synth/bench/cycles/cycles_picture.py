"""Pictures by Cycles, of a Python with Blender's `bpy`, through a lens' camera shader.

`bpy` exists for one version of Python only, so the interpreter that has it may be
another than this one. Cycles runs in a process of its own.
"""

import json
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float32

from data_synth.bench.own_process import output_of
from lensfit.errors import LensfitError
from lensfit.exchange.samples import ExchangeFrame
from lensfit.io.exr import read_exr

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
    """A Python that has `bpy`, and the pixels that it renders.

    Attributes
    ----------
    threads : Of Cycles.
    """

    python: str
    frame: ExchangeFrame
    threads: int = 2

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
        task = {"size_px": size, "sensor_width_mm": width_mm, "threads": self.threads}
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
