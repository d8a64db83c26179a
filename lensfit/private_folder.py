"""Folders that only their user can write: where compiled programs may be loaded from.

A compiled program is code. Whoever can put a file into the folder that it is read from
runs code as everyone who reads it, so that ownership and permissions are looked at, and
not the files' own checksums. Systems without users in this sense (Windows) protect the
user's folders by themselves.
"""

import os
import stat
from contextlib import suppress
from pathlib import Path

_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
_OWN_ONLY = 0o700


def user_id() -> int | None:
    """Of whoever runs this process; None where the system has none."""
    return os.geteuid() if hasattr(os, "geteuid") else None


def is_private(folder: Path) -> bool:
    """Whether a folder is there, belongs to the user, and nobody else can write it; a
    link to one is none."""
    try:
        found = folder.lstat()
    except (OSError, ValueError):
        return False
    if not stat.S_ISDIR(found.st_mode):
        return False
    own = user_id()
    return own is None or (found.st_uid == own and not found.st_mode & _OTHERS_WRITE)


def is_own_file(descriptor: int) -> bool:
    """Whether an open file is an ordinary one and belongs to the user."""
    found, own = os.fstat(descriptor), user_id()
    return stat.S_ISREG(found.st_mode) and own in (None, found.st_uid)


def made_private(folder: Path) -> bool:
    """Whether a folder is private, once it has been made where it was missing."""
    with suppress(OSError, ValueError):
        for missing in reversed([p for p in (folder, *folder.parents)]):
            if not missing.exists():
                missing.mkdir(_OWN_ONLY, exist_ok=True)
    return is_private(folder) and os.access(folder, os.W_OK)
