"""A digest of a finished frame's own file, kept in its header.

The fingerprint tells what a frame was made of, not whether its pixels are still those
that were written: a disk or a copy may lose some of them, and a header outlives that.
Whoever skips a finished frame reads its bytes, which costs what the digest of its plate
does, and far less than decoding both.

The digest is of all bytes of the file, its own digits taken as zeros.
"""

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO

from lensfit.atomic import atomic_path
from lensfit.io.exr import ExrImage, write_exr
from lensfit.plate.frame.provenance import is_made_here

CONTENT = "lensfit/content"
"""Header entry that holds it."""
_DIGITS = 16
_BLANK = "0" * _DIGITS
_ENTRY = CONTENT.encode() + b"\0string\0" + _DIGITS.to_bytes(4, "little")
"""As OpenEXR lays out an attribute: name, type, length; its text follows."""
_HEADER_BYTES = 1 << 24
_CHUNK_BYTES = 1 << 20


def write_with_digest(target: Path, image: ExrImage) -> None:
    """Write a finished frame, whole or not at all, with the digest of its file.

    Raises
    ------
    OutputError : As `write_exr`.
    """
    with atomic_path(target) as temporary:
        write_exr(temporary, _with_blank(image))
        with temporary.open("r+b") as file:
            at = _place(file)
            if at is not None:
                digest = _digest(file, at)
                file.seek(at)
                file.write(digest.encode())


def is_whole(frame: Path) -> bool:
    """Whether a finished frame holds the bytes that were written; not where it has no
    digest, or its disk no longer reads all of it."""
    try:
        with frame.open("rb") as file:
            at = _place(file)
            if at is None:
                return False
            file.seek(at)
            return file.read(_DIGITS).decode("latin-1") == _digest(file, at)
    except OSError:
        return False


def _with_blank(image: ExrImage) -> ExrImage:
    """With room for the digest in the first part that was made here, and none of what
    the plate went through before."""
    parts = [
        replace(p, attributes={k: v for k, v in p.attributes.items() if k != CONTENT})
        for p in image.parts
    ]
    made = (index for index, part in enumerate(parts) if is_made_here(part))
    if (first := next(made, None)) is not None:
        attributes = {**parts[first].attributes, CONTENT: _BLANK}
        parts[first] = replace(parts[first], attributes=attributes)
    return ExrImage(tuple(parts))


def _place(file: BinaryIO) -> int | None:
    """Where the digits stand."""
    file.seek(0)
    found = file.read(_HEADER_BYTES).find(_ENTRY)
    return None if found < 0 else found + len(_ENTRY)


def _digest(file: BinaryIO, at: int) -> str:
    digest = hashlib.sha256()
    file.seek(0)
    digest.update(file.read(at) + _BLANK.encode())
    file.seek(at + _DIGITS)
    while chunk := file.read(_CHUNK_BYTES):
        digest.update(chunk)
    return digest.hexdigest()[:_DIGITS]
