"""The request of an export and its result: files, residuals, what is lost.

Every format fits its own model to samples of the lens over a frame, and is judged by
others (`samples_pair`); residuals are in pixels of the frame.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from lensfit.batches import in_batches
from lensfit.exchange.samples import (
    FIT_COUNT,
    JUDGE_COUNT,
    ExchangeFrame,
    LensMap,
    Residual,
    Samples,
)
from lensfit.lens import Lens
from lensfit.preset.schema import Preset
from lensfit.printable import printable
from lensfit.progress import Progress, silent

_VISIBLE_PX = 0.5
_VISIBLE_LIGHT = 0.02


class WantedState(NamedTuple):
    """Which state of the lens; None where the preset knows."""

    focal_length_mm: float | None = None
    f_number: float | None = None
    focus_distance_mm: float | None = None


@dataclass(frozen=True)
class Nearness:
    """How near one part of what was written is.

    Attributes
    ----------
    what : Such as "distortion at 50 mm".
    residual : In pixels; None for fall-off.
    worst_light : Largest error of relative illumination; None for maps.
    """

    what: str
    residual: Residual | None = None
    worst_light: float | None = None

    def __str__(self) -> str:
        if self.residual is not None:
            return f"{self.what}: {self.residual}"
        return f"{self.what}: worst {100 * (self.worst_light or 0.0):.2g} %"


@dataclass(frozen=True)
class Exported:
    """Files written, how near they are, and what does not go with them."""

    paths: tuple[Path, ...]
    nearness: tuple[Nearness, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class ExportRequest:
    """What is exported.

    Attributes
    ----------
    out : The file; for "stmap" the folder.
    per_channel : A UV map for each of red, green and blue.
    """

    preset: Preset
    state: WantedState
    frame: ExchangeFrame
    out: Path
    per_channel: bool = False
    progress: Progress = silent

    @property
    def one_state(self) -> bool:
        """Whether one entry is requested, or there is only one."""
        requested = (self.state.focal_length_mm, self.state.focus_distance_mm)
        return requested != (None, None) or len(self.preset.entries) == 1

    def lens(self) -> Lens:
        """The lens at the state requested."""
        return self.preset.at(*self.state)


def states_of(request: ExportRequest) -> list[WantedState]:
    """The one requested, or those of all entries, by focal length and focus."""
    if request.one_state:
        return [request.state]
    entries = sorted(
        request.preset.entries,
        key=lambda e: (e.focal_length_mm, e.focus_distance_mm or 0.0),
    )
    f_number = request.state.f_number
    return [
        WantedState(e.focal_length_mm, f_number, e.focus_distance_mm) for e in entries
    ]


def state_name(lens: Lens) -> str:
    """Focal length and focus of a lens, in words."""
    focus = lens.focus_distance_mm
    at = "" if focus is None else f", focus {focus:g} mm"
    return f"{lens.focal_length_mm:g} mm{at}"


def samples_pair(
    lens: Lens, frame: ExchangeFrame, count: int = FIT_COUNT
) -> tuple[Samples, Samples]:
    """Those that a model is fitted to, so many across, and those that judge it."""
    one = LensMap(lens)
    return Samples.of(one, frame, count), Samples.of(one, frame, JUDGE_COUNT)


def principal_point(lens: Lens) -> tuple[float, float]:
    """Of the lens, mm."""
    x, y = np.asarray(lens.distortion.principal_point_mm).tolist()
    return x, y


def mean_light(lens: Lens, points_mm: np.ndarray) -> np.ndarray:
    """Relative illumination at points of the photograph, mean of the channels."""
    each = [
        in_batches(lambda p, c=c: lens.relative_illumination(p, c), points_mm)
        for c in ("r", "g", "b")
    ]
    return np.mean(each, axis=0)


def lens_description(request: ExportRequest, lens: Lens) -> str:
    """The lens and its state, in a line."""
    from lensfit import __version__

    focus = lens.focus_distance_mm
    at = "" if focus is None else f" focused at {focus:g} mm"
    name = printable(" ".join(request.preset.lens.name.split()))
    return f"lensfit {__version__}: {name}, {lens.focal_length_mm:g} mm{at}"


def export_result(
    request: ExportRequest,
    lens: Lens,
    nearness: tuple[Nearness, ...],
    *,
    has_colour: bool = False,
    has_light: bool = False,
    has_blur: bool = False,
    paths: tuple[Path, ...] = (),
) -> Exported:
    """What was written, with notes on what the format leaves out."""
    notes = list(
        request.preset.select(*request.state).notes if request.one_state else ()
    )
    if lens.has_lateral_colour and not has_colour:
        notes.append("the format holds no lateral colour: the distortion is green's")
    if lens.illumination is not None and not has_light:
        notes.append("the format holds no fall-off")
    if not has_blur and any(e.blur is not None for e in request.preset.entries):
        notes.append("the format holds no blur")
    for one in nearness:
        if one.residual is not None and one.residual.worst_px > _VISIBLE_PX:
            notes.append(
                f"the other program's model cannot hold this lens: {one}; UV maps can"
            )
        if one.worst_light is not None and one.worst_light > _VISIBLE_LIGHT:
            notes.append(f"the other program's model cannot hold this lens: {one}")
    return Exported(paths or (request.out,), nearness, tuple(dict.fromkeys(notes)))
