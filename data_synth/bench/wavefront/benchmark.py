"""Whole calibrations of traced lenses, each judged against the truth that made it.

Who makes the shoots and who judges is handed in, since the ray tracer stands apart from
this package. One lens that fails does not stop the others: its row says why. With a
folder everything stays in it, and the results are written again after every lens.
"""

import tempfile
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from data_synth.bench.plot import write_psf_plot
from data_synth.bench.result import Machine, as_tables, bench_result, machine
from data_synth.bench.wavefront.beside import (
    Beside,
    Seen,
    add_figures,
    images_left_out,
)
from data_synth.bench.wavefront.rows import many_lenses_rows, wavefront_rows
from lensfit.errors import LensfitError
from lensfit.preset.schema import Preset
from lensfit.preset.store import load_preset
from lensfit.programs import make_room_for_programs
from lensfit.progress import Progress, silent, stopwatch
from lensfit.workflow.calibrate import calibrate_observed
from lensfit.workflow.shoot.shoot_file import load_shoot
from lensfit.workflow.shoot.shoot_records import Shoot

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
    effort: str = "normal",
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
    effort : Of each calibration.
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
    with kept as root:
        for done, trial in enumerate(trials):
            progress("lenses", done, len(trials))
            make_room_for_programs()
            row, folder = _empty_row(trial), Path(root) / trial.name
            rows.append(row)
            with _failures(row):
                shoot = _photographed(row, trial, folder, reuse, beside)
                seen = _calibrated(row, shoot, judge, folder, effort)
                _result(on, rows, out_dir)
                if beside is not None and beside.is_wanted:
                    _add_beside(row, beside, seen, folder, out_dir)
            _result(on, rows, out_dir)
    progress("lenses", len(trials), len(trials))
    return _result(on, rows, out_dir)


def _result(
    on: Machine, rows: list[dict[str, Any]], out_dir: str | Path | None
) -> dict[str, Any]:
    errors = [f"{row['lens']}: {row['failed']}" for row in rows if row["failed"]]
    bars = as_tables(
        [bar for row in rows for bar in wavefront_rows(row)] + many_lenses_rows(rows)
    )
    return bench_result("wavefront", on, out_dir, rows=rows, bars=bars, errors=errors)


def _empty_row(trial: Trial) -> dict[str, Any]:
    """Figures and seconds of one lens, as far as it came."""
    return {
        "lens": trial.name,
        "about": trial.about,
        "failed": None,
        "converged": None,
        "said_short": None,
        "figures": None,
        "report": None,
        "beside": {},
        "seconds": {},
    }


def _photographed(
    row: dict[str, Any], trial: Trial, folder: Path, reuse: bool, beside: Beside | None
) -> Shoot:
    if not (reuse and (folder / "shoot.toml").is_file()):
        with _timed(row, "photograph"):
            trial.write(folder)
    shoot = load_shoot(folder / "shoot.toml")
    if beside is not None:
        # A name that is wrong is told before minutes of fitting.
        images_left_out(beside.leave_out, shoot)
    return shoot


def _calibrated(
    row: dict[str, Any], shoot: Shoot, judge: Judge, folder: Path, effort: str
) -> Seen:
    """Marks, preset and figures; what was seen serves again."""
    made = folder / "calibrated"
    with _timed(row, "calibrate"):
        seen = Seen.of(shoot, made)
        report = calibrate_observed(*seen, made, effort=effort)
    row["report"] = {key: report[key] for key in _REPORTED}
    row["converged"] = not any("converge" in note for note in report["notes"])
    row["said_short"] = not report["blur"] or any(map(_says_short, report["blur"]))
    with _timed(row, "judge"):
        row["figures"] = judge(load_preset(made / "preset.json"), folder)
    return seen


def _says_short(blur: dict[str, Any]) -> bool:
    """Whether a report says itself that its blur is not to be relied on everywhere."""
    reached = blur["converged"] and blur["sign_known"] and not blur["mirrored"]
    return not reached or bool(blur["extrapolated"])


def _add_beside(
    row: dict[str, Any],
    beside: Beside,
    seen: Seen,
    folder: Path,
    out_dir: str | Path | None,
) -> None:
    """What comes before a failure is kept, and drawn."""
    try:
        with _timed(row, "beside"):
            add_figures(row["beside"], beside, seen, folder)
    finally:
        if out_dir is not None:
            write_psf_plot(row, Path(out_dir))


@contextmanager
def _failures(row: dict[str, Any]) -> Iterator[None]:
    """What goes wrong with a lens becomes its `failed`: it must not hide the others."""
    try:
        yield
    except LensfitError as error:
        row["failed"] = str(error)
    except Exception as error:
        at = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{Path(at.filename).name}, line {at.lineno}"
        row["failed"] = f"{type(error).__name__}: {error} ({where})"


@contextmanager
def _timed(row: dict[str, Any], stage: str) -> Iterator[None]:
    try:
        with stopwatch() as spent:
            yield
    finally:
        row["seconds"][stage] = round(spent["seconds"], 2)
