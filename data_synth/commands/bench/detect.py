"""`lensfit bench detect`: marks found in photographs, against independent code."""

from data_synth.commands.bench.options import AsJson, JsonFolder, OnlySet, SetsFolder
from data_synth.commands.bench.outcome import show
from lensfit.cli._terminal import progress_bars


def detect(
    data: SetsFolder,
    out: JsonFolder = None,
    as_json: AsJson = False,
    only: OnlySet = None,
) -> None:
    """Find and number the marks of sets of photographs; counts and times.

    Example: lensfit bench detect --data data --only dot_pattern_05
    """
    from data_synth.bench.detect import bench_detect

    with progress_bars() as progress:
        result = bench_detect(data, out, only=only, progress=progress)
    show(result, as_json)
