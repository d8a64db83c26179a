"""Write the UV maps of a lens: what compositing programs apply without lensfit.

`NAME_redistort.exr` puts the lens' distortion on an undistorted CG plate,
`NAME_undistort.exr` takes it off a photograph. Both hold absolute float32 positions,
normalised by the display window; overscan is a larger data window. With lateral
colour a file holds a map per channel (see `lensfit.io.stmap`).
"""

import re
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from jaxtyping import Float32

from lensfit import __version__
from lensfit.coords import Window
from lensfit.errors import OutputError
from lensfit.io.exr_header import lens_attributes
from lensfit.io.stmap import write_channel_stmaps, write_stmap
from lensfit.preset.scaled_look import UNSCALED, ScaledLook, spanned_width_note
from lensfit.progress import Progress, silent
from lensfit.rendering.overscan import (
    Margins,
    cg_camera,
    margins_read,
    overscan_factor,
    window_of_percent,
)
from lensfit.rendering.uv import (
    DEFAULT_TOLERANCE_PX,
    SourceMap,
    SpannedWidth,
    stmap_redistort,
    stmap_undistort,
)
from lensfit.units import m_from_mm

if TYPE_CHECKING:
    from lensfit.lens import Lens

Direction = Literal["redistort", "undistort", "both"]
_MAKERS = {"undistort": stmap_undistort, "redistort": stmap_redistort}
_CHANNELS = ("r", "g", "b")
LARGEST_SIDE_PX = 32768
COARSE_MARGIN_PX = 2
"""Beyond a coarse map, so that what enlarges it has samples on both sides."""


@dataclass(frozen=True)
class StmapFrame:
    """The pixels of a map.

    Attributes
    ----------
    size_px : Width and height of the display window.
    overscan_percent : Pixels beyond it, in total, percent of its size, as plates state
        it: 10 is 5 % on each side.
    sensor_width_mm : Width that the display window spans; the lens' own if None.
    pixel_shape : Width of a pixel over its height, on the sensor.
    map_width_px : Width of the map, which is enlarged to the frame where it is used;
        that of the frame if None.
    margin_px : Pixels of the map beyond the overscan.
    scaled : How the plates' camera was scaled to `sensor_width_mm`; names and headers
        of maps state the plates' own.
    pixel_aspect : ``pixelAspectRatio`` of the plates: how their pixels are displayed.
    """

    size_px: tuple[int, int]
    overscan_percent: float = 0.0
    sensor_width_mm: float | None = None
    pixel_shape: float = 1.0
    map_width_px: int | None = None
    margin_px: int = 0
    scaled: ScaledLook = UNSCALED
    pixel_aspect: float = 1.0

    @property
    def map_frame(self) -> "StmapFrame":
        """The pixels of the map itself, which span the same area of the sensor."""
        width = self.map_width_px
        if width is None:
            return self
        own_width, own_height = self.size_px
        height = max(1, round(own_height * width / own_width))
        stretch = (height / width) / (own_height / own_width)
        return replace(
            self,
            size_px=(width, height),
            pixel_shape=self.pixel_shape * stretch,
            pixel_aspect=self.pixel_aspect * stretch,
            map_width_px=None,
            margin_px=COARSE_MARGIN_PX,
        )

    def spanned_width_mm(self, lens: "Lens") -> SpannedWidth:
        """Width that the display window spans, with the shape of its pixels."""
        width_mm = self.sensor_width_mm or lens.sensor_size_mm[0]
        return SpannedWidth(width_mm, self.pixel_shape)

    @property
    def display_window(self) -> Window:
        return Window.of_size(*self.size_px)

    @property
    def data_window(self) -> Window:
        window = window_of_percent(self.display_window, self.overscan_percent)
        return window.grown(self.margin_px, self.margin_px)


@dataclass(frozen=True)
class WrittenStmaps:
    """Files written, and what CG plates of this size need, as `lensfit overscan` says.

    Attributes
    ----------
    margins : Pixels that the finished frame reads beyond its border.
    overscan_percent : In total, the least that holds them.
    factor : Of OpenLensIO, which knows no pixels.
    notes : Remarks on the sensor that was stated.
    """

    paths: tuple[Path, ...]
    margins: Margins
    overscan_percent: float
    factor: float
    notes: tuple[str, ...] = ()


