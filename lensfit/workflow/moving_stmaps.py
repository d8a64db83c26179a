"""UV maps of a shot in which focus, zoom or breathing change: a map for each frame.

The camera state of a frame is that of its plate, from the same sources as `lensfit
apply` (`lensfit.plate.camera.sources`); of a plate its header alone is read. Frames
at the same state have the same map, which is made once and copied.

Maps are named after the lens and the plates, not after a state: so the chunks of a farm
name them alike. Beside them lies a Nuke script that reads both sequences. A shot may be
written in chunks, by processes that do not know of one another, so the script is made
of what the folder holds: its frames are those of all chunks so far.
"""

import shutil
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from lensfit.atomic import atomic_path, write_folder_summary
from lensfit.errors import ImageError, OutputError
from lensfit.exchange.nuke_script import MapSequence, nuke_stmap_text
from lensfit.exchange.stmaps import (
    Direction,
    StmapFrame,
    frame_digits,
    lens_stem,
    write_stmaps,
)
from lensfit.io.exr_header import check_exr
from lensfit.io.sequence import expand_frames, format_frames, frame_of, sequence_name
from lensfit.lens import Lens
from lensfit.plate.apply_options import ApplyOptions
from lensfit.plate.frame.plate_lens import PlateLens
from lensfit.plate.plate_file import plate_header, plate_views
from lensfit.preset.schema import Preset
from lensfit.progress import Progress, silent
from lensfit.rendering.render_stages import lateral_colour_px

_Way = Literal["undistort", "redistort"]
_WAYS: tuple[_Way, ...] = ("undistort", "redistort")
_ONE_MAP_CHANNELS = 3


@dataclass(frozen=True)
class StmapSequence:
    """Maps of one shot.

    Attributes
    ----------
    folder : Where they lie.
    name : ``NAME_redistort.1001.exr``.
    frame : Their pixels, and those of the plates.
    direction : Which are written.
    per_channel : Whether each colour has its own.
    """

    folder: Path
    name: str
    frame: StmapFrame
    direction: Direction
    per_channel: bool

    @property
    def script_path(self) -> Path:
        """The Nuke script beside them."""
        return self.folder / f"{self.name}.nk"

    def refuse_others(self, numbers: Iterable[int | None]) -> None:
        """Refuse to add to maps that one script cannot read together with these.

        Parameters
        ----------
        numbers : Frames that are to be written, and may replace what is there.

        Raises
        ------
        OutputError : A map of another frame has another size, or other channels.
        """
        own = {*numbers}
        for way in self._ways:
            others = [path for n, path in self._maps(way) if n not in own]
            for path in others[:1]:
                part = check_exr(path)[0]
                pixels = self.frame.map_frame
                windows = pixels.display_window, pixels.data_window
                is_same = (part.display_window, part.data_window) == windows
                is_each = len(part.channels) > _ONE_MAP_CHANNELS
                if is_same and is_each == self.per_channel:
                    continue
                what = "another size"
                if is_same:
                    what = "a map for each colour" if is_each else "one for all colours"
                raise OutputError(
                    f"is of another frame of this shot and has {what}, so that one "
                    "script cannot read both",
                    where=path,
                    remedy="choose another --out, or write all frames with the same "
                    "--map-width, --overscan and --per-channel or --no-per-channel",
                )

    def script_text(self, label: str) -> str:
        """Of the script, for the maps that are there now.

        Parameters
        ----------
        label : What they are.
        """
        maps: dict[_Way, MapSequence] = {w: self._sequence(w) for w in self._ways}
        numbers = self._numbers(self._ways[0])
        count = len(numbers) or 1
        return nuke_stmap_text(
            maps,
            self.frame.size_px,
            f"{label}, UV maps of {count} frames",
            per_channel=self.per_channel,
            map_px=self.frame.map_frame.size_px,
        )

    def gaps_note(self) -> str | None:
        """Which maps are missing between the first and the last one."""
        numbers = self._numbers(self._ways[0])
        missing = _missing(numbers)
        if not missing:
            return None
        return (
            f"no maps of frames {format_frames(missing)} between {numbers[0]} and "
            f"{numbers[-1]}; until they are written, the script reads the nearest map"
        )

    @property
    def _ways(self) -> tuple[_Way, ...]:
        return tuple(way for way in _WAYS if self.direction in (way, "both"))

    def _sequence(self, way: str) -> MapSequence:
        numbers = self._numbers(way)
        if not numbers:
            return MapSequence(self.folder / f"{self.name}_{way}.exr")
        file = self.folder / f"{self.name}_{way}.%04d.exr"
        return MapSequence(file, (numbers[0], numbers[-1]), bool(_missing(numbers)))

    def _numbers(self, way: str) -> list[int]:
        return [number for number, _ in self._maps(way)]

    def _maps(self, way: str) -> list[tuple[int, Path]]:
        """Numbered maps in the folder, by frame."""
        try:
            found = expand_frames(self.folder / f"{self.name}_{way}.%04d.exr")
        except ImageError:
            return []
        return [(number, path) for number, path in found if number is not None]


def _missing(numbers: list[int]) -> list[int]:
    if not numbers:
        return []
    return sorted({*range(numbers[0], numbers[-1] + 1)} - {*numbers})


