"""Whole calibrations of traced lenses, each judged against the truth that made it.

Who makes the shoots and who judges is handed in, since the ray tracer stands apart from
this package. One lens that fails does not stop the others: its row says why. With a
folder everything stays in it, and the results are written again after every lens.
"""

import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax

from lensfit.errors import LensfitError
from lensfit.preset.schema import Preset
from lensfit.preset.store import load_preset
from lensfit.progress import Progress, silent
from lensfit.workflow.bench.machine import machine
from lensfit.workflow.bench.result import Machine, bench_result
from lensfit.workflow.bench.rows import as_tables
from lensfit.workflow.bench.wavefront.beside import (
    Beside,
    add_figures,
    images_left_out,
)
from lensfit.workflow.bench.wavefront.plot import write_plots
from lensfit.workflow.bench.wavefront.rows import wavefront_rows
from lensfit.workflow.calibrate import calibrate
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
    beside: Beside | None = None,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Photograph, calibrate and judge every lens.

    Parameters
    ----------
    judge : As `data_synth.judge` does it.
    out_dir : Folder for shoots, presets and bench_wavefront.json; None keeps nothing.
    reuse : Take the photographs that already lie in the folder.
    beside : What else is fitted to the same photographs; None for nothing. Error
        against time is then drawn as a picture for each lens.
    progress : Told about each lens.

    Returns
    -------
    "rows", one for each lens, "bars" (rows with bars and peers), and "errors", one line
    for each that failed.

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
            row = _row(trial, judge, Path(folder) / trial.name, reuse, beside)
            rows.append(row)
            _result(on, rows, out_dir)
            if beside is not None and beside.is_wanted and row["figures"] is not None:
                _add_beside(row, beside, Path(folder) / trial.name, progress)
                write_plots([row], None if out_dir is None else Path(out_dir))
                _result(on, rows, out_dir)
    progress("lenses", len(trials), len(trials))
    return _result(on, rows, out_dir)


def _result(
    on: Machine, rows: list[dict[str, Any]], out_dir: str | Path | None
) -> dict[str, Any]:
    errors = [f"{row['lens']}: {row['failed']}" for row in rows if row["failed"]]
    bars = as_tables([bar for row in rows for bar in wavefront_rows(row)])
    return bench_result("wavefront", on, out_dir, rows=rows, bars=bars, errors=errors)


def _row(
    trial: Trial, judge: Judge, folder: Path, reuse: bool, beside: Beside | None
) -> dict[str, Any]:
    """Figures and seconds of one lens, as far as it came."""
    row: dict[str, Any] = {
        "lens": trial.name,
        "about": trial.about,
        "failed": None,
        "converged": None,
        "figures": None,
        "report": None,
        "beside": {},
        "seconds": {},
    }
    with _failures(row):
        if not (reuse and (folder / "shoot.toml").is_file()):
            _timed(row, "photograph", lambda: trial.write(folder))
        made = folder / "calibrated"
        shoot = load_shoot(folder / "shoot.toml")
        if beside is not None:
            # A name that is wrong is told before minutes of fitting.
            images_left_out(beside.leave_out, shoot)
        report = _timed(row, "calibrate", lambda: calibrate(shoot, made))
        row["report"] = {key: report[key] for key in _REPORTED}
        row["converged"] = not any("converge" in note for note in report["notes"])
        preset = load_preset(made / "preset.json")
        row["figures"] = _timed(row, "judge", lambda: judge(preset, folder))
    return row


def _add_beside(
    row: dict[str, Any], beside: Beside, folder: Path, progress: Progress
) -> None:
    with _failures(row):
        shoot = load_shoot(folder / "shoot.toml")
        given = row["beside"], beside, shoot, folder, progress
        _timed(row, "beside", lambda: add_figures(*given))


@contextmanager
def _failures(row: dict[str, Any]) -> Iterator[None]:
    """What goes wrong with a lens becomes its `failed`: it must not hide the others."""
    try:
        yield
    except LensfitError as error:
        row["failed"] = str(error)
    except Exception as error:
        row["failed"] = f"{type(error).__name__}: {error}"


def _timed(row: dict[str, Any], name: str, work: Callable[[], Any]) -> Any:
    began = time.perf_counter()
    try:
        return work()
    finally:
        row["seconds"][name] = round(time.perf_counter() - began, 2)
