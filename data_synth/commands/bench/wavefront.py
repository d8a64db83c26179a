"""`lensfit bench wavefront`: lenses of an exact ray tracer, judged by their truth.

The command line is the one place that knows both the ray tracer and lensfit, so shoots
and judge are handed to the benchmark from here.
"""

import json
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from data_synth.commands.bench.outcome import AsJson, fail_if_any, say_machine
from data_synth.commands.prescriptions import prescription_of
from lensfit.cli._door import each_of
from lensfit.cli._options import EFFORT_HELP, EFFORTS, photograph_size_px
from lensfit.cli._terminal import console, progress_bars
from lensfit.cli.groups import takes_groups

if TYPE_CHECKING:
    from rich.table import Table

    from data_synth.bench.wavefront.benchmark import Trial
    from data_synth.bench.wavefront.beside import Beside
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


@dataclass(frozen=True)
class BesideGroup:
    """Peers, takes left out, efforts."""

    peers: Annotated[
        bool,
        typer.Option(
            "--peers",
            help="Gaussians, a masked disc and Seidel terms from the same photographs",
        ),
    ] = False
    leave_out: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME|each",
            help="Fit again without a take, judged there; may be repeated",
        ),
    ] = None
    effort: Annotated[
        list[str] | None,
        typer.Option(
            metavar=EFFORT_HELP,
            help="Seconds and error of the fit at an effort; may be repeated",
            callback=each_of(EFFORTS),
        ),
    ] = None

    def wanted(self) -> "Beside":
        """With the judge of the ray tracer."""
        from data_synth.bench.wavefront.beside import Beside
        from data_synth.judge_spots import judge_spots

        leave_out, efforts = tuple(self.leave_out or ()), tuple(self.effort or ())
        return Beside(judge_spots, self.peers, leave_out, efforts)


@takes_groups
def wavefront(
    beside: BesideGroup,
    lenses: Annotated[
        int, typer.Option("--lenses", min=0, help="How many random lenses")
    ] = 3,
    cases: Annotated[
        list[str] | None,
        typer.Option(
            "--cases", help="A hard case or bundled lens, or all; may be repeated"
        ),
    ] = None,
    data: Annotated[
        Path | None, typer.Option("--data", help="Folder with oracle/dg50, tried too")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", help="Folder for shoots, presets, JSON and plots"),
    ] = None,
    size: Annotated[str, typer.Option("--size", help="WIDTHxHEIGHT, px")] = "1024x768",
    seed: Annotated[int, typer.Option("--seed", help="Of lenses and noise")] = 0,
    reuse: Annotated[
        bool, typer.Option("--reuse", help="Keep photographs that lie in --out")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Calibrate lenses that an exact ray tracer photographed; judge each by its truth.

    Random lenses are published designs of 14 to 135 mm and f/1.2 to f/8 with the errors
    of a workshop. One row for each lens; the exit code is 1 when one of them failed.
    Peers, takes left out and efforts are fitted to the same photographs and get rows
    with bars.

    Example: lensfit bench wavefront --lenses 2 --cases fast --cases jpeg --out bench

    Example: lensfit bench wavefront --lenses 0 --cases nikkor_28 --peers --effort fast
    """
    from data_synth.bench.wavefront.benchmark import bench_wavefront
    from data_synth.commands.bench.tables import bars_table

    trials = trials_of(lenses, cases or [], size, seed, data)
    wanted = beside.wanted()
    with progress_bars() as progress:
        result = bench_wavefront(
            trials, judged, out, reuse=reuse, beside=wanted, progress=progress
        )
    if as_json:
        typer.echo(json.dumps(result))
    else:
        say_machine(result)
        console().print(wavefront_table(result["rows"]))
        if wanted.is_wanted:
            console().print(bars_table(result["bars"]))
    fail_if_any(result["errors"])
