"""Wall and processor seconds of a piece of work: the first run, and steady state."""

import math
import statistics
from collections.abc import Callable
from typing import Any, NamedTuple

from lensfit.progress import stopwatch

RUNS = 3


class Times(NamedTuple):
    """Of several runs.

    Attributes
    ----------
    first_s : With whatever is made once and kept, compiled programs above all.
    steady_s : Median of the others; the first where there was no other.
    spread_s : Longest of the others less the shortest.
    cpu_s : Least processor seconds of the others, all threads together: other work on
        the machine barely changes them.
    """

    first_s: float
    steady_s: float
    spread_s: float
    cpu_s: float

    def as_peers(self) -> dict[str, float]:
        """What a row of the steady state says besides."""
        return {
            "first, s": self.first_s,
            "spread, s": self.spread_s,
            "processor, s": self.cpu_s,
        }


def timed(work: Callable[[], Any], runs: int = RUNS) -> tuple[Any, Times]:
    """The last result, and the times of one run and `runs - 1` more."""
    wall, cpu, result = [], [], None
    for _ in range(runs):
        with stopwatch() as spent:
            result = work()
        wall.append(spent["seconds"])
        cpu.append(spent["cpu_seconds"])
    others = wall[1:] or wall
    spread = max(others) - min(others)
    steady = statistics.median(others)
    return result, Times(wall[0], steady, spread, min(cpu[1:] or cpu))


def best(work: Callable[[], Any], runs: int = RUNS) -> tuple[Any, float, float]:
    """The last result, and the least wall and processor seconds of several runs."""
    result, wall, cpu = None, math.inf, math.inf
    for _ in range(runs):
        with stopwatch() as spent:
            result = work()
        wall, cpu = min(wall, spent["seconds"]), min(cpu, spent["cpu_seconds"])
    return result, wall, cpu
