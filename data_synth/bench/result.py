"""What every benchmark returns: rows with their bars, and what they were taken on.

A row is a figure, the bar it is held to, and whether it passes. Figures of time mean
nothing without the machine that they were taken on.
"""

import json
import math
import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from msgspec import Struct, to_builtins

from lensfit.atomic import write_text_atomic

HONEST, SLACK = 68.0, 8.0
"""Percent of errors that one stated deviation covers, and how far off is passed."""


class Row(Struct, frozen=True):
    """One figure and its bar.

    Attributes
    ----------
    set : Of photographs.
    what : Is measured, with its unit.
    value : Measured now.
    bar : Largest value that passes (`least`: smallest); None informs only.
    aim : Where it should get to.
    peers : The same figure of other programs in the same run, by name.
    least : The bar is a lower one.
    expected : A value that `value` should be within `bar` of, in place of zero.
    """

    set: str
    what: str
    value: float
    bar: float | None = None
    aim: float | None = None
    peers: dict[str, float] = {}
    least: bool = False
    expected: float | None = None

    @property
    def passed(self) -> bool | None:
        """Whether the bar is met; None without a bar. An undefined value never is."""
        if self.bar is None:
            return None
        if math.isnan(self.value):
            return False
        if self.least:
            return self.value >= self.bar
        return abs(self.value - (self.expected or 0.0)) <= self.bar


def as_tables(rows: list[Row]) -> list[dict[str, Any]]:
    """Rows for JSON, undefined numbers as null."""
    return [_without_nan(to_builtins(row)) | {"passed": row.passed} for row in rows]


def _without_nan(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _without_nan(v) for k, v in value.items()}
    return None if isinstance(value, float) and not math.isfinite(value) else value


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


SCHEMA = "lensfit.bench.1"
Machine = dict[str, str | int | float]


def bench_result(
    bench: str,
    on: Machine,
    out_dir: str | Path | None,
    **found: Any,
) -> dict[str, Any]:
    """The result of a benchmark; written as bench_NAME.json where a folder is given.

    Parameters
    ----------
    bench : Its name.
    on : As `machine` described it when the benchmark began.
    found : Its figures.

    Raises
    ------
    OutputError : The file cannot be written.
    """
    result = {"schema": SCHEMA, "bench": bench, "machine": on} | found
    if out_dir is not None:
        text = json.dumps(result, indent=1)
        write_text_atomic(Path(out_dir) / f"bench_{bench}.json", text)
    return result
