"""Sources of the camera state of a plate, and their priority.

Sources, the one that counts most first:

1. options of the command line (``--focal-length-mm`` and the like, ``--focus-at``)
2. the settings file that it names (``--settings``): ``[[frames]]``, then ``[camera]``
3. sidecars and cameras that it names (``--metadata``, ``--camera``), in order
4. ``lensfit.toml`` beside and above the plate, the nearest first: ``[[frames]]`` of all
   of them, then ``[camera]``
5. the plate's header
6. the preset (`lensfit.plate.camera.plate_state`)

Sources named on the command line count before those that are found. Each quantity is
decided separately. A T-stop is used as f-number only where no source states an
f-number, with a note; a note also names entries of a header that contradict each other
if one of them counts.

A table of a sidecar marks single rows as unknown where the lens was not read. The next
source counts there, and the frame jumps against its neighbours, which is noted.
"""

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import final

from lensfit.io.camera.quantity import unit_mm
from lensfit.io.camera.read_camera_file import read_camera_file
from lensfit.io.camera.table import CameraFile, FrameKey, plain_timecode
from lensfit.io.metadata import camera_words
from lensfit.io.sequence import frame_of
from lensfit.plate.camera.header_camera import (
    HEADER,
    add_header,
    contradictions,
    whole_sensor_note,
)
from lensfit.plate.camera.plate_camera import (
    SPELT,
    PlateCamera,
    SourcedValue,
    option_of,
)
from lensfit.plate.camera.settings import Settings, load_settings, settings_beside
from lensfit.plate.notes import FrameNote


def lacking_notes(
    files: Sequence[tuple[int, CameraFile, Collection[str]]],
    words: Mapping[str, Sequence[SourcedValue]],
    frame: FrameKey,
    plate: Path,
) -> Iterator[FrameNote]:
    """A sentence for each quantity that a worse source tells in a sidecar's place.

    Parameters
    ----------
    files : Rank of each, the file, and the quantities that it lacks for this frame.
    words : By quantity, the word that counts most first.
    frame, plate : The frame, and its file where it has no number.
    """
    which = plate.name if frame.number is None else f"frame {frame.number}"
    for rank, file, names in files:
        for name, spelt in SPELT.items():
            known = words.get(name)
            if name not in names or not known or known[0].rank <= rank:
                continue
            yield FrameNote(
                f"{file.path.name} states no {spelt} for {which}, as it does for "
                f"others; {_value_text(name, known[0])} is used ({option_of(name)} "
                "states another)",
                f"lacking {name}",
            )


def _value_text(name: str, known: SourcedValue) -> str:
    value = known.value
    number = f"{value:g}" if isinstance(value, float) else str(value)
    unit = " mm" if name.endswith("_mm") else ""
    whose = " of the header" if known.rank == HEADER else ""
    return f"{known.source} ({number}{unit}){whose}"


_MOST_FOLDERS = 256
_STATED_SETTINGS, _FIRST_FILE, _FOUND_SETTINGS = 1, 2, HEADER - 1
"""Ranks: of the settings file that is named, of the first sidecar or camera, and of
settings that are found; options come before all of them."""


@dataclass(frozen=True)
class StateOverrides:
    """Camera state given by the user; None leaves the other sources' word."""

    focal_length_mm: float | None = None
    f_number: float | None = None
    focus_distance_mm: float | None = None
    sensor_width_mm: float | None = None


@dataclass(frozen=True)
class CameraOptions:
    """Where else than in its header a plate's camera is described.

    Attributes
    ----------
    files : Sidecars and cameras; the first one that knows a quantity counts.
    first_frame : Frame number of the first row of tables that have none.
    camera_name : Of the node, in a script with several cameras.
    unit : Of distances in CG cameras (mm, cm, m, in, ft); metres, noted, if None.
    settings : The one settings file; those beside and above the plate if None.
    focus_at : x, y of a pixel of the display window, or x0, y0, x1, y1 of a region,
        that is in focus (see `lensfit.plate.plate_depth`).
    """

    files: tuple[Path, ...] = ()
    first_frame: int | None = None
    camera_name: str | None = None
    unit: str | None = None
    settings: Path | None = None
    focus_at: tuple[float, ...] | None = None


