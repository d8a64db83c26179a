"""Whether stated deviations are true: one shoot again and again, with other noise.

A lens is photographed once without noise. For every draw the sensor is exposed anew,
points are detected and the lens is fitted as `calibrate` does it, and what it predicts
is kept with its stated standard deviations. An honest deviation covers 68 % of the
errors; which errors is told apart below.

Who photographs and who knows the truth is handed in, since the ray tracer stands apart
from this package. Every draw is a file of its own, so that a run that was stopped goes
on where it was.

Rows with bars say how often deviations cover what they should. There are two shares for
each quantity, over all draws and all places where it was predicted:

- of the scatter: |value - mean over the draws| is within the deviation. What the model
  itself gets wrong is the same in every draw and so not in it: a deviation that counts
  what the model misses covers more of the scatter than 68 %;
- of the truth: |value - truth| is within the deviation, whatever made the error. It is
  what a user relies on, and it alone has the bar.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from data_synth.bench.coverage.predictions import Prediction, Traced, predictions
from data_synth.bench.result import HONEST, SLACK, Row, as_tables, bench_result, machine
from lensfit.atomic import write_text_atomic
from lensfit.errors import DetectionError, LensfitError
from lensfit.fitting.lens_states import FittedLens, fit
from lensfit.fitting.wavefront.effort import Effort
from lensfit.lens import Lens
from lensfit.progress import Progress, silent, stopwatch
from lensfit.workflow.calibrate import preset_of
from lensfit.workflow.calibration.observe import observe_shoot
from lensfit.workflow.shoot.shoot_file import load_shoot

Draw = dict[str, Prediction]
_WHOLE = "psf_error_percent"


def coverage_rows(name: str, draws: list[Draw]) -> list[Row]:
    """Two rows for each quantity, three for whole point-spread functions."""
    if not draws:
        return [Row(name, "draws that could be calibrated", float("nan"), bar=0.0)]
    rows = []
    # Not every draw has every quantity, and the first that could be calibrated may not.
    for quantity in dict.fromkeys(name for draw in draws for name in draw):
        some = [draw[quantity] for draw in draws if quantity in draw]
        values, deviations, truths = map(np.stack, zip(*some, strict=True))
        if quantity == _WHOLE:
            rows += _whole_rows(name, deviations, truths)
            continue
        mean = values.mean(0)
        # The mean is of the same draws, and so too close to each by this factor.
        apart = np.sqrt(len(some) / max(len(some) - 1, 1)) * (values - mean)
        rows.append(_row(name, f"{quantity}, scatter covered, %", apart, deviations))
        known = np.isfinite(truths)
        if known.any():
            what, off = f"{quantity}, truth covered, %", (values - truths)[known]
            rows.append(_row(name, what, off, deviations[known], SLACK))
    return rows


def covered(
    errors: Float[np.ndarray, "*values"], deviations: Float[np.ndarray, "*values"]
) -> Bool[np.ndarray, "*values"]:
    """Which errors are within one standard deviation."""
    return np.abs(errors) <= deviations


def _row(
    name: str,
    what: str,
    errors: np.ndarray,
    deviations: np.ndarray,
    bar: float | None = None,
) -> Row:
    share = 100.0 * float(np.mean(covered(errors, deviations)))
    peers = {"stated": _rms(deviations), "found": _rms(errors)}
    return Row(name, what, share, bar=bar, expected=HONEST, peers=peers)


def _whole_rows(name: str, stated: np.ndarray, off: np.ndarray) -> list[Row]:
    """Of whole functions: the expected error and the true one."""
    return [
        Row(name, f"{_WHOLE}, stated, median", float(np.median(stated))),
        Row(name, f"{_WHOLE}, true, median", float(np.median(off))),
    ]


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


_DIGITS = 7
_SPOTS_EVERY = 5
"""Point-spread functions are asked of every so manieth draw: they take longest."""


@dataclass(frozen=True)
class Subject:
    """The lens that is photographed again and again.

    Attributes
    ----------
    name : Of the lens and of what else makes its photographs: what lies in a folder
        of that name is taken to be of it.
    photograph : Makes sure that the shoot lies in a folder, with its light and truth,
        and says what is true.
    expose : Writes the pictures of draw number so-and-so, with shoot.toml: (shoot's
        folder, draw, folder to write into).
    """

    name: str
    photograph: Callable[[Path], Traced]
    expose: Callable[[Path, int, Path], None]


def bench_coverage(
    subject: Subject,
    out_dir: str | Path,
    *,
    draws: int = 100,
    effort: str = "fastest",
    progress: Progress = silent,
) -> dict[str, Any]:
    """Calibrate a lens from many exposures of one shoot.

    Parameters
    ----------
    out_dir : Folder for bench_coverage.json and, in one of the subject's name, the
        shoot and a file for each draw; draws that lie there are not made again.
    effort : As for `calibrate`.
    progress : Told about each draw.

    Returns
    -------
    "rows", one for each bar, and "errors", one line for each draw that failed.

    Raises
    ------
    LensfitError : The folder cannot be written.
    """
    on, folder = machine(), Path(out_dir) / subject.name
    progress("draws", 0, draws)
    traced = subject.photograph(folder / "shoot")
    kept = folder / "draws"
    kept.mkdir(parents=True, exist_ok=True)
    done = []
    for number in range(draws):
        path = kept / f"{effort}_{number:04d}.json"
        if not path.is_file():
            made = _draw(subject, folder, number, effort, traced)
            write_text_atomic(path, json.dumps(made))
        done.append(json.loads(path.read_text()))
        progress("draws", number + 1, draws)
    good = [_read(one) for one in done if not one["failed"]]
    return bench_result(
        "coverage",
        on,
        out_dir,
        lens=subject.name,
        effort=effort,
        draws=len(good),
        rows=as_tables(coverage_rows(subject.name, good)),
        processor_s=round(float(np.mean([one["seconds"] for one in done])), 1),
        errors=[f"draw {k}: {d['failed']}" for k, d in enumerate(done) if d["failed"]],
    )


def _draw(
    subject: Subject, folder: Path, number: int, effort: str, traced: Traced
) -> dict[str, Any]:
    """One exposure, calibrated; what it predicts, as plain numbers."""
    made: dict[str, Any] = {"failed": None, "predicted": {}}
    exposed = folder / "exposed"
    if number % _SPOTS_EVERY:
        traced = replace(traced, spots=())
    with stopwatch() as spent:
        try:
            subject.expose(folder / "shoot", number, exposed)
            found = _calibrated(exposed, effort, traced)
            made["predicted"] = {name: _plain(one) for name, one in found.items()}
        except (LensfitError, ValueError, KeyError) as error:
            made["failed"] = f"{type(error).__name__}: {error}"
    return made | {"seconds": round(spent["cpu_seconds"], 2)}


def _calibrated(folder: Path, effort: str, traced: Traced) -> dict[str, Prediction]:
    shoot = load_shoot(folder / "shoot.toml")
    observed = observe_shoot(shoot, None, silent)
    failed = [one.failed for one in observed if one.failed]
    if failed:
        raise DetectionError(failed[0])
    fitted: FittedLens = fit(
        [one.take for one in observed if one.take], effort=Effort.from_name(effort)
    )
    preset = preset_of(shoot, observed, fitted)

    def lens_at(f_number: float, focus_distance_mm: float) -> Lens:
        return preset.at(traced.focal_length_mm, f_number, focus_distance_mm)

    return predictions(fitted, lens_at, traced)


def _plain(one: Prediction) -> dict[str, list[float | None]]:
    return {
        name: [
            float(f"{v:.{_DIGITS}g}") if np.isfinite(v) else None
            for v in values.tolist()
        ]
        for name, values in one._asdict().items()
    }


def _read(draw: dict[str, Any]) -> Draw:
    return {
        name: Prediction(**{k: np.array(part, float) for k, part in parts.items()})
        for name, parts in draw["predicted"].items()
    }
