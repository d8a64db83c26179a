"""The memory that this process may still take, counted in one place.

On Linux it is what the system could free (``MemAvailable``), and no more than the
control groups of the process leave of theirs: a container or a task of a farm has less
than its host. Pages of files that are only cached count as free in both.
"""

import os
from collections.abc import Iterator
from pathlib import Path

_MEMINFO = Path("/proc/meminfo")
_OWN_GROUPS = Path("/proc/self/cgroup")
_GROUPS = Path("/sys/fs/cgroup")
_UNLIMITED = 1 << 60
_NAMES = {
    "": ("memory.max", "memory.current", "inactive_file"),
    "memory": (
        "memory.limit_in_bytes",
        "memory.usage_in_bytes",
        "total_inactive_file",
    ),
}
"""Files with limit and use, and the entry of ``memory.stat`` with what can be freed, in
the unified hierarchy of control groups and in the older one."""


def available_bytes() -> int | None:
    """What this process may still take; all that the machine has where the system tells
    no more than that, and None where it tells nothing."""
    known = [*_left_by_groups()]
    known += [b for b in (_left_by_machine(),) if b is not None]
    return min(known, default=None)


def _left_by_machine() -> int | None:
    try:
        for line in _MEMINFO.read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) * 1024
    except (OSError, ValueError, IndexError):
        pass
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return None


def _left_by_groups() -> Iterator[int]:
    """Of each group with a limit that holds the process."""
    try:
        lines = _OWN_GROUPS.read_text().splitlines()
    except (OSError, ValueError):
        return
    for line in lines:
        _, controllers, own = [*line.split(":", 2), "", ""][:3]
        if controllers and "memory" not in controllers.split(","):
            continue
        root = _GROUPS / ("memory" if controllers else "")
        inside = Path(own.lstrip("/"))
        # A container may see its own group as the root.
        for folder in dict.fromkeys([root / inside, *(root / inside).parents]):
            if root not in (folder, *folder.parents):
                break
            left = _left_by_group(folder, *_NAMES["memory" if controllers else ""])
            if left is not None:
                yield left


def _left_by_group(folder: Path, limit: str, used: str, freeable: str) -> int | None:
    try:
        most = int((folder / limit).read_text())  # "max" is no number
        if most >= _UNLIMITED:
            return None
        taken = int((folder / used).read_text())
        stat = (folder / "memory.stat").read_text().split()
        cached = int(stat[stat.index(freeable) + 1]) if freeable in stat else 0
    except (OSError, ValueError):
        return None
    return max(0, most - taken + cached)
