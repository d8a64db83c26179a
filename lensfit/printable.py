"""Text of others on a line of ours: names, notes and headers, made safe to show.

Control characters move a terminal's cursor and change its colours, and are forbidden in
XML and YAML; bidirectional ones make a line read otherwise than it is. Each is written
as its escape, so that it is seen. Letters of every script stay, joiners too, which some
are written with.
"""

import re

_UNSAFE = re.compile(
    "[\x00-\x1f\x7f-\x9f"  # C0, DEL and C1
    "\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069"  # bidirectional (UAX 9)
    "\u00ad\u180e\u200b\u2060-\u2064\u206a-\u206f\ufff9-\ufffb\ufeff"  # unseen
    "\U000e0000-\U000e007f"  # tags, which say what nobody sees
    "\u2028\u2029\ud800-\udfff]"  # separators, lone surrogates
)


def printable(text: str) -> str:
    """The text on one line, with what cannot be shown as ``\\x1b`` or ``\\u202e``."""
    return _UNSAFE.sub(_escape_sequence, text)


def _escape_sequence(found: re.Match[str]) -> str:
    code = ord(found[0])
    if code > 0xFFFF:
        return f"\\U{code:08x}"
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}"
