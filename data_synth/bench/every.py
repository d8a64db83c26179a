"""Every benchmark in one run, one row for each bar.

What needs photographs or plates that are not part of lensfit is left out, with a note,
where no data folder is given. The short run takes small sets of each kind; the long
one takes them all.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from data_synth.bench.detect import bench_detect
from data_synth.bench.fit.benchmark import bench_fit
from data_synth.bench.render.benchmark import bench_render
from data_synth.bench.result import bench_result, machine
from data_synth.bench.warp import bench_warp
from data_synth.bench.wavefront.benchmark import Judge, Trial, bench_wavefront
from lensfit.errors import LensfitError
from lensfit.progress import Progress, silent, stopwatch

QUICK_DOTS = ("dot_pattern_05", "gopro8")
QUICK_SETS = (*QUICK_DOTS, "line_pattern_01")
Part = Callable[[], dict[str, Any]]


def bench_all(
    trials: list[Trial],
    judge: Judge,
    data: str | Path | None = None,
    out_dir: str | Path | None = None,
    *,
    quick: bool = False,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Run every benchmark that can be run here.

    Parameters
    ----------
    trials, judge : Lenses to photograph, calibrate and judge (`bench_wavefront`).
    data : Folder with real/, oracle/ and plates/.
    out_dir : Folder for the results of each, and bench_all.json.
    quick : Small sets and frames only.

    Returns
    -------
    "rows" of all, "seconds" of each, "profiles", "floors", "notes", "errors",
    "machine".

    Raises
    ------
    LensfitError : The results cannot be written.
    """
    on, folder = machine(), None if out_dir is None else Path(out_dir)
    parts, notes = _parts(trials, judge, data, folder, quick, progress)
    rows, errors, seconds, profiles, floors = [], [], {}, {}, []
    for name, part in parts.items():
        found = {"rows": []}
        with stopwatch() as spent:
            try:
                found = part()
            except LensfitError as error:
                errors.append(f"{name}: {error}")
        seconds[name] = round(spent["seconds"], 1)
        profiles |= found.get("profiles", {})
        floors += found.get("floors", [])
        rows += [{"bench": name} | row for row in found["rows"]]
        errors += found.get("errors", [])
        notes += found.get("notes", [])
    said = {"seconds": seconds, "notes": notes, "errors": errors}
    where = {"profiles": profiles, "floors": floors}
    return bench_result("all", on, folder, rows=rows, **where, **said)


def _parts(
    trials: list[Trial],
    judge: Judge,
    data: str | Path | None,
    folder: Path | None,
    quick: bool,
    progress: Progress,
) -> tuple[dict[str, Part], list[str]]:
    """What can be run, in order, and what cannot."""

    def wavefront() -> dict[str, Any]:
        found = bench_wavefront(trials, judge, folder, progress=progress)
        return {"rows": found["bars"], "errors": found["errors"]}

    def render() -> dict[str, Any]:
        return bench_render(data or ".", folder, quick=quick, progress=progress)

    parts: dict[str, Part] = {
        "warp": lambda: bench_warp(folder, quick=quick, progress=progress)
    }
    notes = []
    plates = Path(data or ".") / "plates"
    if data is None:
        notes.append("no data folder (--data): photographs and plates are left out")
    else:
        dots, sets = (QUICK_DOTS, QUICK_SETS) if quick else (None, None)
        parts["detect"] = lambda: bench_detect(
            data, folder, only=dots, progress=progress
        )
        parts["fit"] = lambda: bench_fit(data, folder, only=sets, progress=progress)
        if (plates / "camera.json").is_file():
            parts["render"] = render
        else:
            notes.append(f"{plates} holds no plate: the renderer is left out")
    parts["wavefront"] = wavefront
    return parts, notes
