"""Read XML of other programs as a plain tree, without access to anything else.

The standard library's expat parses; nothing outside the file is ever loaded. A document
type is ignored when it only names a file, as those of lensfun do; one that declares
anything (entities that multiply, attributes) is refused, and so are deep or endless
trees.
"""

import xml.parsers.expat
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn

from lensfit.errors import ExchangeError
from lensfit.exchange.text_file import read_text

_DEEPEST = 40
_MOST_ELEMENTS = 200_000


@dataclass(eq=False)
class Element:
    """An XML element: its text is that directly inside it, ends trimmed."""

    tag: str
    attributes: dict[str, str]
    children: list["Element"] = field(default_factory=list)
    text: str = ""

    def all(self, tag: str) -> list["Element"]:
        """Children of that name."""
        return [child for child in self.children if child.tag == tag]

    def text_of(self, tag: str) -> str | None:
        """Text of the first child of that name."""
        return next((child.text for child in self.all(tag)), None)


def read_xml(path: str | Path, kind: str) -> Element:
    """The root element of a file.

    Raises
    ------
    ExchangeError : It is no XML, declares entities, or is deeper or longer than any
        lens file.
    """
    text = read_text(path, kind)
    builder = _Builder(Path(path))
    parser = xml.parsers.expat.ParserCreate()
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.characters
    parser.StartDoctypeDeclHandler = builder.doctype
    parser.EntityDeclHandler = builder.declaration
    parser.SkippedEntityHandler = builder.declaration
    try:
        # The text is UTF-8 by now, whatever its first line says of itself.
        parser.Parse(text.encode(), True)
    except (xml.parsers.expat.ExpatError, ValueError, LookupError) as error:
        raise ExchangeError(f"is no XML ({error})", where=path) from error
    if builder.root is None:
        raise ExchangeError("is empty XML", where=path)
    return builder.root


class _Builder:
    """What expat calls."""

    def __init__(self, path: Path):
        self.path = path
        self.root: Element | None = None
        self._open: list[Element] = []
        self._words: list[list[str]] = []
        self._count = 0

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        self._count += 1
        if self._count > _MOST_ELEMENTS or len(self._open) >= _DEEPEST:
            raise ExchangeError(
                f"has more than {_MOST_ELEMENTS} elements, or elements {_DEEPEST} deep",
                where=self.path,
                remedy="give the file of a lens",
            )
        element = Element(tag, attributes)
        if self._open:
            self._open[-1].children.append(element)
        else:
            self.root = element
        self._open.append(element)
        self._words.append([])

    def end(self, _tag: str) -> None:
        self._open.pop().text = "".join(self._words.pop()).strip()

    def characters(self, text: str) -> None:
        self._words[-1].append(text)

    def doctype(self, *declared: object) -> None:
        if declared[-1]:
            self.declaration()

    def declaration(self, *_declared: object) -> NoReturn:
        raise ExchangeError(
            "declares or uses XML entities, which no lens file needs",
            where=self.path,
            remedy="take the declarations out",
        )
