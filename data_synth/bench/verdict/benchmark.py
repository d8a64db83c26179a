"""Whole calibrations of wrong and of right shoots, and what their verdicts said.

Wrong shoots are copies of one traced shoot, each spoilt in its own way; none may end
green, and the first line is to name the cause. Right shoots are of many lenses; none
may be refused or called unusable, and few may be called worse than the trace says.
"""

import tempfile
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from data_synth.bench.result import Row, as_tables, bench_result, machine
from data_synth.bench.verdict.wrong_shoots import (
    WRONG_SHOOTS,
    Wrong,
    WrongShoot,
)
from data_synth.bench.wavefront.benchmark import Trial
from data_synth.judge_depths import FrameErrors
from lensfit.errors import LensfitError
from lensfit.preset.schema import Preset
from lensfit.preset.store import load_preset
from lensfit.preset.verdict_levels import LEVELS, Level
from lensfit.programs import make_room_for_programs
from lensfit.progress import Progress, silent
from lensfit.report.evidence import GOOD_PX, ROUGH_PX
from lensfit.report.verdict import PRECISE_PX
from lensfit.workflow.calibrate import calibrate
from lensfit.workflow.shoot.shoot_file import load_shoot

Table = dict[str, Any]
Judge = Callable[[Preset, Path], FrameErrors]
"""Chief rays of a preset against the trace in its shoot's folder."""
REFUSED = "refused"
_NAMED_PART, _WORSE_PART = 0.8, 0.05


def bench_verdict(
    right: Sequence[Trial],
    spoilt: Trial | None,
    judge: Judge,
    out_dir: str | Path | None = None,
    *,
    reuse: bool = False,
    effort: str = "normal",
    progress: Progress = silent,
) -> Table:
    """Photograph and calibrate every shoot, and compare verdicts with what is true.

    Parameters
    ----------
    right : Right shoots.
    spoilt : The shoot that is spoilt in every way; None for no wrong shoots.
    judge : As `data_synth` does it.
    out_dir : Folder for shoots and bench_verdict.json; None keeps nothing.
    reuse : Take the photographs that already lie in the folder.
    effort : Of the blur; "none" leaves out what only blur tells.

    Returns
    -------
    "wrong" and "right", a row for each shoot; "rows" with bars; "errors".

    Raises
    ------
    LensfitError : The results cannot be written.
    """
    on = machine()
    found: dict[str, list[Table]] = {"wrong": [], "right": []}
    cases = WRONG_SHOOTS if spoilt is not None else ()
    whole = len(cases) + len(right)
    kept = nullcontext(out_dir) if out_dir else tempfile.TemporaryDirectory()
    with kept as root:
        base = Path(root)
        if spoilt is not None:
            _photograph(spoilt, base / spoilt.name, reuse)
        for case in cases:
            progress("shoots", len(found["wrong"]), whole)
            assert spoilt is not None
            with tempfile.TemporaryDirectory() as folder:
                copy = WrongShoot.copy_of(base / spoilt.name, Path(folder) / "shoot")
                found["wrong"].append(wrong_row(case, copy, effort))
        for trial in right:
            progress("shoots", len(cases) + len(found["right"]), whole)
            make_room_for_programs()
            folder = base / trial.name
            _photograph(trial, folder, reuse)
            found["right"].append(_right_row(trial, folder, judge, effort))
            _result(on, out_dir, found)
    progress("shoots", whole, whole)
    return _result(on, out_dir, found)


def wrong_row(case: Wrong, shoot: WrongShoot, effort: str = "normal") -> Table:
    """Spoil a copy, calibrate it and see what the first line says."""
    case.spoil(shoot)
    level, tone, line = _judged(shoot.save(), shoot.folder / "results", effort)
    return {
        "kind": case.kind,
        "about": case.about,
        "level": level,
        "green": tone == "good",
        "named": any(word in line for word in case.words),
        "first_line": line.removeprefix(f"{shoot.folder}/"),
    }


def level_of_errors(errors: FrameErrors) -> Level:
    """What a lens with these errors is good for: in its corners, as a verdict has it;
    for undistortion alone where an error of the focal length shows in the picture."""
    if errors.corner_px > GOOD_PX:
        return "look" if errors.corner_px <= ROUGH_PX else "unusable"
    if errors.scale_px > GOOD_PX:
        return "undistortion"
    return "measurement" if errors.corner_px <= PRECISE_PX else "match-moving"


def _right_row(trial: Trial, folder: Path, judge: Judge, effort: str) -> Table:
    results = folder / "results"
    level, _, line = _judged(folder / "shoot.toml", results, effort)
    errors = None
    if level != REFUSED:
        errors = judge(load_preset(results / "preset.json"), folder)
    true = None if errors is None else level_of_errors(errors)
    worse = true is not None and _rank(level) < _rank(true)
    return {
        "lens": trial.name,
        "about": trial.about,
        "level": level,
        "corner_px": errors and errors.corner_px,
        "scale_px": errors and errors.scale_px,
        "true_level": true,
        "worse": worse,
        "first_line": line,
    }


def _judged(
    shoot_file: Path, out: Path, effort: str = "normal"
) -> tuple[str, str, str]:
    """Level, tone and first line of a shoot."""
    try:
        judged = calibrate(load_shoot(shoot_file), out, effort=effort)["verdict"]
    except LensfitError as error:
        return REFUSED, "bad", str(error)
    return judged["level"], judged["reasons"][0]["tone"], judged["headline"]


def _rank(level: str) -> int:
    return LEVELS.index(level) if level in LEVELS else -1


def _photograph(trial: Trial, folder: Path, reuse: bool) -> None:
    if not (reuse and (folder / "shoot.toml").is_file()):
        trial.write(folder)


def _result(on: Table, out_dir: str | Path | None, found: dict[str, list]) -> Table:
    rows = as_tables([*_wrong_bars(found["wrong"]), *_right_bars(found["right"])])
    return bench_result("verdict", on, out_dir, rows=rows, errors=[], **found)


def _wrong_bars(wrong: Sequence[Table]) -> list[Row]:
    if not wrong:
        return []
    count = len(wrong)
    green, named = (float(sum(row[key] for row in wrong)) for key in ("green", "named"))
    named_of = f"of {count}: cause named in the first line"
    return [
        Row("wrong shoots", f"of {count}: green", green, 0.0),
        Row("wrong shoots", named_of, named, _NAMED_PART * count, count, least=True),
    ]


def _right_bars(right: Sequence[Table]) -> list[Row]:
    if not right:
        return []
    count = len(right)
    bad = float(sum(row["level"] in (REFUSED, "unusable") for row in right))
    worse = float(sum(row["worse"] for row in right))
    return [
        Row("right shoots", f"of {count}: refused or called unusable", bad, 0.0),
        Row(
            "right shoots",
            f"of {count}: called worse than the trace says",
            worse,
            _WORSE_PART * count,
        ),
    ]
