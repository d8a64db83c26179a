"""The number of processor cores that this process may use, counted in one place.

These are the cores that the system grants it, and no more than ``LENSFIT_CORES`` where
that is set: a task of a farm that was granted four cores of a host shares the others.
Processes that are started from here inherit the limit.
"""

import os

CORES_VARIABLE = "LENSFIT_CORES"


def available_cores() -> int:
    """Those that this process may use, at least one."""
    if hasattr(os, "sched_getaffinity"):
        granted = len(os.sched_getaffinity(0))
    else:
        granted = os.cpu_count() or 1
    limit = os.environ.get(CORES_VARIABLE, "")
    return max(1, min(granted, int(limit) if limit.isdecimal() else granted))


def limit_cores(cores: int) -> None:
    """Use no more than these, in this process and those that it starts.

    To be called before JAX is loaded, whose threads cannot be changed later.
    """
    os.environ[CORES_VARIABLE] = str(cores)
    # Read by XLA where it makes its pool of threads.
    os.environ["NPROC"] = str(available_cores())
