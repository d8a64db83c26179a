"""What the first run on a machine, the first run of a process, and any other cost.

Each job runs in two processes of its own, one after the other, that share a cache of
compiled programs which is empty at first. So importing, compiling, the first run and
the steady state are told apart:

    import       modules, before anything is done
    compilation  of programs by the first process, as JAX counts it
    first run    of the second process: tracing, and programs from the cache
    steady       any other run
"""

import json
import os
import sys
import tempfile
from pathlib import Path

from msgspec import Struct, convert

from data_synth.bench.own_process import output_of
from data_synth.bench.result import Row
from lensfit._jax import CACHE_VARIABLE

START_SET = "dot_pattern_05"
JOBS = {"fit": f"detect and fit {START_SET}", "render": "read and render the plate"}
_MODULE = "data_synth.bench.start_job"
_PATIENCE_S = 600


class JobTimes(Struct, frozen=True):
    """Of one process; what its script prints."""

    import_s: float
    compiled_s: float
    first_s: float
    steady_s: float


def start_rows(job: str, data: str | Path) -> list[Row]:
    """Times of one of `JOBS`.

    Raises
    ------
    LensfitError : The job failed.
    """
    with tempfile.TemporaryDirectory() as cache:
        empty, full = (_ran(job, Path(data), cache) for _ in range(2))
    compiled = {"first run with an empty cache": empty.first_s}
    steady = full.steady_s
    return [
        Row(JOBS[job], "import, s", full.import_s),
        Row(JOBS[job], "compilation, s", empty.compiled_s, peers=compiled),
        Row(JOBS[job], "first run of a process, s", full.first_s),
        Row(JOBS[job], "steady state, s", steady),
    ]


def _ran(job: str, data: Path, cache: str) -> JobTimes:
    told = {k: v for k, v in os.environ.items() if k != "JAX_COMPILATION_CACHE_DIR"}
    lines = output_of(
        [sys.executable, "-m", _MODULE, job, str(data)],
        patience_s=_PATIENCE_S,
        failed=f"{JOBS[job]}, in a process of its own, failed",
        where=data,
        remedy="give the folder that holds real/ and plates/ with --data",
        environment=told | {CACHE_VARIABLE: cache},
    )
    return convert(json.loads(lines[-1]), JobTimes)