UNSEEN_COLOUR_PX = 0.02
"""Lateral colour that needs no maps of its own."""


@dataclass
class MovingStmaps:
    """What was written.

    Attributes
    ----------
    paths : Maps, in the order of frames.
    script : Of Nuke, that reads them.
    different : Maps of one direction that are not copies.
    per_channel : Whether each colour has its own.
    overscan_percent : In total, the least that holds what every frame reads.
    notes : What was assumed.
    """

    paths: list[Path] = field(default_factory=list)
    script: Path | None = None
    different: int = 0
    per_channel: bool = False
    overscan_percent: float = 0.0
    notes: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class _MapState:
    """A frame, and the lens as its plate meets it."""

    number: int | None
    key: object
    lens: Lens
    frame: StmapFrame


def write_moving_stmaps(
    preset: Preset,
    plates: str | Path,
    out_dir: str | Path,
    *,
    options: ApplyOptions,
    frames: str | None = None,
    overscan_percent: float = 0.0,
    map_width_px: int | None = None,
    direction: Direction = "both",
    per_channel: bool | None = None,
    tolerance_px: float,
    progress: Progress = silent,
) -> MovingStmaps:
    """Write ``LENS_PLATE_redistort.1001.exr`` and so on for the plates of a sequence.

    Parameters
    ----------
    plates : An EXR file or a pattern; it states the camera of each frame.
    options : Where else the camera state comes from, and the knobs.
    frames : Range; every frame that exists if None.
    overscan_percent : Pixels of the maps beyond the frame, in total.
    map_width_px : Width of the maps; that of the plates if None.
    per_channel : A map for each colour; where they lie apart visibly if None.
    tolerance_px : Largest error of the interpolation between exact evaluations.
    progress : Called after each frame.

    Raises
    ------
    LensfitError : The camera state of a frame is not known; the folder holds other
        maps of this sequence that no script reads together with these; or as
        `write_stmaps`.
    """
    found = expand_frames(plates, frames)
    known = PlateLens(preset, options)
    states = [
        _state(known, n, path, overscan_percent, map_width_px) for n, path in found
    ]
    if per_channel is None:
        per_channel = any(_colour_px(one) > UNSEEN_COLOUR_PX for one in states)
    written = MovingStmaps(per_channel=per_channel)
    sequence = StmapSequence(
        Path(out_dir),
        f"{lens_stem(preset.lens.name)}_{sequence_name(found[0][1])}",
        states[0].frame,
        direction,
        per_channel,
    )
    sequence.refuse_others(one.number for one in states)
    made: dict[object, tuple[Path, ...]] = {}
    progress("UV maps", 0, len(states))
    for done, one in enumerate(states, 1):
        if one.key in made:
            written.paths += [_copy_of_map(p, one.number) for p in made[one.key]]
        else:
            maps = write_stmaps(
                one.lens,
                one.frame,
                out_dir,
                sequence.name,
                direction=direction,
                per_channel=per_channel,
                tolerance_px=tolerance_px,
                frame_number=one.number,
            )
            made[one.key] = maps.paths
            written.paths += maps.paths
            percent = max(written.overscan_percent, maps.overscan_percent)
            written.overscan_percent = percent
            known.notes.add(*maps.notes)
        progress("UV maps", done, len(states))
    written.different, written.notes = len(made), list(known.notes.said)
    written.script = sequence.script_path
    label = f"lensfit: {preset.lens.name}"
    write_folder_summary(written.script, lambda: sequence.script_text(label))
    written.notes += [note] if (note := sequence.gaps_note()) else []
    return written


def _state(
    known: PlateLens,
    number: int | None,
    path: Path,
    overscan_percent: float,
    map_width_px: int | None,
) -> _MapState:
    """Of one plate.

    Raises
    ------
    ImageError : It has several views.
    """
    first, *others = plate_views(plate_header(path), path)
    if others:
        raise ImageError(
            "has several views, and a map is that of one",
            where=path,
            remedy="give the plates of one eye",
        )
    state = known.noted_state(first.header, path)
    part = first.view.image.parts[0]
    display = part.display_window
    size = display.width, display.height
    frame = StmapFrame(
        size,
        overscan_percent,
        state.sensor_width_mm,
        state.pixel_shape,
        map_width_px,
        scaled=state.scaled,
        pixel_aspect=known.options.pixel_aspect or part.pixel_aspect,
    )
    number = frame_of(path) if number is None else number
    key = (state.lens_key, repr(state.knobs.aberration), frame)
    return _MapState(number, key, known.lens_at(state), frame)


def _colour_px(one: _MapState) -> float:
    from lensfit.rendering.uv import PlateGeometry

    frame = one.frame
    spanned = frame.spanned_width_mm(one.lens)
    geometry = PlateGeometry.of(one.lens, frame.display_window, spanned)
    return max(lateral_colour_px(one.lens, geometry, frame.data_window))


def _copy_of_map(source: Path, number: int | None) -> Path:
    """The same map under the number of another frame."""
    assert number is not None
    stem = source.stem.rpartition(".")[0]
    target = source.with_name(f"{stem}.{frame_digits(number)}.exr")
    if target != source:
        with atomic_path(target) as path:
            shutil.copyfile(source, path)
    return target
