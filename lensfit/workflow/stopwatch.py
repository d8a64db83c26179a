"""Seconds that a piece of work takes: on the wall, and of all processors together."""

import time
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def stopwatch() -> Iterator[dict[str, float]]:
    """Its "seconds" and "cpu_seconds" (of all threads), known once it is over."""
    spent: dict[str, float] = {}
    began, own = time.perf_counter(), time.process_time()
    try:
        yield spent
    finally:
        spent["seconds"] = time.perf_counter() - began
        spent["cpu_seconds"] = time.process_time() - own
