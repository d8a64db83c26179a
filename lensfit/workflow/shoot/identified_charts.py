"""Targets that need not be stated: charts that are identified by their printed code.

A take without a target is searched for the code of a lensfit chart. One sharp take is
enough: takes that name no target and show no code, because they are out of focus or
leave the code out of the frame, take the chart of the others, if those show only one.
"""

from collections.abc import Container
from concurrent.futures import ThreadPoolExecutor

from msgspec.structs import replace

from lensfit.chart.layout import described
from lensfit.chart.pattern import Pattern, make_pattern
from lensfit.detect.chart_code import read_chart_code
from lensfit.errors import ChartError, LensfitError
from lensfit.io.image import read_photograph
from lensfit.progress import Progress, silent
from lensfit.workflow.shoot.shoot_records import Shoot, Take, Target

_THREADS = 2


def with_identified_charts(shoot: Shoot, progress: Progress = silent) -> Shoot:
    """A shoot whose takes name their targets, as far as charts say.

    A photograph that cannot be read keeps its take as it is; whoever uses the take says
    why it fails.
    """
    asking = [take for take in shoot.takes if take.target is None]
    if not asking:
        return shoot
    with ThreadPoolExecutor(_THREADS) as pool:
        jobs = [pool.submit(_chart_of, shoot, take) for take in asking]
        patterns = []
        for done, job in enumerate(jobs, 1):
            patterns.append(job.result())
            progress("charts", done, len(jobs))
    seen = list(dict.fromkeys(p for p in patterns if p is not None))
    if not seen:
        return shoot
    targets = dict(shoot.targets)
    names = {pattern: _new_name(pattern, targets) for pattern in seen}
    common = names[seen[0]] if len(seen) == 1 else None
    chosen = {
        take.image: names[pattern] if pattern is not None else common
        for take, pattern in zip(asking, patterns, strict=True)
    }
    takes = tuple(
        replace(take, target=take.target or chosen[take.image]) for take in shoot.takes
    )
    notes = tuple(
        f"the chart was read from its code: {', '.join(described(p))}; its sizes are "
        "as printed at 100 %"
        for p in seen
    )
    return replace(shoot, targets=targets, takes=takes, notes=shoot.notes + notes)


def target_of_pattern(pattern: Pattern, name: str) -> Target:
    """A chart as a shoot file states it."""
    size = (pattern.columns, pattern.rows)
    checker = pattern.kind == "checkerboard"
    return Target(
        name=name,
        kind=pattern.kind,
        pitch_mm=pattern.pitch_mm,
        hole_diameter_mm=pattern.mark_mm if pattern.kind == "dot-grid" else None,
        line_width_mm=pattern.mark_mm if pattern.kind == "line-grid" else None,
        polarity=None if checker else pattern.polarity,
        squares=size if checker else None,
        marks=None if checker else size,
    )


def pattern_of_target(target: Target) -> Pattern | None:
    """The lensfit chart that a target may be; None if it is none."""
    size = target.squares if target.kind == "checkerboard" else target.marks
    if size is None or target.kind in ("circle-grid", "charuco"):
        return None
    across = min(target.pitch_xy_mm)
    mark = target.hole_diameter_mm or target.line_width_mm or across / 10
    try:
        return make_pattern(
            target.kind, target.polarity or "bright", across, mark, *size
        )
    except ChartError:
        return None


def _chart_of(shoot: Shoot, take: Take) -> Pattern | None:
    try:
        return read_chart_code(
            read_photograph(shoot.image_path(take), take.encoding, shoot.camera.mosaic)
        )
    except (LensfitError, ValueError):
        return None


def _new_name(pattern: Pattern, targets: dict[str, Target]) -> str:
    """Add the chart to the targets under a name of its own."""
    name = free_name(pattern.kind, targets)
    targets[name] = target_of_pattern(pattern, name)
    return name


def free_name(wanted: str, taken: Container[str]) -> str:
    """The name itself, or numbered if it is taken."""
    name, k = wanted, 2
    while name in taken:
        name, k = f"{wanted}-{k}", k + 1
    return name
