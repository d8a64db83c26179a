"""Cameras of Nuke: nodes of a script, with their curves, and ``.chan`` files.

A node is ``Camera2 { knob value knob value ... }`` in Tcl's words: bare, quoted or in
braces. Nuke writes the knobs that were changed; one left at its default is not in the
file, and is not taken from it. An animated knob is ``{{curve x1001 50 x1050 80}}``:
``x`` names a frame, values that follow without one are of the next frames, ``K`` holds
and every other key is joined to the next by a straight line here.

``focal``, ``haperture`` and ``vaperture`` are millimetres; ``focal_point`` is a
distance from the camera, in units of the scene.

A ``.chan`` is frame tx ty tz rx ry rz vfov, one line per frame. The last column is the
vertical field of view in degrees. It becomes a focal length with the sensor's height:
half the height over the tangent of half the angle.
"""

import re
from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, final

from lensfit.errors import CameraError
from lensfit.io.camera.quantity import Reading, checked_quantity
from lensfit.io.camera.table import (
    MOST_ROWS,
    CameraFile,
    CameraTable,
    FrameKey,
    Readings,
    Row,
    RowReadings,
    read_lines,
    read_text,
)

KIND = "Nuke camera"
MOST_BYTES = 16 << 20
NODE = re.compile(r"^[ \t]*(Camera[234]?)[ \t]*\{", re.MULTILINE)
_WORD = re.compile(r'\s*(?:(\{)|"((?:[^"\\]|\\.)*)"|((?:[^\s{}"\\]|\\.)+)|(\}))', re.S)
_BRACES = re.compile(r'\\.|[{}]|"(?:[^"\\]|\\.)*"', re.S)
_KNOBS = {
    "focal": "pinhole_focal_length_mm",
    "haperture": "sensor_width_mm",
    "vaperture": "sensor_height_mm",
    "fstop": "f_number",
    "focal_point": "focus_from_pupil_mm",
}
_MOST_NODES = 1000
_LARGEST_NODE = 4 << 20
_MOST_KEYS = 200_000


class Curve(NamedTuple):
    """Keys of a knob in rising order; one key is a constant.

    Attributes
    ----------
    held : Whether the value stays until the next key.
    """

    frames: tuple[float, ...]
    values: tuple[float, ...]
    held: tuple[bool, ...]

    def at(self, frame: float) -> float:
        """The value at a frame; the first and last key hold beyond."""
        after = bisect_right(self.frames, frame)
        if after == 0:
            return self.values[0]
        before = after - 1
        if after == len(self.frames) or self.held[before]:
            return self.values[before]
        low, high = self.frames[before], self.frames[after]
        share = (frame - low) / (high - low)
        return self.values[before] * (1 - share) + self.values[after] * share


@final
class NukeCamera(CameraFile):
    """One camera node of a script."""

    def __init__(
        self,
        path: Path,
        name: str,
        curves: Mapping[str, Curve],
        unit_mm: float,
        notes: Sequence[str],
    ):
        self.path, self.kind, self.name = path, KIND, name
        self.curves = dict(curves)
        self.unit_mm = unit_mm
        self.notes = tuple(notes)

    def lacks(self, frame: FrameKey, first_frame: int | None) -> frozenset[str]:
        """None: a curve has a value at every frame."""
        return frozenset()

    def at(self, frame: FrameKey, first_frame: int | None) -> tuple[Readings, str]:
        """What is known at a frame, by quantity, and where in the file it stands.

        Raises
        ------
        CameraError : The camera is animated and the frame has no number, or a value is
            none of a camera.
        """
        animated = any(len(curve.frames) > 1 for curve in self.curves.values())
        if animated and frame.number is None:
            raise CameraError(
                f"{self.name} is animated, and the plate's name has no frame number",
                where=self.path,
                remedy="name the plate as plate.1001.exr",
            )
        found: dict[str, Reading] = {}
        for knob, curve in self.curves.items():
            name = _KNOBS[knob]
            value = curve.at(frame.number or 0)
            if name == "focus_from_pupil_mm":
                value *= self.unit_mm
            try:
                known = checked_quantity(name, value, f"{self.name}.{knob}")
            except CameraError as error:
                raise CameraError(
                    error.what, where=self.path, remedy=error.remedy
                ) from None
            if known is not None:
                found[name] = Reading(known, knob)
        return found, self.name