@final
class CameraSources:
    """The sources of a job, read once.

    Raises
    ------
    LensfitError : A sidecar, camera or stated settings file is malformed.
    """

    def __init__(
        self,
        options: CameraOptions | None = None,
        overrides: StateOverrides | None = None,
    ):
        self.options = options or CameraOptions()
        self.overrides = overrides or StateOverrides()
        unit = self.options.unit
        scale = None if unit is None else unit_mm(unit, "--camera-unit")
        self._files: tuple[CameraFile, ...] = tuple(
            read_camera_file(path, self.options.camera_name, scale)
            for path in self.options.files
        )
        stated = self.options.settings
        self._stated = None if stated is None else load_settings(stated)
        self._beside: dict[Path, Settings] = {}

    def settings_of(self, plate: Path) -> Settings:
        """The settings that hold for a plate."""
        if self._stated is not None:
            return self._stated
        if plate.parent not in self._beside:
            if len(self._beside) >= _MOST_FOLDERS:
                self._beside.clear()
            self._beside[plate.parent] = settings_beside(plate.parent)
        return self._beside[plate.parent]

    def of_plate(
        self,
        plate: str | Path,
        header: Mapping[str, object],
        size_px: tuple[int, int] | None,
        preset_width_mm: float | None = None,
    ) -> PlateCamera:
        """The camera of a plate, with the source of each value.

        Parameters
        ----------
        plate : Its path, which holds its frame number.
        header : Its attributes.
        size_px : Of its display window, pixels.
        preset_width_mm : Sensor width where no source knows one.

        Raises
        ------
        CameraError : A sidecar has no row for the plate.
        SettingsError : A settings file is malformed.
        ImageError : A header entry that counts holds something impossible.
        """
        return self.described(plate, header, size_px, preset_width_mm).checked()

    def described(
        self,
        plate: str | Path,
        header: Mapping[str, object],
        size_px: tuple[int, int] | None,
        preset_width_mm: float | None = None,
    ) -> PlateCamera:
        """The same, with impossible header entries among what is known.

        Raises
        ------
        CameraError : A sidecar has no row for the plate.
        SettingsError : A settings file is malformed.
        """
        plate = Path(plate)
        frame = FrameKey(frame_of(plate), _timecode(header), plate.stem)
        settings = self.settings_of(plate)
        words: dict[str, list[SourcedValue]] = {}
        for name, known in self._beside_header(frame, settings):
            words.setdefault(name, []).append(known)
        better = words.keys() | {_SAME_AS[name] for name in words.keys() & _SAME_AS}
        if self.options.focus_at is not None:
            better.add("focus_distance_mm")
        stated_in_header = camera_words(header, size_px, settings.aliases)
        if "f_number" in better | stated_in_header.keys():
            better.add("t_number")
        bad = add_header(words, stated_in_header, better)
        _join(words, _FROM_PUPIL, "focus_distance_mm")
        _join(words, _PINHOLE, "focal_length_mm")
        _join_field_of_view(words, size_px, preset_width_mm)
        notes = [*self._notes(), *_stop_notes(words), *_settings_notes(words, settings)]
        notes += [
            FrameNote(f"{plate.name}: {said}", f"contradiction {name}")
            for name, said in contradictions(words, HEADER)
            if name not in better
        ]
        width = words.get("sensor_width_mm", [None])[0]
        if (said := whole_sensor_note(header, width)) is not None:
            notes.append(FrameNote(f"{plate.name}: {said}", "whole sensor"))
        notes += self._lacking(plate, frame, words)
        # Where an impossible entry would count nothing does, and all others are told.
        lost = {name for name, b in bad.items() if any(entry.counts for entry in b)}
        first = {name: int(name not in lost) for name in words}
        return PlateCamera(
            {name: found[0] for name, found in words.items() if first[name]},
            {n: tuple(w[first[n] :]) for n, w in words.items() if w[first[n] :]},
            bad,
            plate,
            tuple(notes),
            tuple(str(f.path) for f in self._files) + tuple(map(str, settings.paths)),
            settings,
        )

    def _beside_header(
        self, frame: FrameKey, settings: Settings
    ) -> Iterator[tuple[str, SourcedValue]]:
        """Every word of the sources but the header, the one that counts most first."""
        for name, value in vars(self.overrides).items():
            if value is not None:
                yield name, SourcedValue(value, option_of(name))
        of_settings = list(settings.camera_at(frame.number))
        if self._stated is not None:
            for name, reading in of_settings:
                yield name, SourcedValue(*reading, rank=_STATED_SETTINGS)
        for rank, file in enumerate(self._files, _FIRST_FILE):
            readings, place = file.at(frame, self.options.first_frame)
            for name, (value, entry) in readings.items():
                source = f"{file.path} {place}, {entry}"
                known = SourcedValue(
                    value,
                    source,
                    from_pupil=name == _FROM_PUPIL,
                    rank=rank,
                    of_pinhole=name == _PINHOLE,
                )
                yield name, known
        if self._stated is None:
            for name, reading in of_settings:
                yield name, SourcedValue(*reading, rank=_FOUND_SETTINGS)

    def _lacking(
        self, plate: Path, frame: FrameKey, words: Mapping[str, list[SourcedValue]]
    ) -> Iterator[FrameNote]:
        """Where the files leave out a frame's quantity and a worse source tells it."""
        picked = {"focus_distance_mm"} if self.options.focus_at is not None else set()
        files = [
            (rank, file, file.lacks(frame, self.options.first_frame) - picked)
            for rank, file in enumerate(self._files, _FIRST_FILE)
        ]
        return lacking_notes(files, words, frame, plate)

    def _notes(self) -> Iterator[str]:
        for file in self._files:
            yield from file.notes


