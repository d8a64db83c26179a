"""Blur from every kind of chart: traced lenses photographed with each, judged by psf.

A lens is photographed wide open and two stops down, in focus, nearer, farther and
tilted, with one kind of chart alone; errors are those of `data_synth.judge`, relative
(L2), over the field, colours and settings, those never photographed included. Of one
photograph in focus only its own setting counts.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from data_synth.bench.result import Row, as_tables, bench_result, machine
from data_synth.bench.wavefront.benchmark import Judge, Trial, bench_wavefront
from data_synth.prescription import load_prescription
from data_synth.wavefront_cases import subject_of
from data_synth.wavefront_plan import CHART_PLANS, WavefrontPlan
from lensfit.errors import LensfitError
from lensfit.progress import Progress, silent

LENSES = ("biotar_50", "nikkor_28", "petzval_50")
"""A double Gauss, a retrofocus and a Petzval lens."""
_HONEST, _SLACK = 67.5, 12.5
"""Percent of errors within one stated deviation: 55 to 80 pass."""


class ChartCase(NamedTuple):
    """One kind of chart, what its blur is held to, and what is aimed at; median and
    90th percentile."""

    plan: WavefrontPlan
    bar: tuple[float, float]
    aim: tuple[float, float]


ONE_PHOTOGRAPH = replace(
    CHART_PLANS["dots_20"],
    focus_states=("in",),
    with_tilted=False,
    with_stopped_down=False,
)
CHARTS = {
    "holes": ChartCase(CHART_PLANS["holes"], (0.03, 0.07), (0.025, 0.06)),
    "dots_6": ChartCase(CHART_PLANS["dots_6"], (0.05, 0.12), (0.03, 0.08)),
    "dots_20": ChartCase(CHART_PLANS["dots_20"], (0.07, 0.15), (0.04, 0.10)),
    "dots_48": ChartCase(CHART_PLANS["dots_48"], (0.10, 0.20), (0.04, 0.10)),
    "checkerboard": ChartCase(CHART_PLANS["checkerboard"], (0.10, 0.20), (0.06, 0.12)),
    "line_grid": ChartCase(CHART_PLANS["line_grid"], (0.12, 0.25), (0.06, 0.12)),
    "charuco": ChartCase(CHART_PLANS["charuco"], (0.10, 0.20), (0.06, 0.12)),
    "one_photograph": ChartCase(ONE_PHOTOGRAPH, (0.10, 0.20), (0.06, 0.12)),
}
"""By name; the last is a single photograph of dots of 20 pixels."""


def bench_blur_by_chart(
    judge: Judge,
    out_dir: str | Path | None = None,
    *,
    lenses: Sequence[str] = LENSES[:1],
    charts: Sequence[str] = tuple(CHARTS),
    size_px: tuple[int, int] = (640, 480),
    effort: str = "normal",
    progress: Progress = silent,
) -> dict[str, Any]:
    """Photograph, calibrate and judge every lens with every chart.

    Parameters
    ----------
    judge : As `data_synth.judge` does it.
    out_dir : Folder for bench_blur_by_chart.json; None keeps nothing.
    lenses, charts : Names of bundled prescriptions and of `CHARTS`.
    effort : Of the fit.

    Returns
    -------
    "rows", "seconds" of each calibration, "machine", and "errors", one line for each
    that failed.

    Raises
    ------
    LensfitError : There is no chart of a name, or the results cannot be written.
    """
    for name in charts:
        if name not in CHARTS:
            remedy = f"use one of {', '.join(CHARTS)}"
            raise LensfitError(f'no chart is called "{name}"', remedy=remedy)
    pairs = [(lens, chart) for lens in lenses for chart in charts]
    trials = [_trial(lens, chart, size_px) for lens, chart in pairs]
    found = bench_wavefront(trials, judge, effort=effort, progress=progress)
    rows, seconds = [], []
    for (lens, chart), row in zip(pairs, found["rows"], strict=True):
        rows += _rows(f"{lens}, {chart}", CHARTS[chart], row["figures"])
        took = row["seconds"].get("calibrate")
        seconds.append({"set": f"{lens}, {chart}", "seconds": took})
    return bench_result(
        "blur_by_chart",
        machine(),
        out_dir,
        rows=as_tables(rows),
        sets=seconds,
        errors=found["errors"],
    )


def _trial(lens: str, chart: str, size_px: tuple[int, int]) -> Trial:
    subject = subject_of(load_prescription(lens), size_px, CHARTS[chart].plan)
    write: Callable[[Path], None] = partial(subject.write, seed=0)
    return Trial(f"{lens}_{chart}", subject.about, write)


def _rows(name: str, case: ChartCase, figures: dict[str, Any] | None) -> list[Row]:
    """Of one calibration that was judged; undefined where it failed."""
    if figures is None or not figures["psf"]:
        return [Row(name, "psf", float("nan"), bar=case.bar[0])]
    psf = figures["psf"]
    alone = case.plan is ONE_PHOTOGRAPH
    errors = next(iter(psf["by_setting"].values())) if alone else psf["all"]
    found = [
        Row(name, f"psf, {what}", errors[part], bar=case.bar[k], aim=case.aim[k])
        for k, (part, what) in enumerate(
            (("median", "median"), ("p90", "90th percentile"))
        )
    ]
    if not alone:
        share = figures["covered"].get("psf", float("nan"))
        what = "psf errors within one stated deviation, percent"
        found.append(Row(name, what, share, bar=_SLACK, expected=_HONEST))
    chief = max(figures["chief_ray_px"].values())
    return [*found, Row(name, "chief rays, px rms, worst focus", chief)]
