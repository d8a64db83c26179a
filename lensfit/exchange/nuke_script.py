"""A Nuke script: its nodes as text, and one that loads and applies a lens' two UV maps.

    Class {
     knob value
     knob {a list}
     name node1
    }

Only what is needed to take plain knobs out of a script, or of text on the clipboard,
and to write such text; nothing in a script is evaluated.

Each of the two UV maps is read raw and given to an STMap node on its second input; the
first is left for the plate. A map that is coarser than the frame is enlarged by a
Reformat, which keeps what lies beyond the frame. With maps for each colour three STMap
nodes follow one another, each of which moves one channel by its own layer of the file.

Nodes of a script stand on a stack: the input 0 of a node is what was pushed last; `set`
names what lies on top and `push` lays it there again.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

from lensfit.atomic import write_text_atomic
from lensfit.errors import ExchangeError
from lensfit.exchange.export_request import (
    Exported,
    ExportRequest,
    export_result,
    lens_description,
)
from lensfit.exchange.stmaps import StmapFrame, WrittenStmaps, file_stem, write_stmaps
from lensfit.exchange.text_file import read_text
from lensfit.printable import printable

_NODE = re.compile(r"^[ \t]*([A-Za-z_][\w.]*)[ \t]*\{", re.MULTILINE)
_MOST_NODES = 100_000
_LONGEST_NAME = 80


@dataclass(frozen=True)
class NukeNode:
    """A node: its class and the text of each knob."""

    kind: str
    knobs: Mapping[str, str]

    @property
    def name(self) -> str:
        """The `name` knob, cut to what a sentence can hold."""
        return self.knobs.get("name", self.kind)[:_LONGEST_NAME]


def read_nuke_nodes(path: str | Path) -> tuple[NukeNode, ...]:
    """Every node of a script, in its order; groups are passed through.

    Raises
    ------
    ExchangeError : It is no text, or a brace is never closed.
    """
    text = _without_comments(read_text(path, "Nuke script"))
    nodes, place = [], 0
    while match := _NODE.search(text, place):
        end = _closing(text, match.end() - 1)
        if end < 0:
            raise ExchangeError(
                f"is cut off inside the node {match[1][:_LONGEST_NAME]}",
                where=path,
                remedy="copy the node again, to its closing brace",
            )
        nodes.append(NukeNode(match[1], _knobs(text[match.end() : end])))
        place = end + 1
        if len(nodes) > _MOST_NODES:
            raise ExchangeError(f"has more than {_MOST_NODES} nodes", where=path)
    return tuple(nodes)


def node_text(kind: str, knobs: Mapping[str, str]) -> str:
    """A node as script text, with a newline."""
    lines = [f" {name} {value}" for name, value in knobs.items()]
    return "\n".join([f"{kind} {{", *lines, "}"]) + "\n"


def quoted_word(text: str) -> str:
    """Text as one word of a script, on one line."""
    lines = [re.sub(r'([\\"$\[\]{}])', r"\\\1", line) for line in text.split("\n")]
    return '"' + "\\n".join(printable(line) for line in lines) + '"'


def _without_comments(text: str) -> str:
    return re.sub(r"^[ \t]*#.*$", "", text, flags=re.MULTILINE)


def _closing(text: str, opening: int) -> int:
    """Where the brace that opens at `opening` closes; -1 if it does not.

    A quoted word hides braces, as a backslash does the character behind it.
    """
    depth, place, in_word = 0, opening, False
    for match in re.compile(r'\\.|["{}]', re.DOTALL).finditer(text, opening):
        mark, place = match[0], match.start()
        if mark == '"':
            in_word = not in_word
        elif not in_word and mark == "{":
            depth += 1
        elif not in_word and mark == "}":
            depth -= 1
            if depth == 0:
                return place
    return -1


def _knobs(body: str) -> dict[str, str]:
    knobs: dict[str, str] = {}
    line = re.compile(r"[ \t]*([A-Za-z_]\w*)[ \t]+")
    place, closes = 0, True
    while place < len(body):
        end = body.find("\n", place)
        end = len(body) if end < 0 else end
        match = line.match(body, place, end)
        if match is None:
            place = end + 1
            continue
        start = match.end()
        if closes and body[start : start + 1] == "{":
            closing = _closing(body, start)
            # After one that never closes none is looked for: each would take a pass.
            closes = closing >= 0
            end = closing + 1 if closes else end
        elif body[start : start + 1] == '"':
            closing = re.compile(r'(?:\\.|[^"\\])*"', re.DOTALL).match(body, start + 1)
            end = closing.end() if closing else end
        knobs[match[1]] = body[start:end].strip()
        place = end + 1
    return knobs


_CHANNELS = {"r": "{rgba.red}", "g": "{rgba.green rgba.alpha}", "b": "{rgba.blue}"}
_LAYER = "stmap_{}"
"""As `lensfit.io.stmap` names them."""


class MapSequence(NamedTuple):
    """Files of a map.

    Attributes
    ----------
    file : One file, or the pattern of a sequence as Nuke reads it (``%04d``).
    span : First and last frame of a sequence; None for one file.
    has_gaps : Whether files between those are missing: the nearest stands for them.
    """

    file: Path
    span: tuple[int, int] | None = None
    has_gaps: bool = False


def nuke_stmap_text(
    maps: Mapping[Literal["undistort", "redistort"], MapSequence],
    display_px: tuple[int, int],
    label: str,
    *,
    per_channel: bool = False,
    map_px: tuple[int, int] | None = None,
) -> str:
    """Script text: for each direction a map, a place for the plate and an STMap.

    Parameters
    ----------
    maps : Files by direction, "undistort" and "redistort".
    display_px : Format of the plates.
    label : What they are, in lines.
    per_channel : The files hold a layer for each of red, green and blue.
    map_px : Format of the maps; that of the plates if None.
    """
    found = "".join(f"# {line}\n" for line in label.splitlines())
    if per_channel:
        for channel in _CHANNELS:
            layer = _LAYER.format(channel)
            found += f"add_layer {{{layer} {layer}.red {layer}.green {layer}.blue}}\n"
    for column, (direction, files) in enumerate(maps.items()):
        x = 220 * column
        found += node_text(
            "Read", _read(files, direction, map_px or display_px, label, x)
        )
        if map_px is not None and map_px != display_px:
            found += node_text("Reformat", _enlarge(direction, display_px, x))
        plate = {
            "inputs": "0",
            "name": f"plate_to_{direction}",
            "label": quoted_word("connect the plate here"),
            "xpos": f"{x}",
            "ypos": "60",
        }
        if per_channel:
            found += f"set Map{column} [stack 0]\n"
        found += node_text("NoOp", plate)
        found += "".join(
            _stmaps_of_channels(direction, column, x)
            if per_channel
            else [node_text("STMap", _stmap(direction, "all", "rgb", x, 120))]
        )
    return found


def _read(
    files: MapSequence, direction: str, size: tuple[int, int], label: str, x: int
) -> dict[str, str]:
    width, height = size
    found = {
        "inputs": "0",
        "file_type": "exr",
        "file": quoted_word(files.file.absolute().as_posix()),
        "format": f'"{width} {height} 0 0 {width} {height} 1 "',
        "raw": "true",
        "name": f"map_{direction}",
        "label": quoted_word(label),
        "xpos": f"{x + 110}",
        "ypos": "0",
    }
    if files.span is not None:
        first, last = (str(n) for n in files.span)
        found |= {"first": first, "last": last}
        found |= {"origfirst": first, "origlast": last, "origset": "true"}
    if files.has_gaps:
        found["on_error"] = quoted_word("nearest frame")
    return found


def _enlarge(direction: str, size: tuple[int, int], x: int) -> dict[str, str]:
    """Keys' cubic reproduces ramps, which Nuke's own default does not."""
    width, height = size
    return {
        "format": f'"{width} {height} 0 0 {width} {height} 1 "',
        "resize": "distort",
        "filter": "Keys",
        "pbb": "true",
        "name": f"enlarge_{direction}",
        "xpos": f"{x + 110}",
        "ypos": "30",
    }


def _stmap(
    direction: str, channels: str, layer: str, x: int, y: int, ending: str = ""
) -> dict[str, str]:
    return {
        "inputs": "2",
        "channels": channels,
        "uv": layer,
        "name": f"STMap_{direction}{ending}",
        "xpos": f"{x}",
        "ypos": f"{y}",
    }


def _stmaps_of_channels(direction: str, column: int, x: int) -> Iterator[str]:
    """Three nodes, one behind the other; the plate lies on the stack."""
    for row, (channel, moved) in enumerate(_CHANNELS.items()):
        yield f"set Picture{column}{row} [stack 0]\npush $Map{column}\n"
        yield f"push $Picture{column}{row}\n"
        layer = _LAYER.format(channel)
        y = 120 + 40 * row
        yield node_text("STMap", _stmap(direction, moved, layer, x, y, f"_{channel}"))


def export_stmaps(request: ExportRequest) -> Exported:
    """Both UV maps in the folder `request.out`, as `lensfit stmap` writes them."""
    written = _maps(request, request.out)
    return _stmap_export(request, written, written.paths)


def export_nuke_maps(request: ExportRequest) -> Exported:
    """A Nuke script, and beside it the maps that it loads."""
    written = _maps(request, request.out.absolute().parent)
    label = (
        f"{lens_description(request, request.lens())}\nexact: UV maps, {request.frame}"
    )
    files = map(MapSequence, written.paths)
    maps = dict(zip(("undistort", "redistort"), files, strict=True))
    text = nuke_stmap_text(
        maps, request.frame.size_px, label, per_channel=request.per_channel
    )
    write_text_atomic(request.out, text)
    return _stmap_export(request, written, (request.out, *written.paths))


def _maps(request: ExportRequest, folder) -> WrittenStmaps:
    lens, frame = request.lens(), request.frame
    return write_stmaps(
        lens,
        StmapFrame(frame.size_px, frame.overscan_percent, frame.sensor_width_mm),
        folder,
        file_stem(request.preset.lens.name, lens),
        per_channel=request.per_channel,
        progress=request.progress,
    )


def _stmap_export(request: ExportRequest, written: WrittenStmaps, paths) -> Exported:
    found = export_result(
        request, request.lens(), (), has_colour=request.per_channel, paths=paths
    )
    needed = f"CG plates need {written.overscan_percent:.4f} % overscan in total"
    return Exported(found.paths, found.nearness, (*found.notes, *written.notes, needed))
