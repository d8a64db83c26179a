"""What a benchmark ran on: figures of time mean nothing without it."""

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

_LIBRARIES = ("jax", "numpy", "opencv-contrib-python-headless", "scipy", "scikit-image")


def machine() -> dict[str, str | int | float]:
    """Processor, cores this process may use, memory, load, and versions."""
    found: dict[str, str | int | float] = {
        "processor": _processor(),
        "cores": len(os.sched_getaffinity(0)),
        "memory_gib": round(_memory_bytes() / 2**30, 1),
        "load": round(os.getloadavg()[0], 2),
        "python": platform.python_version(),
    }
    for name in _LIBRARIES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:  # another build of the same library
            continue
    return found


def described(on: dict[str, str | int | float]) -> str:
    """One line for people."""
    return (
        f"{on['processor']}, {on['cores']} cores, {on['memory_gib']} GiB, load "
        f"{on['load']} when it began; Python {on['python']}, jax {on['jax']}"
    )


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    named = (line.partition(":")[2] for line in lines if line.startswith("model name"))
    return " ".join(next(named, platform.machine()).split())


def _memory_bytes() -> int:
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
