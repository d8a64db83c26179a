"""`lensfit bench blur`: blur of real and of traced lenses, from every kind of chart."""

import json
from typing import Annotated

import typer

from data_synth.commands.bench.options import AsJson, JsonFolder, OnlySet, SetsFolder
from data_synth.commands.bench.outcome import fail_if_any, say_machine
from data_synth.commands.prescriptions import prescription_of
from lensfit.cli._door import one_of
from lensfit.cli._options import EFFORT_HELP, EFFORTS, photograph_size_px
from lensfit.cli._terminal import console, progress_bars


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

    Of real photographs marks that the fit did not see are predicted, beside Gaussians
    that were fitted to other marks, and the noise of the pixels. Traced lenses are
    judged by their truth. Falling short is no error; a set without blur is, and the
    exit code is then 1.

    Example: lensfit bench blur --data data --only dot_pattern_05 --charts none

    Example: lensfit bench blur --data data --charts line_grid --lens petzval_50
    """
    from data_synth.bench.blur import bench_blur
    from data_synth.bench.blur_by_chart import CHARTS, LENSES, bench_blur_by_chart
    from data_synth.commands.bench.trials import judged
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
