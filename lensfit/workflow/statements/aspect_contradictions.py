"""Photographs whose shape contradicts the chart's: stretched, turned, or of other size.

A square cell of a chart that stands square to the axis is imaged square, however it is
rolled: with J the cell's two sides on the sensor, ``J J^T`` is a multiple of the unit
matrix, or ``diag(1, s^2)`` through an anamorphic lens of squeeze s. A tilt of the chart
changes that by its cosine, which stays below a tenth up to 25 degrees, and differently
in each view.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from lensfit.detect.lattice_map import lattice_map
from lensfit.fitting.chart_view import View
from lensfit.report.evidence import sentence_list
from lensfit.workflow.statements.contradiction import Contradiction

_LEAST_LOG = 0.12
_ALIKE_LOG = 0.04
_TILTED_LOG = 0.4
"""Of a chart at 48 degrees."""
_MOST_NAMES = 3


def aspect_contradictions(takes: Sequence[View]) -> Iterator[Contradiction]:
    """Of all views of a shoot, the sizes first, then the stretch of each target."""
    of_size = size_contradiction({t.name: t.observations.image_size_px for t in takes})
    if of_size is not None:
        yield of_size
        return
    for target in dict.fromkeys(take.target for take in takes):
        mine = [take for take in takes if take.target == target]
        found = [one for one in map(log_stretch, mine) if one is not None]
        if not found:
            continue
        middle = float(np.median(found))
        # One view may be tilted, though not by so much.
        if len(found) < 2 and abs(middle) < _TILTED_LOG:
            continue
        alike = np.mean(np.abs(np.array(found) - middle) < _ALIKE_LOG)
        if abs(middle) > _LEAST_LOG and alike > 0.5:
            yield _aspect_contradiction(mine, float(np.exp(middle)))
            return


def log_stretch(take: View) -> float | None:
    """Logarithm of how much wider than high a square of the target is imaged, besides
    the squeeze that is stated; None where the middle of the frame is empty."""
    mapped = lattice_map(take.observations)
    if mapped is None:
        return None
    middle = np.asarray(take.observations.image_size_px, float) / 2
    cell = mapped.jacobians_px(mapped.lattice_at(middle)[None])[0]
    cell = cell * np.asarray(take.pixel_mm)[:, None] / np.asarray(take.pitch_mm)
    across, down = np.linalg.norm(cell, axis=1)
    return float(np.log(across / down * take.squeeze))


def size_contradiction(
    sizes_px: Mapping[str, tuple[int, int]],
) -> Contradiction | None:
    """Photographs whose size is not that of most; of as many, not that of the first.

    Parameters
    ----------
    sizes_px : Width and height by the photograph's name.
    """
    (usual, _), *unusual = Counter(sizes_px.values()).most_common()
    if not unusual:
        return None
    others = [size for size, _ in unusual]
    each = [_size_text(sizes_px, size, usual) for size in others]
    text = f"photographs differ in size: {sentence_list(each)}, "
    text += f"the others {usual[0]} x {usual[1]} px"
    return Contradiction(
        kind="photograph_size",
        limit="look" if usual[::-1] in others else "undistortion",
        text=text,
        remedy="give all photographs as the camera wrote them, in one mode and the "
        "same way up",
        statement="sensor_width_mm",
        images=tuple(name for name, size in sizes_px.items() if size != usual),
    )


def _size_text(
    sizes_px: Mapping[str, tuple[int, int]],
    size: tuple[int, int],
    usual: tuple[int, int],
) -> str:
    """Which photographs have this size, and what that may come from."""
    names = [name for name, one in sizes_px.items() if one == size]
    named = sentence_list(names[:_MOST_NAMES])
    more = len(names) - _MOST_NAMES
    named += f" and {more} more" * (more > 0)
    verb = "is" if len(names) == 1 else "are"
    if size == usual[::-1]:
        cause = "probably turned by a quarter"
    else:
        cause = "scaled, or of another sensor mode"
    return f"{named} {verb} {size[0]} x {size[1]} px ({cause})"


def _aspect_contradiction(takes: Sequence[View], stretch: float) -> Contradiction:
    first = takes[0]
    width_mm, height_mm = first.sensor_size_mm
    columns, rows = first.observations.image_size_px
    pixels = (width_mm / columns) / (height_mm / rows)
    pitch = first.pitch_mm[0] / first.pitch_mm[1]
    text = f'squares of target "{first.target}" are imaged {stretch:.2f} times as wide '
    text += "as high: "
    if abs(np.log(pixels)) > _LEAST_LOG:
        statement = "sensor_width_mm"
        text += f"sensor_width_mm = {width_mm:g} and sensor_height_mm = {height_mm:g} "
        text += f"do not go with photographs of {columns} x {rows} px"
        if abs(np.log(width_mm / height_mm * columns / rows)) < _ALIKE_LOG:
            text += ", and look swapped"
        remedy = "check sensor_width_mm and sensor_height_mm"
    elif abs(np.log(pitch)) > _LEAST_LOG:
        statement = "pitch_mm"
        text += f"pitch_mm = [{first.pitch_mm[0]:g}, {first.pitch_mm[1]:g}] is wrong "
        text += "along one side"
        remedy = "check pitch_mm, which is [across, down]"
    else:
        statement = "anamorphic_squeeze"
        squeeze = first.squeeze / stretch
        text += "the photographs are stretched, or were taken through "
        text += f"anamorphic_squeeze = {squeeze:.2f}"
        remedy = "give photographs as the camera wrote them, and state "
        remedy += "anamorphic_squeeze of an anamorphic lens"
    return Contradiction(
        kind="aspect",
        limit="look",
        text=text,
        remedy=remedy,
        statement=statement,
        images=tuple(take.name for take in takes),
    )
