"""`lensfit bench verdict`: wrong shoots must not end green, right ones may."""

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from data_synth.commands.bench.outcome import AsJson, fail_if_any, say_machine
from data_synth.commands.prescriptions import prescription_of
from lensfit.cli._door import one_of
from lensfit.cli._options import (
    EFFORT_OR_NONE_HELP,
    EFFORTS_OR_NONE,
    photograph_size_px,
)
from lensfit.cli._terminal import console, progress_bars

if TYPE_CHECKING:
    from rich.table import Table

    from data_synth.bench.wavefront.benchmark import Trial
    from data_synth.judge_depths import FrameErrors
    from data_synth.wavefront_cases import Subject
    from lensfit.preset.schema import Preset

SPOILT, RANDOM = "nikkor_28", "random"
SPOILT_SIZE_PX = (640, 480)


def verdict(
    shoots: Annotated[
        int, typer.Option("--shoots", min=0, help="How many right shoots")
    ] = 13,
    wrong: Annotated[
        bool, typer.Option("--wrong/--no-wrong", help="Try wrong shoots too")
    ] = True,
    lens: Annotated[
        str,
        typer.Option("--lens", help="Whose shoot is spoilt; random draws one by seed"),
    ] = SPOILT,
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for shoots and JSON")
    ] = None,
    size: Annotated[
        str, typer.Option("--size", help="Of right shoots, WIDTHxHEIGHT px")
    ] = "480x360",
    seed: Annotated[int, typer.Option("--seed", help="Of lenses and noise")] = 0,
    effort: Annotated[
        str,
        typer.Option(
            help=EFFORT_OR_NONE_HELP,
            callback=one_of(EFFORTS_OR_NONE),
        ),
    ] = "fastest",
    reuse: Annotated[
        bool, typer.Option("--reuse", help="Keep photographs that lie in --out")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Calibrate wrong and right shoots of traced lenses, and judge their verdicts.

    Wrong shoots are one shoot, spoilt in every way that is known; the table has the
    first line that a reader sees. Right shoots are of published designs with
    manufacturing errors, every design once in a row; the trace says what each is good
    for. One is in focus alone, the next through focus with a chart drawn by chance, its
    blur measured.

    Example: lensfit bench verdict --shoots 26 --out bench

    Example: lensfit bench verdict --shoots 0 --lens random --seed 3
    """
    from data_synth.bench.verdict.benchmark import bench_verdict
    from data_synth.commands.bench.tables import bars_table

    right = [_right_trial(k, seed, photograph_size_px(size)) for k in range(shoots)]
    spoilt = _spoilt_trial(lens, seed) if wrong else None
    with progress_bars() as progress:
        result = bench_verdict(
            right,
            spoilt,
            chief_ray_errors,
            out,
            reuse=reuse,
            effort=effort,
            progress=progress,
        )
    if as_json:
        typer.echo(json.dumps(result))
    else:
        say_machine(result)
        for table in (_wrong_table(result["wrong"]), _right_table(result["right"])):
            if table.row_count:
                console().print(table)
        console().print(bars_table(result["rows"]))
    fail_if_any(result["errors"])


def _right_trial(number: int, seed: int, size_px: tuple[int, int]) -> "Trial":
    from data_synth.bench.wavefront.benchmark import Trial
    from data_synth.wavefront_cases import random_subject

    subject = random_subject(number, seed, size_px)
    if number % 2:
        return _through_focus_trial(subject, number, seed)

    def write(folder: Path) -> None:
        import numpy as np

        from data_synth.right_shoot import right_shots
        from data_synth.shoot import write_shoot

        prescription, camera = subject.prescription, subject.camera
        away = float(np.random.default_rng([seed, number]).uniform(30, 60))
        shots = right_shots(
            prescription, camera.frame, seed + number, distances=(away,)
        )
        write_shoot(folder, prescription, camera, shots, seed=seed + number)
        _without_holes(folder / "shoot.toml")

    return Trial(subject.name, subject.about, write)


def _through_focus_trial(subject: "Subject", number: int, seed: int) -> "Trial":
    """In focus, nearer and farther at two stops, with a chart drawn by chance."""
    from data_synth.bench.wavefront.benchmark import Trial
    from data_synth.wavefront_cases import random_plan

    about, plan = random_plan(number, seed, subject.camera.frame.size_px)
    subject = replace(subject, plan=plan)

    def write(folder: Path) -> None:
        from data_synth.shoot import write_shoot

        prescription, camera = subject.prescription, subject.camera
        write_shoot(folder, prescription, camera, subject.shots(), seed=seed + number)

    return Trial(subject.name, f"{subject.about}, through focus, {about}", write)


def _spoilt_trial(lens: str, seed: int) -> "Trial":
    from data_synth.bench.wavefront.benchmark import Trial
    from data_synth.wavefront_cases import random_subject, subject_of
    from data_synth.wavefront_plan import WavefrontPlan

    plan = WavefrontPlan(form="png16")
    if lens == RANDOM:
        subject = replace(random_subject(0, seed, SPOILT_SIZE_PX), plan=plan)
    else:
        prescription = prescription_of("--lens", lens)
        subject = subject_of(prescription, SPOILT_SIZE_PX, plan)

    def write(folder: Path) -> None:
        from data_synth.shoot import write_shoot

        prescription, camera = subject.prescription, subject.camera
        write_shoot(folder, prescription, camera, subject.shots(), seed=seed)

    return Trial(f"spoilt_{subject.name}", subject.about, write)


def _without_holes(shoot_file: Path) -> None:
    """Geometry alone: without the holes' diameter no blur is fitted."""
    lines = shoot_file.read_text(encoding="utf-8").splitlines(keepends=True)
    kept = [line for line in lines if not line.startswith("hole_diameter_mm")]
    shoot_file.write_text("".join(kept), encoding="utf-8")


def chief_ray_errors(preset: "Preset", folder: Path) -> "FrameErrors":
    """Of chief rays in the corners and of the image scale, by the trace."""
    from data_synth.judge_depths import frame_errors
    from data_synth.sensor import Frame

    camera = preset.camera
    frame = Frame(
        (camera.image_width_px, camera.image_height_px),
        (camera.sensor_width_mm, camera.sensor_height_mm),
    )

    def lens_at(f_number: float, focus_mm: float):
        focal_mm = preset.entries[0].focal_length_mm
        return preset.at(
            focal_length_mm=focal_mm, f_number=f_number, focus_distance_mm=focus_mm
        )

    return frame_errors(lens_at, folder, frame)


def _wrong_table(rows: list[dict[str, Any]]) -> "Table":
    from rich.markup import escape
    from rich.table import Table

    table = Table(box=None, pad_edge=False, header_style="bold")
    for name in ("wrong shoot", "level", "named", "first line"):
        table.add_column(name)
    for row in rows:
        level = f"{row['level']}, green" if row["green"] else row["level"]
        named = "yes" if row["named"] else "[bold]no[/bold]"
        table.add_row(row["kind"], level, named, escape(row["first_line"]))
    return table


def _right_table(rows: list[dict[str, Any]]) -> "Table":
    from rich.markup import escape
    from rich.table import Table

    table = Table(box=None, pad_edge=False, header_style="bold")
    for name in (
        "right shoot",
        "about",
        "level",
        "trace says",
        "corner px",
        "scale px",
    ):
        table.add_column(name)
    table.add_column("first line")
    for row in rows:
        level = f"[bold]{row['level']}[/bold]" if row["worse"] else row["level"]
        errors = (row["corner_px"], row["scale_px"])
        errors = ["–" if one is None else f"{one:.3f}" for one in errors]
        true = row["true_level"] or "–"
        first = row["first_line"] if row["worse"] or not row["true_level"] else ""
        table.add_row(row["lens"], row["about"], level, true, *errors, escape(first))
    return table
