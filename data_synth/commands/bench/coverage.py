"""`lensfit bench coverage`: whether stated uncertainties are true.

The command line is the one place that knows both the ray tracer and lensfit, so the
shoot and its truth are handed to the benchmark from here.
"""

import json
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from data_synth.commands.bench.outcome import AsJson, fail_if_any, say_machine
from data_synth.commands.prescriptions import prescription_of
from lensfit.cli._door import one_of
from lensfit.cli._options import EFFORT_HELP, EFFORTS, photograph_size_px
from lensfit.cli._terminal import console, progress_bars

if TYPE_CHECKING:
    from data_synth.bench.coverage.benchmark import Subject
    from data_synth.bench.coverage.predictions import Traced, TracedSpots
    from data_synth.psf_truth import WavefrontTruth
    from data_synth.wavefront_cases import Subject as Photographed

_EVERY = 3
"""Chief rays and light at every so manieth place of the truth's table."""
_SPOTS = 4
_GREEN = 1


def subject_of(lens: str, size: str) -> "Subject":
    """A lens in focus, nearer, farther and tilted, all wide open.

    Raises
    ------
    typer.BadParameter : There is no such lens, or no such size.
    """
    from data_synth.bench.coverage.benchmark import Subject
    from data_synth.wavefront_cases import subject_of as photographed
    from data_synth.wavefront_plan import WavefrontPlan

    prescription = prescription_of("--lens", lens)
    plan = WavefrontPlan(with_stopped_down=False, with_lines=False)
    size_px = photograph_size_px(size)
    made = photographed(prescription, size_px, plan)
    name = "{}_{}x{}".format(made.name, *size_px)
    return Subject(name, partial(_photograph, made), partial(_expose, made))


def _photograph(made: "Photographed", folder: Path) -> "Traced":
    from data_synth.psf_truth import FILE_NAME, read_truth

    if not (folder / FILE_NAME).is_file():
        made.write(folder, keep_light=True)
    return traced_of(read_truth(folder))


def _expose(made: "Photographed", folder: Path, draw: int, into: Path) -> None:
    from data_synth.noise_draws import draw_noise

    draw_noise(folder, made.shots(), made.camera.sensor, draw, into)


def traced_of(truth: "WavefrontTruth") -> "Traced":
    """A truth as lensfit's benchmark reads it: what lies in the frame, thinned out."""
    import numpy as np

    from data_synth.bench.coverage.predictions import (
        Traced,
        TracedChiefs,
        TracedLight,
    )

    half_mm = np.array(truth.frame.size_mm) / 2

    def inside(points_mm: np.ndarray) -> np.ndarray:
        rows = np.flatnonzero((np.abs(points_mm) <= half_mm).all(-1))
        return rows[::_EVERY]

    chiefs = []
    for focus_mm, landed in zip(truth.focus_mm, truth.chief_mm, strict=True):
        rows = inside(landed[:, _GREEN])
        flat = truth.chief_object_mm[rows, :2]
        chiefs.append(TracedChiefs(focus_mm, flat, landed[rows]))
    light = []
    for setting, points, values in zip(
        truth.settings, truth.light_mm, truth.light, strict=True
    ):
        rows = inside(points)
        light.append(TracedLight(*setting, points[rows], values[rows]))
    return Traced(
        focal_length_mm=truth.focal_length_mm,
        pixel_mm=truth.frame.pitch_mm[0],
        chiefs=tuple(chiefs),
        light=tuple(light),
        spots=_spots(truth),
    )


def _spots(truth: "WavefrontTruth") -> "tuple[TracedSpots, ...]":
    """A few of every setting that was photographed."""
    import numpy as np

    from data_synth.bench.coverage.predictions import TracedSpots

    found = []
    for k, group in enumerate(truth.groups):
        if not group.photographed:
            continue
        psf = truth.psf[k][:, _GREEN]
        whole = np.flatnonzero(np.isfinite(psf).all((1, 2)))
        rows = whole[np.linspace(0, len(whole) - 1, _SPOTS).astype(int)]
        pitch_mm = truth.frame.pitch_mm[0] / group.subpixels
        found.append(
            TracedSpots(
                group.f_number,
                group.focus_distance_mm,
                group.object_distance_mm,
                pitch_mm,
                truth.spot_chief_mm[k][rows],
                psf[rows] / psf[rows].sum((1, 2), keepdims=True),
            )
        )
    return tuple(found)


def coverage(
    out: Annotated[
        Path, typer.Option("--out", help="Folder for shoot, draws and JSON")
    ],
    draws: Annotated[
        int, typer.Option("--draws", min=2, help="How many exposures to calibrate")
    ] = 100,
    lens: Annotated[
        str, typer.Option("--lens", help="A bundled lens, or a prescription file")
    ] = "biotar_50",
    size: Annotated[str, typer.Option("--size", help="WIDTHxHEIGHT, px")] = "480x360",
    effort: Annotated[
        str,
        typer.Option(
            help="Of the fit of blur: " + EFFORT_HELP, callback=one_of(EFFORTS)
        ),
    ] = "fastest",
    as_json: AsJson = False,
) -> None:
    """Photograph a traced lens once, expose it often, and compare each calibration's
    stated deviations with its errors.

    A stated deviation should cover 60 to 76 % of the errors against the truth. Draws
    that lie in --out are kept, so that a stopped run goes on.

    Example: lensfit bench coverage --draws 100 --out coverage
    """
    from data_synth.bench.coverage.benchmark import bench_coverage
    from data_synth.commands.bench.tables import bars_table

    subject = subject_of(lens, size)
    with progress_bars() as progress:
        result = bench_coverage(
            subject, out, draws=draws, effort=effort, progress=progress
        )
    if as_json:
        typer.echo(json.dumps(result))
    else:
        say_machine(result)
        console().print(bars_table(result["rows"]))
        typer.echo(f"{result['draws']} draws, {result['processor_s']} processor s each")
    fail_if_any(result["errors"])
