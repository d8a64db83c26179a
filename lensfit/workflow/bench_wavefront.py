"""Whole calibrations of traced lenses, each judged against the truth that made it.

Who makes the shoots and who judges is handed in, since the ray tracer stands apart from
this package. One lens that fails does not stop the others: its row says why. With a
folder everything stays in it, and the results are written again after every lens.
"""

import tempfile
import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax

from lensfit.errors import LensfitError
from lensfit.preset.schema import Preset
from lensfit.preset.store import load_preset
from lensfit.progress import Progress, silent
from lensfit.workflow.bench_result import Machine, bench_result
from lensfit.workflow.calibrate import calibrate
from lensfit.workflow.machine import machine
from lensfit.workflow.shoot.file import load_shoot

_REPORTED = ("rms_px", "held_out_rms_px", "seconds", "notes")


@dataclass(frozen=True)
class Trial:
    """One lens to try.

    Attributes
    ----------
    name : Of the lens, and of its folder.
    about : What it is, in a few words.
    write : Photographs it into a folder: pictures, shoot.toml and truth.
    """

    name: str
    about: str
    write: Callable[[Path], None]


Judge = Callable[[Preset, Path], dict[str, Any]]
"""Figures of a preset against the truth in a shoot's folder."""


def bench_wavefront(
    trials: list[Trial],
    judge: Judge,
    out_dir: str | Path | None = None,
    *,
    reuse: bool = False,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Photograph, calibrate and judge every lens.

    Parameters
    ----------
    judge : As `data_synth.judge` does it.
    out_dir : Folder for shoots, presets and bench_wavefront.json; None keeps nothing.
    reuse : Take the photographs that already lie in the folder.
    progress : Told about each lens.

    Returns
    -------
    "rows", one for each lens, and "errors", one line for each that failed.

    Raises
    ------
    LensfitError : The results cannot be written.
    """
    on, rows = machine(), []
    kept = nullcontext(out_dir) if out_dir else tempfile.TemporaryDirectory()
    with kept as folder:
        for done, trial in enumerate(trials):
            progress("lenses", done, len(trials))
            # Every lens has programs of its own, and a process may map only so many.
            jax.clear_caches()
            rows.append(_row(trial, judge, Path(folder) / trial.name, reuse))
            _result(on, rows, out_dir)
    progress("lenses", len(trials), len(trials))
    return _result(on, rows, out_dir)


def _result(
    on: Machine, rows: list[dict[str, Any]], out_dir: str | Path | None
) -> dict[str, Any]:
    errors = [f"{row['lens']}: {row['failed']}" for row in rows if row["failed"]]
    return bench_result("wavefront", on, out_dir, rows=rows, errors=errors)


def _row(trial: Trial, judge: Judge, folder: Path, reuse: bool) -> dict[str, Any]:
    """Figures and seconds of one lens, as far as it came."""
    row: dict[str, Any] = {
        "lens": trial.name,
        "about": trial.about,
        "failed": None,
        "converged": None,
        "figures": None,
        "report": None,
        "seconds": {},
    }
    try:
        if not (reuse and (folder / "shoot.toml").is_file()):
            _timed(row, "photograph", lambda: trial.write(folder))
        made = folder / "calibrated"
        shoot = load_shoot(folder / "shoot.toml")
        report = _timed(row, "calibrate", lambda: calibrate(shoot, made))
        row["report"] = {key: report[key] for key in _REPORTED}
        row["converged"] = not any("converge" in note for note in report["notes"])
        preset = load_preset(made / "preset.json")
        row["figures"] = _timed(row, "judge", lambda: judge(preset, folder))
    except LensfitError as error:
        row["failed"] = str(error)
    except Exception as error:  # a fault in one lens must not hide the others
        row["failed"] = f"{type(error).__name__}: {error}"
    return row


def _timed(row: dict[str, Any], name: str, work: Callable[[], Any]) -> Any:
    began = time.perf_counter()
    try:
        return work()
    finally:
        row["seconds"][name] = round(time.perf_counter() - began, 2)
