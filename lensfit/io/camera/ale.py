"""An Avid Log Exchange file as a sidecar: a row for each clip, which holds for it.

Cameras and loggers keep in it what stays over a clip. A row belongs to the plates whose
name begins with its clip's (``Name``, ``Clip Name`` or ``Source File``, without the
ending), else to those with a timecode from ``Start`` to before ``End``. The columns of
the lens are those of camera reports (`lensfit.io.camera.slates`); focus distances name
their unit.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, final

from lensfit.errors import CameraError
from lensfit.io.camera.quantity import (
    is_missing,
    number,
    stop,
    written_length_mm,
)
from lensfit.io.camera.slates import ale_rows, places_of_columns
from lensfit.io.camera.table import (
    CameraFile,
    FrameKey,
    Readings,
    RowReadings,
    plain_timecode,
)
from lensfit.io.camera.text import MOST_ROWS, read_text

KIND = "Avid Log Exchange file"
_NAMES = ("name", "clip name", "source file", "source file name", "clip")
_QUANTITIES = (
    "focal_length_mm",
    "f_number",
    "t_number",
    "focus_distance_mm",
    "lens_model",
    "lens_serial",
)
_BREAKS = "._- "
_REMEDY = "name the plates as the clip, or give them its timecode"


class _Clip(NamedTuple):
    """A row: its line, names without ending, timecodes, and what it says."""

    line: int
    names: tuple[str, ...]
    start: str | None
    end: str | None
    readings: Readings


@final
class AleClips(CameraFile):
    """The clips of an ALE."""

    def __init__(self, path: Path, clips: Sequence[_Clip]):
        self.path, self.kind, self.notes = path, KIND, ()
        self.clips = tuple(clips)

    def at(self, frame: FrameKey, first_frame: int | None) -> tuple[Readings, str]:
        """What is known of the clip that a frame belongs to, and its line."""
        clip = self._clip(frame)
        return clip.readings, f"line {clip.line}"

    def lacks(self, frame: FrameKey, first_frame: int | None) -> frozenset[str]:
        """None: a clip tells all of its frames the same."""
        return frozenset()

    def _clip(self, frame: FrameKey) -> _Clip:
        if len(self.clips) == 1:
            return self.clips[0]
        found = [clip for clip in self.clips if _is_named(clip, frame.stem or "")]
        found = found or [clip for clip in self.clips if _holds(clip, frame.timecode)]
        if not found:
            known = ", ".join(clip.names[0] for clip in self.clips[:5] if clip.names)
            raise CameraError(
                f"has no clip of {frame.stem!r}, by name or timecode (it has {known})",
                where=self.path,
                remedy=_REMEDY,
            )
        if any(clip.readings != found[0].readings for clip in found):
            lines = ", ".join(str(clip.line) for clip in found[:5])
            raise CameraError(
                f"has several clips of {frame.stem!r} that differ (lines {lines})",
                where=self.path,
                remedy=_REMEDY,
            )
        return found[0]


def read_ale(path: str | Path) -> AleClips:
    """The clips of an Avid Log Exchange file.

    Raises
    ------
    CameraError : It has no rows or no column of the lens, or a cell holds what it may
        not.
    """
    path = Path(path)
    lines = ale_rows(read_text(path).splitlines())
    if len(lines) < 2 or len(lines) > MOST_ROWS:
        raise CameraError(
            f"has {max(len(lines) - 1, 0)} clips, and 1 to {MOST_ROWS} are read",
            where=path,
            remedy="export it again, tab-separated",
        )
    (_, names), *rows = lines
    places = {k: v for k, v in places_of_columns(names).items() if k in _QUANTITIES}
    if not places:
        raise CameraError(
            f"is an {KIND} without a column of the lens",
            where=path,
            remedy='name columns "Focal Length", "F-Stop", "T-Stop", "Focus Distance"',
        )
    plain = [name.strip().lower() for name in names]
    return AleClips(path, [_row(path, line, c, plain, places) for line, c in rows])


def _row(
    path: Path,
    line: int,
    cells: Sequence[str],
    columns: Sequence[str],
    places: Mapping[str, int],
) -> _Clip:
    texts = {
        name: cell
        for name, cell in zip(columns, cells, strict=False)
        if not is_missing(cell)
    }
    found = RowReadings(path, line)
    for quantity, place in places.items():
        text = texts.get(columns[place])
        if text is not None:
            _put(found, quantity, text, columns[place])
    stems = (texts[n] for n in _NAMES if n in texts)
    own = tuple(Path(stem.replace("\\", "/")).stem for stem in stems)
    start, end = (plain_timecode(texts.get(name)) for name in ("start", "end"))
    return _Clip(line, own, start, end, dict(found))


def _put(found: RowReadings, quantity: str, text: str, column: str) -> None:
    """What a cell says, as people write it: 50mm, T2.8, 1.4 + 7/10, 4'11"."""
    with found.naming_line():
        if quantity in ("f_number", "t_number"):
            letter, value = stop(text, column)
            known = {"F": "f_number", "T": "t_number", None: quantity}[letter]
            found.put(known, value, column)
        elif quantity == "focus_distance_mm":
            found.put(quantity, written_length_mm(text, column), column)
        elif quantity == "focal_length_mm":
            plain = text.lower().removesuffix("mm")
            found.put(quantity, number(plain, column), column)
        else:
            found.put(quantity, text, column)


def _is_named(clip: _Clip, stem: str) -> bool:
    """Whether a plate's name begins with one of the clip's, up to a break."""
    for name in clip.names:
        rest = stem.lower().removeprefix(name.lower())
        if name and rest != stem.lower() and (not rest or rest[0] in _BREAKS):
            return True
    return False


def _holds(clip: _Clip, timecode: str | None) -> bool:
    if timecode is None or clip.start is None or clip.end is None:
        return False
    return clip.start <= timecode < clip.end
