"""What goes wrong with files: bits, blocks, numbers, names, nesting, encodings.

A mutation takes the bytes of a file and a seeded `random.Random`, and returns other
bytes. Every choice comes from that generator, so that a file can be made again from
its reader's name and number.
"""

import json
import random
import re
from collections.abc import Callable, Sequence
from typing import Any

Mutation = Callable[[bytes, random.Random], bytes]

NUMBERS = (
    *("0", "-0.0", "-1", "1", "2", "3", "1e308", "-1e308", "1e400", "5e-324", "1e-400"),
    *(
        "nan",
        "NaN",
        "inf",
        "-inf",
        "Infinity",
        "2147483648",
        "-2147483649",
        "4294967295",
    ),
    *(
        "9223372036854775808",
        "1" * 400,
        "9" * 5000,
        "0x7f",
        "1_000",
        "٣",
        "1.2.3",
        "1/0",
    ),
    *(
        "1/3",
        "65535/65535",
        "1e5",
        "1e12",
        "1e19",
        "0.5",
        "+",
        "-",
        ".",
        "",
        "1e",
        "=1",
    ),
    *("true", "null", '"5"', "[5]", "{}"),
)
WORDS = (
    *("../../x", "../../../../../../etc/passwd", "/etc/passwd", "/dev/zero", "a\0b"),
    *("..\\..\\x", "C:\\x", "file:///etc/passwd", "//host/share", "~", "$HOME", "%n%s"),
    *(
        "",
        " ",
        ".",
        "..",
        "\n",
        "\r\n",
        "\t",
        "\x1b[31mred",
        "\u2028",
        "\x85",
        "\ufeff",
    ),
    *(
        "a" * 300,
        "b" * 70_000,
        "é" * 2000,
        "\u202egnp",
        "\U0001f3a5",
        "{{",
        "}}",
        "]]>",
    ),
    *(
        '"',
        "'",
        "\\",
        "#",
        "[curve x1 1 x2 2]",
        "<!--",
        "&a;",
        "${x}",
        "__proto__",
        "v001",
    ),
)
_BOMBS = (
    *(("[", "]"), ("{", "}"), ('{"a":', "}"), ("<a>", "</a>"), ("(", ")"), ("a.", "b")),
    *((" ", " "), ("\n", "\n"), ("\t", "\t"), (",", ","), ('"', '"'), ("\\", "\\")),
    *(
        ("a = {", "}"),
        ("x1 ", ""),
        ("#\n", ""),
        ("Camera2 {\n", "}\n"),
        ("<!--", "-->"),
    ),
)
_ENTITIES = (
    '<!DOCTYPE a [<!ENTITY a "ha">'
    + "".join(
        f'<!ENTITY {b} "{f"&{a};" * 10}">'
        for a, b in zip("abcdefghi", "bcdefghij", strict=True)
    )
    + "]>",
    '<!DOCTYPE a SYSTEM "file:///etc/passwd">',
    '<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/passwd">]>',
    '<?xml version="1.0" encoding="UTF-16"?>',
    '<?xml version="1.0" encoding="x-none"?>',
)
_NUMBER = re.compile(rb"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
_WORD = re.compile(rb'"[^"\n]*"|[A-Za-z_][\w./-]*')


def _spot(data: bytes, rng: random.Random) -> int:
    return rng.randrange(len(data) + 1)


def _block(data: bytes, rng: random.Random) -> tuple[int, int]:
    start = _spot(data, rng)
    longest = rng.choice((1, 4, 16, 64, 256, len(data)))
    return start, min(len(data), start + rng.randrange(longest + 1))


def bit_flips(data: bytes, rng: random.Random) -> bytes:
    """A few bits are wrong."""
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 8, 64))):
        if changed:
            changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def bytes_set(data: bytes, rng: random.Random) -> bytes:
    """A run of bytes is zero, all ones or noise."""
    start, end = _block(data, rng)
    filling = rng.choice((b"\0", b"\xff", b"\x7f", b"\x80", None))
    run = rng.randbytes(end - start) if filling is None else filling * (end - start)
    return data[:start] + run + data[end:]


def truncated(data: bytes, rng: random.Random) -> bytes:
    """The end is missing."""
    return data[: _spot(data, rng)]