def read_nuke_camera(
    path: str | Path, name: str | None = None, unit_mm: float | None = None
) -> NukeCamera:
    """The camera of a Nuke script.

    Parameters
    ----------
    name : Of the node; not needed where the script has one camera.
    unit_mm : Millimetres of the scene's unit, for `focal_point`; metres if None, which
        a note tells.

    Raises
    ------
    CameraError : There is no camera node, several and none named, or a knob is no
        number.
    """
    path = Path(path)
    nodes = _nodes(path, read_text(path, MOST_BYTES))
    if name is None and len(nodes) == 1:
        name = next(iter(nodes))
    if name not in nodes:
        what = f"has no camera {name!r}" if name else f"has {len(nodes)} cameras"
        shown = ", ".join(list(nodes)[:20])
        raise CameraError(
            what, where=path, remedy=f"name one of {shown} with --camera-name"
        )
    curves: dict[str, Curve] = {}
    notes: list[str] = []
    for knob in _KNOBS.keys() & nodes[name].keys():
        curve = _curve(nodes[name][knob], path, f"{name}.{knob}")
        if curve is None:
            notes.append(
                f"{path.name}: {name}.{knob} is an expression, which is not read: bake "
                "it to a curve"
            )
        else:
            curves[knob] = curve
    if not curves and not notes:
        raise CameraError(
            f"{name} states none of {', '.join(_KNOBS)}",
            where=path,
            remedy="Nuke does not write a knob at its default: state the values",
        )
    notes += _remarks(path, name, curves, unit_mm)
    return NukeCamera(path, name, curves, unit_mm or 1000.0, sorted(notes))


def _remarks(
    path: Path, name: str, curves: Mapping[str, Curve], unit_mm: float | None
) -> Iterator[str]:
    if "focal_point" in curves and unit_mm is None:
        yield (
            f"{path.name}: {name}.focal_point is taken as metres from the camera "
            "(--camera-unit)"
        )
    gaps = any(
        b - a > 1 and not h
        for c in curves.values()
        for a, b, h in zip(c.frames, c.frames[1:], c.held, strict=False)
    )
    if gaps:
        yield (
            f"{path.name}: {name} is taken along straight lines between its keys: bake "
            "its curves for Nuke's own shape"
        )


def _nodes(path: Path, text: str) -> dict[str, dict[str, str]]:
    """Knobs of every camera node, by the node's name."""
    found: dict[str, dict[str, str]] = {}
    end = 0
    for count, match in enumerate(NODE.finditer(text)):
        if match.start() < end:
            continue
        if count >= _MOST_NODES:
            raise CameraError(f"has more than {_MOST_NODES} cameras", where=path)
        end = _closing(text, match.end(), path)
        if end - match.start() > _LARGEST_NODE:
            raise CameraError("has a camera too large to be one", where=path)
        words = list(_words(text[match.end() : end], path))
        knobs = dict(zip(words[::2], words[1::2], strict=False))
        found[knobs.get("name", f"{match[1]}_{count + 1}")[:100]] = knobs
    if not found:
        raise CameraError(
            "holds no camera node",
            where=path,
            remedy="copy a Camera, Camera2, Camera3 or Camera4 node into it",
        )
    return found


def _closing(text: str, start: int, path: Path) -> int:
    """Where the brace that was opened before `start` is closed."""
    depth = 1
    for match in _BRACES.finditer(text, start):
        depth += {"{": 1, "}": -1}.get(match[0], 0)
        if depth == 0:
            return match.start()
    raise CameraError("is cut short: a brace is never closed", where=path)


