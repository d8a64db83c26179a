"""Nodes in Nuke script text: a class, and knobs with values in braces.

    Class {
     knob value
     knob {a list}
     name node1
    }

Only what is needed to take plain knobs out of a script, or of text on the clipboard,
and to write such text; nothing in a script is evaluated.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from lensfit.errors import ExchangeError
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


def quoted(text: str) -> str:
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