def block_repeated(data: bytes, rng: random.Random) -> bytes:
    """A block stands there again and again."""
    start, end = _block(data, rng)
    times = rng.choice((1, 1, 2, 10, 1000))
    times = min(times, 1 + (1 << 20) // max(end - start, 1))
    return data[:end] + data[start:end] * times + data[end:]


def block_deleted(data: bytes, rng: random.Random) -> bytes:
    """A block is missing."""
    start, end = _block(data, rng)
    return data[:start] + data[end:]


def blocks_swapped(data: bytes, rng: random.Random) -> bytes:
    """Two neighbouring blocks stand in the wrong order."""
    a, b, c = sorted(_spot(data, rng) for _ in range(3))
    return data[:a] + data[b:c] + data[a:b] + data[c:]


def lines_shuffled(data: bytes, rng: random.Random) -> bytes:
    """A line is missing, stands twice, elsewhere, or a hundred thousand times."""
    lines = data.splitlines(keepends=True)
    if not lines:
        return data
    at, to = rng.randrange(len(lines)), rng.randrange(len(lines))
    kind = rng.randrange(4)
    if kind == 0:
        lines[at], lines[to] = lines[to], lines[at]
    elif kind == 1:
        lines.insert(to, lines[at])
    elif kind == 2:
        del lines[at]
    else:
        lines[at] *= rng.choice((100, 10_000, 100_000)) if len(lines[at]) < 20 else 100
    return b"".join(lines)


def _encoded(text: str) -> bytes:
    return text.encode("utf-8", "surrogatepass")


def _replaced(
    data: bytes, rng: random.Random, pattern: re.Pattern[bytes], words: Sequence[str]
) -> bytes:
    found = [match.span() for match in pattern.finditer(data[: 1 << 20])]
    if not found:
        return data + _encoded(rng.choice(words))
    for start, end in sorted(rng.choices(found, k=rng.choice((1, 1, 3))), reverse=True):
        word = _encoded(rng.choice(words))
        if data[start : start + 1] == b'"' and rng.random() < 0.8:
            word = b'"' + word + b'"'
        data = data[:start] + word + data[end:]
    return data


def numbers_replaced(data: bytes, rng: random.Random) -> bytes:
    """A number is huge, negative, no number, or not even a word."""
    return _replaced(data, rng, _NUMBER, NUMBERS)


def words_replaced(data: bytes, rng: random.Random) -> bytes:
    """A name leads elsewhere, is empty, endless or holds what no name may."""
    return _replaced(data, rng, _WORD, WORDS)


def words_swapped(data: bytes, rng: random.Random) -> bytes:
    """Two words or numbers of the file stand in each other's place."""
    both = re.compile(_WORD.pattern + b"|" + _NUMBER.pattern)
    found = [match.span() for match in both.finditer(data[: 1 << 20])]
    if len(found) < 2:
        return data
    (a, b), (c, d) = sorted(rng.sample(found, 2))
    return data[:a] + data[c:d] + data[b:c] + data[a:b] + data[d:]


def nested(data: bytes, rng: random.Random) -> bytes:
    """Brackets, or anything else that a reader may follow down, very many times."""
    before, after = (_encoded(word) for word in rng.choice(_BOMBS))
    depth = rng.choice((70, 1100, 20_000, 200_000))
    depth = min(depth, (1 << 20) // len(before))
    bomb = before * depth + (after * depth if rng.random() < 0.5 else b"")
    if rng.random() < 0.2:
        return bomb
    found = [m.span() for m in _NUMBER.finditer(data[: 1 << 20])]
    start, end = rng.choice(found) if found else (_spot(data, rng),) * 2
    return data[:start] + bomb + data[end:]


def entities(data: bytes, rng: random.Random) -> bytes:
    """XML that multiplies itself, or asks for another file."""
    text = rng.choice(_ENTITIES).encode()
    body = re.sub(rb"^<\?xml[^>]*>", b"", data)
    if rng.random() < 0.7:
        body = _replaced(body, rng, _NUMBER, ("&j;", "&x;", "&#0;", "&#x110000;"))
    return text + body


def recoded(data: bytes, rng: random.Random) -> bytes:
    """The same text in another encoding, or in one that is none."""
    text = data.decode("utf-8", "replace")
    kind = rng.randrange(9)
    if kind < 5:
        name = ("utf-16", "utf-16-le", "utf-16-be", "utf-32", "utf-7")[kind]
        return text.encode(name)
    if kind == 5:
        return b"\xef\xbb\xbf" * rng.choice((1, 2)) + data
    if kind == 6:
        return data.replace(
            b"\n", rng.choice((b"\r", b"\r\n", b"\n\n", b"\x85", b"\0"))
        )
    at = _spot(data, rng)
    odd = (
        b"\0",
        b"\xff\xfe",
        b"\xed\xa0\x80",
        b"\xc0\xaf",
        b"\xf4\x90\x80\x80",
        b"\x1a",
    )
    return data[:at] + rng.choice(odd) + data[at:]


_ODD: tuple[Any, ...] = (
    *(None, True, False, 0, -1, 3, 2**31, 2**63, 10**400, 0.5, 1e308, -1e308, 5e-324),
    *(float("nan"), float("inf"), "", "inf", "NaN", [], {}, [[]], {"a": 1}, [0] * 3000),
    *(
        "\ud800",
        "\0",
        "\x1b[0m",
        "a\nb",
        "../../x",
        "/etc/passwd",
        "x" * 5000,
        "v999999",
    ),
    *("lensfit.preset.99", "outer", "deadbeef", [None], [{}], {"": ""}),
)


def _places(value: Any, place: tuple = ()) -> list[tuple]:
    items = list(value.items()) if isinstance(value, dict) else []
    items = list(enumerate(value)) if isinstance(value, list) else items
    return [place] * bool(place) + [
        inner for key, below in items for inner in _places(below, (*place, key))
    ]


def tables_spoiled(data: bytes, rng: random.Random) -> bytes:
    """Values of JSON are of another kind, missing, or under another name."""
    try:
        tables = json.loads(data)
    except ValueError:
        return bit_flips(data, rng)
    for _ in range(rng.choice((1, 1, 2, 3))):
        places = _places(tables)
        if not places:
            break
        *above, last = rng.choice(places)
        parent = tables
        for key in above:
            parent = parent[key]
        kind = rng.random()
        if kind < 0.75:
            parent[last] = rng.choice(_ODD)
        elif kind < 0.85:
            del parent[last]
        elif isinstance(parent, dict):
            parent[str(rng.choice(WORDS))[:400]] = rng.choice(_ODD)
    return _encoded(json.dumps(tables, ensure_ascii=rng.random() < 0.5))


BYTES: tuple[Mutation, ...] = (
    *(bit_flips, bytes_set, truncated, block_repeated, block_deleted, blocks_swapped),
)
TEXT: tuple[Mutation, ...] = (
    *BYTES,
    *(lines_shuffled, numbers_replaced, numbers_replaced, words_replaced),
    *(words_replaced, words_swapped, nested, recoded),
)
JSON: tuple[Mutation, ...] = (*TEXT, *(tables_spoiled,) * 6)
XML: tuple[Mutation, ...] = (*TEXT, entities, entities)