def _words(text: str, path: Path) -> Iterator[str]:
    at = 0
    while match := _WORD.match(text, at):
        if match[1]:
            at = _closing(text, match.end(), path) + 1
            yield text[match.end() : at - 1]
        elif match[4]:
            raise CameraError("is no Nuke script: a brace too many", where=path)
        else:
            at = match.end()
            yield match[2] if match[2] is not None else match[3]


def _curve(text: str, path: Path, entry: str) -> Curve | None:
    """The keys of a knob; None for an expression."""
    words = text.replace("{", " ").replace("}", " ").split()
    if words[:1] == ["curve"]:
        return _keys(words[1:], path, entry)
    try:
        return Curve((0.0,), (_plain_number(" ".join(words)),), (True,))
    except ValueError:
        if re.fullmatch(r"[-+.\d].*|nan|inf|infinity|", " ".join(words), re.I):
            raise _no_number(text, path, entry) from None
        return None


def _keys(words: list[str], path: Path, entry: str) -> Curve:
    frame, held = 0.0, False
    keys: dict[float, tuple[float, bool]] = {}
    for word in words:
        try:
            if word[0] == "x":
                frame = _plain_number(word[1:])
            elif word[0].isalpha() and word.lower() not in ("nan", "inf", "infinity"):
                # A tangent (s0.5, t, u, v) or how the keys are joined.
                held = {"K": True, "L": False, "C": False}.get(word, held)
            else:
                keys[frame] = (_plain_number(word), held)
                frame += 1
        except ValueError:
            raise _no_number(word, path, entry) from None
    if not keys or len(keys) > _MOST_KEYS:
        raise CameraError(f"{entry} has no curve that can be read", where=path)
    frames = sorted(keys)
    values, holds = zip(*(keys[frame] for frame in frames), strict=True)
    return Curve(tuple(frames), values, holds)


def _plain_number(word: str) -> float:
    value = float(word)
    if not abs(value) < 1e12:  # NaN and infinity too
        raise ValueError
    return value


def _no_number(text: str, path: Path, entry: str) -> CameraError:
    shown = " ".join(text.split())[:40]
    return CameraError(f"{entry} is {shown!r} and should be a number", where=path)


_CHAN_KIND = ".chan camera"
_CHAN_ENTRY = "vfov"
_CHAN_COLUMNS = 8


def read_chan(path: str | Path) -> CameraTable:
    """The field of view at each frame.

    Raises
    ------
    CameraError : A line is no row of numbers, has no field of view, or repeats a frame.
    """
    path = Path(path)
    rows: dict[int, Row] = {}
    for line, text in read_lines(path):
        words = text.split(maxsplit=_CHAN_COLUMNS + 8)
        if not words or words[0].startswith("#"):
            continue
        row = _chan_row(path, line, words)
        assert row.number is not None
        if row.number in rows:
            raise CameraError(
                f"line {line}: frame {row.number} stands twice", where=path
            )
        rows[row.number] = row
        if len(rows) > MOST_ROWS:
            raise CameraError(f"has more than {MOST_ROWS} frames", where=path)
    return CameraTable(path, _CHAN_KIND, list(rows.values()))


def _chan_row(path: Path, line: int, words: list[str]) -> Row:
    found = RowReadings(path, line)
    if len(words) < _CHAN_COLUMNS:
        raise CameraError(
            f"line {line} has {len(words)} numbers and should have {_CHAN_COLUMNS}, "
            "the last of them the vertical field of view",
            where=path,
            remedy="export a camera, not another object",
        )
    numbers = [found.number(word, f"column {at}") for at, word in enumerate(words, 1)]
    frame = numbers[0]
    if frame is None or abs(frame) > 1e9 or frame != round(frame):
        raise CameraError(f"line {line}: {words[0][:40]!r} is no frame", where=path)
    found.put("vertical_fov_deg", numbers[_CHAN_COLUMNS - 1], _CHAN_ENTRY)
    return Row(line, found, number=round(frame))
