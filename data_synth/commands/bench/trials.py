"""What `lensfit bench wavefront` tries and how it shows it.

The command line is the one place that knows both the ray tracer and lensfit, so shoots
and judge are handed to the benchmark from here.
"""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from data_synth.commands.prescriptions import prescription_of
from lensfit.cli._options import photograph_size_px

if TYPE_CHECKING:
    from rich.table import Table

    from data_synth.bench.wavefront.benchmark import Trial
    from lensfit.preset.schema import Preset


ORACLE = "dg50"
"""Traced elsewhere: DIR/oracle/dg50."""


def trials_of(
    lenses: int, cases: list[str], size: str, seed: int, data: Path | None = None
) -> "list[Trial]":
    """Random lenses, then hard cases ("all" for every one) and bundled lenses by name,
    then the lens of the data folder."""
    from data_synth.bench.wavefront.benchmark import Trial
    from data_synth.wavefront_cases import (
        CASES,
        case_subject,
        random_subject,
        subject_of,
    )

    wanted = list(dict.fromkeys([*CASES, *cases])) if "all" in cases else cases
    wanted = [name for name in wanted if name != "all"]
    pixels = photograph_size_px(size)
    option = f"--cases (all, {', '.join(CASES)}, or a lens)"
    subjects = [random_subject(number, seed, pixels) for number in range(lenses)]
    subjects += [
        case_subject(name, pixels)
        if name in CASES
        else subject_of(prescription_of(option, name), pixels)
        for name in wanted
    ]
    trials = [Trial(s.name, s.about, partial(s.write, seed=seed)) for s in subjects]
    return trials if data is None else [*trials, _oracle_trial(data)]


def _oracle_trial(data: Path) -> "Trial":
    from data_synth.bench.wavefront.benchmark import Trial
    from data_synth.oracle import write_oracle_shoot

    folder = data / "oracle" / ORACLE
    if not (folder / "shoot.toml").is_file():
        raise typer.BadParameter(f"--data {data}: holds no oracle/{ORACLE}/shoot.toml")
    about = "50 mm f/1.4, traced by other code"
    return Trial(ORACLE, about, partial(write_oracle_shoot, folder))


def judged(preset: "Preset", folder: Path) -> dict[str, Any]:
    """Figures of a preset, with those of a thin lens beside them."""
    from data_synth.judge import judge, thin_lens_figures

    return judge(preset, folder) | {"thin_lens": thin_lens_figures(folder)}


def wavefront_table(rows: list[dict[str, Any]]) -> "Table":
    """One row for each lens."""
    from rich.table import Table

    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("lens")
    columns = "chief px,colour px,light,psf,p90,disc,stop,depth,sign,flags,fit s"
    for name in columns.split(","):
        table.add_column(name, justify="right")
    table.add_column("converged")
    for row in rows:
        table.add_row(row["lens"], *_cells(row), _outcome(row))
    return table


def _cells(row: dict[str, Any]) -> list[str]:
    figures = row["figures"]
    seconds = _figure(row["seconds"].get("calibrate"))
    if figures is None:
        return ["–"] * 10 + [seconds]
    psf = figures["psf"] or {}
    disc = figures["thin_lens"]["psf"]["all"]["median"]
    values = [
        max(figures["chief_ray_px"].values()),
        max(figures["lateral_colour_px"].values()),
        max(figures["illumination_worst"].values()),
        psf.get("all", {}).get("median"),
        psf.get("all", {}).get("p90"),
        disc,
        psf.get("unseen_stop", {}).get("median"),
        psf.get("unseen_depth", {}).get("median"),
    ]
    said = [figures["defocus_sign"], str(len(figures["flags"])), seconds]
    return [_figure(value) for value in values] + said


def _outcome(row: dict[str, Any]) -> str:
    if row["failed"]:
        return "[bold]failed[/bold]"
    return "yes" if row["converged"] else "said not"


def _figure(value: float | None) -> str:
    return "–" if value is None else f"{value:.3g}"