def write_stmaps(
    lens: "Lens",
    frame: StmapFrame,
    out_dir: str | Path,
    name: str,
    *,
    direction: Direction = "both",
    per_channel: bool = False,
    tolerance_px: float = DEFAULT_TOLERANCE_PX,
    frame_number: int | None = None,
    progress: Progress = silent,
) -> WrittenStmaps:
    """Write ``NAME_undistort.exr`` and ``NAME_redistort.exr``.

    Parameters
    ----------
    lens : Lens at its camera state.
    frame : Size, overscan and sensor width of the maps.
    out_dir : Folder for the files.
    name : What the files are called, such as `file_stem` makes.
    direction : One of the maps, or both.
    per_channel : A map for each of red, green and blue in the file.
    tolerance_px : Largest error of the interpolation between exact evaluations, px of
        the map.
    frame_number : Of a sequence: ``NAME_undistort.1001.exr``.
    progress : Called after each file.

    Raises
    ------
    OutputError : The size makes no map, or the folder cannot be written.
    ImageError : The sensor has no width, or one that the lens is not known over.
    """
    _check(frame, Path(out_dir))
    pixels = frame.map_frame
    ending = "" if frame_number is None else f".{frame_digits(frame_number)}"
    measured_mm, width_mm = lens.sensor_size_mm[0], frame.sensor_width_mm
    note = None if width_mm is None else spanned_width_note(width_mm, measured_mm)
    wanted = [d for d in _MAKERS if direction in (d, "both")]
    channels = _CHANNELS if per_channel else ("g",)
    progress("UV maps", 0, len(wanted))

    def write(one: str) -> Path:
        path = Path(out_dir) / f"{name}_{one}{ending}.exr"
        uv = {c: channel_uv(lens, pixels, one, c, tolerance_px) for c in channels}
        windows = (pixels.display_window, pixels.data_window)
        attributes = _attributes(lens, pixels, name, one)
        header = (*windows, attributes, pixels.pixel_aspect)
        if per_channel:
            write_channel_stmaps(path, uv, *header)
        else:
            write_stmap(path, uv["g"], *header)
        return path

    paths = []
    # One compresses while the other is computed.
    with ThreadPoolExecutor(len(_MAKERS)) as pool:
        for path in pool.map(write, wanted):
            paths.append(path)
            progress("UV maps", len(paths), len(wanted))
    display = frame.display_window
    spanned_mm = frame.spanned_width_mm(lens)
    margins = margins_read(lens, display, sensor_width_mm=spanned_mm)
    percent = cg_camera(margins, display, spanned_mm).percent
    factor = overscan_factor(lens, display, sensor_width_mm=spanned_mm)
    notes = (note,) if note else ()
    return WrittenStmaps(tuple(paths), margins, percent, factor, notes)


def file_stem(lens_name: str, lens: "Lens", scaled: ScaledLook = UNSCALED) -> str:
    """A file name for a lens state: ``smc-takumar-50-1-4_50mm_2000mm``."""
    numbers = scaled.plate_state(lens.focal_length_mm, lens.focus_distance_mm)
    states = [f"{n:.6g}mm" for n in numbers if n is not None]
    return "_".join([lens_stem(lens_name), *states]).replace(".", "p")


def lens_stem(lens_name: str) -> str:
    """A file name for a lens at any state: ``smc-takumar-50-1-4``."""
    return re.sub(r"[^a-z0-9]+", "-", lens_name.lower()).strip("-") or "lens"


def frame_digits(number: int) -> str:
    """A frame number as file names have it, four digits at least."""
    return f"{'-' if number < 0 else ''}{abs(number):04d}"


def channel_uv(
    lens: "Lens",
    frame: StmapFrame,
    direction: str,
    channel: Literal["r", "g", "b"],
    tolerance_px: float,
) -> Float32[np.ndarray, "height width 2"]:
    """One map, over the data window of `frame`."""
    made: SourceMap = _MAKERS[direction](
        lens,
        frame.display_window,
        frame.data_window,
        channel,
        tolerance_px=tolerance_px,
        sensor_width_mm=frame.spanned_width_mm(lens),
    )
    return made.uv(frame.display_window)


def _attributes(
    lens: "Lens", frame: StmapFrame, name: str, direction: str
) -> dict[str, object]:
    """What the map is, in the header."""
    width, scaled = frame.sensor_width_mm or lens.sensor_size_mm[0], frame.scaled
    focal, focus = scaled.plate_state(lens.focal_length_mm, lens.focus_distance_mm)
    known = {
        "lensfit/map": direction,
        "lensfit/lens": name,
        "lensfit/version": __version__,
        "lens/aperture": float(width * scaled.lengths),
        "lens/overscan": float(frame.overscan_percent),
        "lens/focal": focal,
        "lens/focus": _metres(focus),
    }
    standard = lens_attributes(
        nominal_focal_length_mm=focal,
        pinhole_focal_length_mm=float(lens.distortion.principal_distance_mm)
        * scaled.angles,
        focus_distance_mm=focus,
        entrance_pupil_offset_mm=float(lens.entrance_pupil_offset_mm) * scaled.lengths,
        lens_model=name,
    )
    return {k: v for k, v in known.items() if v is not None} | standard


def _metres(distance_mm: float | None) -> float | None:
    return None if distance_mm is None else m_from_mm(distance_mm)


def _check(frame: StmapFrame, out_dir: Path) -> None:
    size_px = frame.size_px if frame.map_width_px is None else frame.map_frame.size_px
    if not all(0 < n <= LARGEST_SIDE_PX for n in (*frame.size_px, *size_px)):
        raise OutputError(
            f"a map of {size_px[0]} x {size_px[1]} cannot be made",
            where=out_dir,
            remedy=f"give a size of up to {LARGEST_SIDE_PX} on a side",
        )
    if not 0 <= frame.overscan_percent <= 200:
        raise OutputError(
            f"overscan of {frame.overscan_percent:g} % is out of range",
            where=out_dir,
            remedy="give 0 to 200",
        )
