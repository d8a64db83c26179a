"""`lensfit bench detect`, `fit`, `blur`: sets of photographs, against bars and peers.

`detect` compares detected points with those of independent code, `fit` detects and fits
sets of photographs, `blur` measures real and traced lenses from every kind of chart.
"""

import json
from pathlib import Path
from typing import Annotated

import typer

from data_synth.commands.bench.outcome import (
    AsJson,
    JsonFolder,
    OnlySet,
    SetsFolder,
    fail_if_any,
    print_profiles,
    say_machine,
    show,
)
from data_synth.commands.prescriptions import prescription_of
from lensfit.cli._door import one_of
from lensfit.cli._options import EFFORT_HELP, EFFORTS, photograph_size_px
from lensfit.cli._terminal import console, progress_bars


def detect(
    data: SetsFolder,
    out: JsonFolder = None,
    as_json: AsJson = False,
    only: OnlySet = None,
) -> None:
    """Detect and number the points of sets of photographs; counts and times.

    Example: lensfit bench detect --data data --only dot_pattern_05
    """
    from data_synth.bench.detect import bench_detect

    with progress_bars() as progress:
        result = bench_detect(data, out, only=only, progress=progress)
    show(result, as_json)


def fit(
    data: SetsFolder,
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for JSON and overlays")
    ] = None,
    as_json: AsJson = False,
    only: OnlySet = None,
) -> None:
    """Detect and fit sets of photographs; one row per bar, pass or fall short.

    Falling short is no error; a photograph that cannot be used is, and the exit code
    is then 1.

    Example: lensfit bench fit --data data --only dot_pattern_05
    """
    from data_synth.bench.fit.benchmark import bench_fit

    with progress_bars() as progress:
        result = bench_fit(data, out, only=only, progress=progress)
    if as_json:
        typer.echo(json.dumps(result))
    else:
        from data_synth.commands.bench.tables import bars_table, counts_table

        say_machine(result)
        screen = console()
        screen.print(bars_table(result["rows"]))
        screen.print()
        screen.print(counts_table(result["sets"]))
        print_profiles(result)
    fail_if_any(result["errors"])


def blur(
    data: SetsFolder,
    out: JsonFolder = None,
    as_json: AsJson = False,
    only: OnlySet = None,
    effort: Annotated[
        str, typer.Option(help=EFFORT_HELP, callback=one_of(EFFORTS))
    ] = "normal",
    charts: Annotated[
        list[str] | None,
        typer.Option(
            "--charts",
            metavar="NAME",
            help="A chart that traced lenses are photographed with, all, or none; may "
            "be repeated",
        ),
    ] = None,
    lenses: Annotated[
        list[str] | None,
        typer.Option("--lens", metavar="NAME", help="A traced lens; may be repeated"),
    ] = None,
    size: Annotated[
        str, typer.Option(help="WIDTHxHEIGHT of traced photographs, px")
    ] = "640x480",
) -> None:
    """Measure blur with every kind of chart, real photographs first, then traced ones.

    Of real photographs dots that the fit did not see are predicted, beside Gaussians
    that were fitted to other dots, and the noise of the pixels. Traced lenses are
    judged by their truth. Falling short is no error; a set without blur is, and the
    exit code is then 1.

    Example: lensfit bench blur --data data --only dot_pattern_05 --charts none

    Example: lensfit bench blur --data data --charts line_grid --lens petzval_50
    """
    from data_synth.bench.blur import bench_blur
    from data_synth.bench.blur_by_chart import CHARTS, LENSES, bench_blur_by_chart
    from data_synth.commands.bench.wavefront import judged
    from lensfit.fitting.wavefront.effort import Effort

    chosen = charts or ["all"]
    names = list(CHARTS) if "all" in chosen else [c for c in chosen if c != "none"]
    given = Effort.from_name(effort)
    for lens in lenses or ():
        prescription_of("--lens", lens)
    with progress_bars() as progress:
        results = [bench_blur(data, out, only=only, effort=given, progress=progress)]
        if names:
            results.append(
                bench_blur_by_chart(
                    judged,
                    out,
                    lenses=lenses or LENSES[:1],
                    charts=names,
                    size_px=photograph_size_px(size),
                    effort=effort,
                    progress=progress,
                )
            )
    if as_json:
        typer.echo(json.dumps(dict(zip(("real", "traced"), results, strict=False))))
    else:
        from data_synth.commands.bench.tables import bars_table

        say_machine(results[0])
        for one in results:
            console().print(bars_table(one["rows"]))
    fail_if_any([error for one in results for error in one["errors"]])
