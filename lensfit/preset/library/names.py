"""Names of lenses and versions in a library.

A lens is a folder, named in lower-case ASCII after the lens and, behind an underscore,
its serial number: two copies of one lens are two lenses. A version is v001, v002 and
so on to v999999. A name from outside becomes a path only after it is checked here.
"""

import hashlib
import re
import unicodedata

from lensfit.errors import PresetError

LAST_VERSION = 999_999
_LONGEST = 100
_SLUG = re.compile(r"[a-z0-9][a-z0-9_-]*")
_VERSION = re.compile(r"v(\d{3,6})")


def slug_of(name: str, serial: str | None = None) -> str:
    """The folder of a lens: ``smc-takumar-50-1-4_1234567``."""
    words = _plain_words(name) or "lens"
    return f"{words}_{_plain_words(serial)}" if serial else words


def _plain_words(text: str) -> str:
    """Lower-case words joined by "-"; what that loses is kept as six digits of a hash.

    Names in other alphabets, of signs alone, and very long ones, thus stay apart.
    """
    ascii_text = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
    words = re.sub(r"[^a-z0-9]+", "-", ascii_text.lower()).strip("-")
    lost = any(
        c.isalnum() and not unicodedata.normalize("NFKD", c)[0].isascii() for c in text
    )
    lost |= not words and bool(text.strip())
    if not lost and len(words) <= _LONGEST:
        return words
    digits = hashlib.sha256(text.encode("utf-8", "replace")).hexdigest()[:6]
    return f"{words[:_LONGEST]}-{digits}".lstrip("-")


def requested_slug(name: str) -> str:
    """The folder that a person means by a lens' name, or by a folder's."""
    return name if is_slug(name) else _plain_words(name)


def is_slug(name: str) -> bool:
    """Whether this may be the folder of a lens."""
    return len(name) <= 2 * _LONGEST + 16 and _SLUG.fullmatch(name) is not None


def version_name(number: int) -> str:
    """ "v001" and so on."""
    return f"v{number:03d}"


def version_number(name: str) -> int | None:
    """The number in "v001"; None if it is no name of a version."""
    match = _VERSION.fullmatch(name)
    if match is None or version_name(int(match[1])) != name or not int(match[1]):
        return None
    return int(match[1])


def requested_version(text: str) -> int:
    """The number that a person means by v002, v2 or 2.

    Raises
    ------
    PresetError : It is no version.
    """
    match = re.fullmatch(r"[vV]?0*([1-9][0-9]{0,5})", text, re.ASCII)
    if match is None:
        raise PresetError(
            f"{text[:40]!r} is no version",
            remedy="versions are v001, v002, ..., latest and default",
        )
    return int(match[1])
