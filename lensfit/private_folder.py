"""Folders that only their user can write: where compiled programs may be loaded from.

A compiled program is code. Whoever can put a file into the folder that it is read from
runs code as everyone who reads it, so that ownership and permissions are looked at, and
not the files' own checksums. The folders around count too: who can rename one of them
can put another in its place. Systems without users in this sense (Windows) protect the
user's folders by themselves.
"""

import os
import stat
from contextlib import suppress
from pathlib import Path

_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
_OWN_ONLY = 0o700
_ROOT = 0


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


def made_private(folder: Path) -> Path | None:
    """The folder, by its real path, once it has been made where it was missing; None
    where it cannot be written, or where others could write it or put another in its
    place."""
    with suppress(OSError, ValueError):
        for missing in reversed([p for p in (folder, *folder.parents)]):
            if not missing.exists():
                missing.mkdir(_OWN_ONLY, exist_ok=True)
    if not is_private(folder) or not os.access(folder, os.W_OK):
        return None
    real = folder.resolve()
    return real if is_private(real) and is_in_place(real) else None


def is_open_to_others(folder: Path) -> bool:
    """Whether a folder is there, and is not the user's alone."""
    return folder.exists() and not (is_private(folder) and is_in_place(folder))


def is_in_place(folder: Path) -> bool:
    """Whether nobody but the user and root can put another folder in the place of this
    one, or of one that it lies in."""
    own = user_id()
    try:
        around = folder.resolve(strict=True).parents
        return own is None or all(_keeps_names(p.stat(), own) for p in around)
    except (OSError, ValueError, RuntimeError):
        return False


def _keeps_names(found: os.stat_result, own: int) -> bool:
    """Whether the names in a folder are safe from others: as SSH asks of the folders
    around its keys, and those that all write to are sticky (as /tmp is)."""
    if found.st_uid not in (own, _ROOT):
        return False
    if found.st_mode & stat.S_ISVTX:
        return True
    return not found.st_mode & stat.S_IWOTH and (
        not found.st_mode & stat.S_IWGRP or _is_own_group(found.st_gid, own)
    )


def _is_own_group(group: int, own: int) -> bool:
    """Whether a group is the user's alone, as many systems make one for each."""
    import grp
    import pwd

    try:
        name, members = pwd.getpwuid(own).pw_name, grp.getgrgid(group)
    except KeyError:
        return False
    return members.gr_name == name and set(members.gr_mem) <= {name}
