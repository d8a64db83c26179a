"""A lens at a state, and Cycles with its camera shader for a frame."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from data_synth.bench.cycles.cycles_picture import Cycles
from lensfit.exchange.export import export_preset
from lensfit.exchange.export_request import ExportRequest, WantedState
from lensfit.exchange.samples import ExchangeFrame
from lensfit.lens import Lens
from lensfit.preset.schema import Preset

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
