"""Read text and XML of other programs within bounds; a wrong file is one error line.

A lens file is kilobytes. What is larger than `LARGEST_BYTES`, no ordinary file, or no
text is refused before it is parsed; numbers must be finite.

XML is read as a plain tree, without access to anything else. The standard library's
expat parses; nothing outside the file is ever loaded. A document type is ignored when
it only names a file, as those of lensfun do; one that declares anything (entities that
multiply, attributes) is refused, and so are deep or endless trees.
"""

import math
import xml.parsers.expat
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn

from lensfit.bounded import read_bounded, utf8_text
from lensfit.errors import ExchangeError

LARGEST_BYTES = 4 << 20
_LARGEST_SIDE_PX = 100_000


def read_text(path: str | Path, kind: str) -> str:
    """The text of a file.

    Parameters
    ----------
    kind : What it should be, for messages, such as "OpenCV calibration".

    Raises
    ------
    ExchangeError : It cannot be read, is too large, or is no UTF-8 text.
    """
    path, remedy = Path(path), f"give the {kind}"
    content = read_bounded(
        path,
        LARGEST_BYTES,
        error=ExchangeError,
        remedy=remedy,
        too_large="give the file of one lens",
    )
    return utf8_text(content, path, error=ExchangeError, remedy=remedy)


def finite_number(value: object, what: str, where: str | Path) -> float:
    """A number of a file, given as text or as a number.

    Raises
    ------
    ExchangeError : It is no finite number.
    """
    try:
        if isinstance(value, bool) or not isinstance(value, (str, int, float)):
            raise ValueError
        number = float(value)
    except (ValueError, OverflowError):
        raise ExchangeError(
            f"{what} = {_short(value)} is no number", where=where
        ) from None
    if not math.isfinite(number):
        raise ExchangeError(f"{what} = {_short(value)} is not finite", where=where)
    return number


def positive_number(value: object, what: str, where: str | Path) -> float:
    """A `finite_number` above zero.

    Raises
    ------
    ExchangeError : It is none.
    """
    number = finite_number(value, what, where)
    if not number > 0:
        raise ExchangeError(f"{what} = {number:g} is not positive", where=where)
    return number


def picture_size(
    sides: Sequence[float], name: str, where: str | Path
) -> tuple[int, int]:
    """Width and height of a picture in pixels.

    Raises
    ------
    ExchangeError : They are none, or beyond any picture.
    """
    if len(sides) != 2 or not all(
        0 < n < _LARGEST_SIDE_PX and n % 1 == 0 for n in sides
    ):
        raise ExchangeError(f"{name} is no size in pixels", where=where)
    return int(sides[0]), int(sides[1])


def _short(value: object) -> str:
    text = str(value) if isinstance(value, (str, float)) else type(value).__name__
    return text if len(text) <= 40 else text[:37] + "..."


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