_FROM_PUPIL = "focus_from_pupil_mm"
_PINHOLE, _VIEW = "pinhole_focal_length_mm", "vertical_fov_deg"
_SAME_AS = {
    _FROM_PUPIL: "focus_distance_mm",
    _PINHOLE: "focal_length_mm",
    _VIEW: "focal_length_mm",
}
"""Quantities that tell another one."""


def _timecode(header: Mapping[str, object]) -> str | None:
    for key, value in header.items():
        if key.rpartition("/")[2].lower() == "timecode":
            return plain_timecode(value)
    return None


def _join(words: dict[str, list[SourcedValue]], other: str, name: str) -> None:
    """Let what is said of one quantity otherwise count behind what the same source
    says of it: focus distances from either end, focal lengths of ring and pinhole."""
    found = words.pop(other, [])
    if found:
        joined = [*words.get(name, ()), *found]
        words[name] = sorted(joined, key=lambda known: known.rank)


def _join_field_of_view(
    words: dict[str, list[SourcedValue]],
    size_px: tuple[int, int] | None,
    preset_width_mm: float | None,
) -> None:
    """A field of view is a focal length, once the sensor's height is known."""
    views = words.get("vertical_fov_deg")
    if not views:
        return
    height = _height_mm(words, size_px, preset_width_mm)
    if height is None:
        return
    height_mm, whose = height
    found = [
        SourcedValue(
            float(f"{height_mm / 2 / math.tan(math.radians(float(v.value)) / 2):.9g}"),
            f"{v.source} {v.value:g} degrees over {height_mm:g} mm ({whose})",
            rank=v.rank,
            of_pinhole=True,
        )
        for v in views
    ]
    joined = [*words.get("focal_length_mm", ()), *found]
    words["focal_length_mm"] = sorted(joined, key=lambda known: known.rank)


def _height_mm(
    words: dict[str, list[SourcedValue]],
    size_px: tuple[int, int] | None,
    preset_width_mm: float | None,
) -> tuple[float, str] | None:
    """Height of the sensor: as stated, unless the width comes from a better source;
    then, and where nobody states it, that of the format at this width."""
    heights, widths = words.get("sensor_height_mm"), words.get("sensor_width_mm")
    if heights and not (widths and size_px and widths[0].rank < heights[0].rank):
        return float(heights[0].value), heights[0].source
    if size_px is None:
        return None
    aspect = size_px[1] / size_px[0]
    if widths:
        return float(widths[0].value) * aspect, f"format, {widths[0].source}"
    if preset_width_mm is not None:
        return preset_width_mm * aspect, "format, preset"
    return None


def _stop_notes(words: dict[str, list[SourcedValue]]) -> Iterator[str]:
    """Let a T-stop stand for the f-number where nothing better is known."""
    if not words.get("t_number"):
        return
    stop = words["t_number"][0]
    whose = _file_of(stop.source)
    if "f_number" not in words:
        words["f_number"] = [
            SourcedValue(stop.value, f"{stop.source}, a T-stop", rank=stop.rank)
        ]
        yield (
            f"the T-stop of {whose} is used as the f-number, which no source knows "
            "(--f-number states it)"
        )
    elif words["f_number"][0].rank > stop.rank:
        better = _file_of(words["f_number"][0].source)
        yield f"the f-number of {better} is used, as {whose} knows the T-stop only"


def _file_of(source: str) -> str:
    """The source without its line, so that a note is the same for every frame."""
    return source.split(" line ")[0]


def _settings_notes(
    words: dict[str, list[SourcedValue]], settings: Settings
) -> Iterator[str]:
    for path in settings.paths:
        if any(found[0].source.startswith(f"{path} [") for found in words.values()):
            yield f"the camera is as {path} says, where it does"
