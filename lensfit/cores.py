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


def bind_to_share_of_cores(index: int, workers: int) -> None:
    """Keep this process, one of several, to its share of the cores, where the system
    allows it.

    To be called before JAX counts its cores.

    Parameters
    ----------
    index, workers : Which of how many processes it is.
    """
    if hasattr(os, "sched_setaffinity"):
        own = sorted(os.sched_getaffinity(0))
        share = own[index % workers :: workers] or [own[index % len(own)]]
        os.sched_setaffinity(0, share)


def limit_cores(cores: int) -> None:
    """Use no more than these, in this process and those that it starts.

    To be called before JAX is loaded, whose threads cannot be changed later.
    """
    os.environ[CORES_VARIABLE] = str(cores)
    # Read by XLA where it makes its pool of threads.
    os.environ["NPROC"] = str(available_cores())
