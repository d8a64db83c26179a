"""Values of a shoot file that nobody confirmed: their lines still say TODO.

The draft of `lensfit inspect --write-shoot` is valid as it stands, and marks what only
the photographer knows by a comment. Readers of TOML drop comments, so the text itself
is looked at.
"""

import re

_TABLE = re.compile(r"\s*\[+\s*([A-Za-z_]+)\s*\]+")
_KEY = re.compile(r"\s*([A-Za-z_]+)\s*=(.*)")
_QUOTED = re.compile(r"\"(?:\\.|[^\"\\])*\"|'[^']*'")
_LISTED: tuple[str, ...] = ("target", "take")


def keys_left_to_check(text: str) -> tuple[str, ...]:
    """The keys in use whose comment still says TODO, as "[[target]] 1, pitch_mm"
    or "lens.name".

    Parameters
    ----------
    text : A shoot file that was read without complaint.
    """
    found: list[str] = []
    table = ""
    counts: dict[str, int] = dict.fromkeys(_LISTED, 0)
    for line in text.splitlines():
        header, key = _TABLE.match(line), _KEY.match(line)
        if header:
            table = f"{header[1]}."
            if header[1] in counts:
                counts[header[1]] += 1
                table = f"[[{header[1]}]] {counts[header[1]]}, "
        elif key:
            _, _, comment = _QUOTED.sub("", key[2]).partition("#")
            if "TODO" in comment:
                found.append(table + key[1])
    return tuple(found)


def notes_of_draft(keys: tuple[str, ...]) -> tuple[str, ...]:
    """One sentence that names the unconfirmed keys; nothing if there are none."""
    if not keys:
        return ()
    named = "; ".join(keys)
    return (
        f"taken as drafted, as their lines still say TODO: {named}. Put in what is "
        "true and remove the TODO",
    )
