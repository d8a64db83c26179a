"""Write a preset as another program's lens, and say how near that is.

One entry point, `export_preset`; formats that have tables (lensfun, OpenTrackIO) get
every entry unless one is asked for.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from lensfit.atomic import write_text_atomic
from lensfit.errors import ExchangeError
from lensfit.fitting.exchange.brown_fit import fit_opencv
from lensfit.fitting.exchange.samples import (
    FIT_COUNT,
    JUDGE_COUNT,
    ExchangeFrame,
    LensMap,
    Residual,
    Samples,
    residual_of,
)
from lensfit.fitting.exchange.tde4_fit import fit_tde4
from lensfit.lens import Lens
from lensfit.preset.exchange.opencv import OpenCvMap
from lensfit.preset.exchange.opencv_file import opencv_text
from lensfit.preset.exchange.tde4 import ANAMORPHIC, RADIAL, RESCALED
from lensfit.preset.exchange.tde4_node import tde4_node_text
from lensfit.preset.exchange.usd_camera import UsdCamera, usd_camera_text
from lensfit.preset.schema import Preset
from lensfit.printable import printable
from lensfit.progress import Progress, silent

TDE4_FORMATS = {
    "nuke-radial": RADIAL,
    "nuke-anamorphic": ANAMORPHIC,
    "nuke-anamorphic-rescaled": RESCALED,
}
FORMATS = (
    *TDE4_FORMATS,
    "opentrackio",
    "opencv",
    "usd",
    "mrcal-opencv",
    "mrcal-splined",
    "unreal",
    "syntheyes",
    "lensfun",
    "stmap",
    "nuke-stmap",
    "cycles-osl",
)
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
        """Whether one entry is asked for, or there is only one."""
        asked = (self.state.focal_length_mm, self.state.focus_distance_mm)
        return asked != (None, None) or len(self.preset.entries) == 1

    def lens(self) -> Lens:
        """The lens at the state asked for."""
        return self.preset.at(*self.state)


def export_preset(to: str, request: ExportRequest) -> Exported:
    """Write `request.preset` in the format `to`, one of `FORMATS`.

    Raises
    ------
    ExchangeError : The other program cannot hold this lens.
    PresetError : The preset does not reach the state.
    OutputError : The file cannot be written.
    """
    from lensfit.workflow.exchange.export_maps import export_nuke_maps, export_stmaps
    from lensfit.workflow.exchange.export_mrcal import (
        export_mrcal_opencv,
        export_mrcal_splined,
    )
    from lensfit.workflow.exchange.export_osl import export_cycles
    from lensfit.workflow.exchange.export_syntheyes import export_syntheyes
    from lensfit.workflow.exchange.export_tables import (
        export_lensfun,
        export_opentrackio,
    )
    from lensfit.workflow.exchange.export_unreal import export_unreal

    writers: dict[str, Callable[[ExportRequest], Exported]] = {
        "opentrackio": export_opentrackio,
        "opencv": export_opencv,
        "usd": export_usd,
        "mrcal-opencv": export_mrcal_opencv,
        "mrcal-splined": export_mrcal_splined,
        "unreal": export_unreal,
        "syntheyes": export_syntheyes,
        "lensfun": export_lensfun,
        "stmap": export_stmaps,
        "nuke-stmap": export_nuke_maps,
        "cycles-osl": export_cycles,
    }
    if to in TDE4_FORMATS:
        return export_tde4(TDE4_FORMATS[to], request)
    if to not in writers:
        raise ExchangeError(
            f"{to!r} is no format", remedy=f"known are {', '.join(FORMATS)}"
        )
    return writers[to](request)


def export_tde4(model: str, request: ExportRequest) -> Exported:
    """A Nuke node of 3DEqualizer's kit."""
    lens, frame = request.lens(), request.frame
    fit, judge = samples_pair(lens, frame)
    fitted = fit_tde4(model, fit, principal_point(lens))
    residual = residual_of(fitted, judge)
    text = tde4_node_text(
        fitted,
        focal_length_mm=float(lens.distortion.principal_distance_mm),
        focus_distance_mm=lens.focus_distance_mm,
        name=request.preset.lens.name,
        label=f"{described(request, lens)}\nresidual {residual} over {frame}",
    )
    write_text_atomic(request.out, text)
    return exported(request, lens, (Nearness("distortion", residual),))


def export_opencv(request: ExportRequest) -> Exported:
    """An OpenCV calibration in YAML."""
    lens, frame = request.lens(), request.frame
    camera, residual = opencv_camera(lens, frame)
    comments = (
        described(request, lens),
        f"residual {residual} over {frame}",
        f"sensor width {frame.sensor_width_mm!r} mm",
    )
    write_text_atomic(request.out, opencv_text(camera, comments))
    return exported(request, lens, (Nearness("distortion", residual),))


def export_usd(request: ExportRequest) -> Exported:
    """A USD camera with OpenCV's lens, as Omniverse reads it."""
    lens, frame = request.lens(), request.frame
    mapping, residual = opencv_camera(lens, frame)
    camera = UsdCamera(
        mapping,
        request.state.f_number,
        lens.focus_distance_mm,
        float(lens.entrance_pupil_offset_mm),
        request.preset.lens.name,
    )
    comment = f"{described(request, lens)}; residual {residual} over {frame}"
    write_text_atomic(request.out, usd_camera_text(camera, comment))
    return exported(request, lens, (Nearness("distortion", residual),))


def opencv_camera(
    lens: Lens, frame: ExchangeFrame, most: int = 12
) -> tuple[OpenCvMap, Residual]:
    """OpenCV's camera fitted to a lens, and how near it is.

    Parameters
    ----------
    most : Coefficients that may be used.
    """
    fit, judge = samples_pair(lens, frame)
    squeeze = np.asarray(lens.distortion.squeeze).tolist()
    camera = fit_opencv(
        fit,
        float(lens.distortion.principal_distance_mm),
        principal_point(lens),
        (squeeze[0], squeeze[1]),
        most,
    )
    return camera, residual_of(camera, judge)


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


def described(request: ExportRequest, lens: Lens) -> str:
    """The lens and its state, in a line."""
    from lensfit import __version__

    focus = lens.focus_distance_mm
    at = "" if focus is None else f" focused at {focus:g} mm"
    name = printable(" ".join(request.preset.lens.name.split()))
    return f"lensfit {__version__}: {name}, {lens.focal_length_mm:g} mm{at}"


def exported(
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
