"""What every benchmark returns and writes: its figures, and what they were taken on."""

import json
from pathlib import Path
from typing import Any

from lensfit.atomic import write_text_atomic

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
