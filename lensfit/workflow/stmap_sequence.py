"""The UV maps of a shot as they lie in a folder, and the Nuke script that reads them.

A shot may be written in chunks, by processes that do not know of one another. So the
script is made of what the folder holds: its frames are those of all chunks so far.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from lensfit.errors import ImageError, OutputError
from lensfit.exchange.nuke_stmap import MapSequence, nuke_stmap_text
from lensfit.exchange.stmaps import Direction, StmapFrame
from lensfit.io.exr_header import check_exr
from lensfit.io.sequence import expand_frames, format_frames

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
