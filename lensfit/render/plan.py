"""What a plate needs at a tolerance: every stage, run or left out, and its price.

Errors are rms of the picture, display-referred, as measured on a path-traced scene and
on 1/f pictures; seconds are of two cores of a current machine, once kernels are made.
Both are expectations: `lensfit bench render` measures them. Kernels are looked at in
a few places only, since all of them take as long as the first frame does.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float32

from lensfit.coords import Window
from lensfit.render.blur_setup import BlurSetup
from lensfit.render.defocus import levels_in
from lensfit.render.edges import outline
from lensfit.render.layer_stack import LayerStack
from lensfit.render.look.price import prices
from lensfit.render.plate_defocus import Defocus
from lensfit.render.stages import Budget, Stages

_PER_PX = 0.1
"""Rms change of a picture per pixel that it is shifted."""
_LEVEL_ERROR = 5.6e-3
"""Rms change per pixel of radius between levels."""
_KERNEL_ERROR = 0.02
"""Rms change per relative error of a kernel."""
_WARP_S, _GAIN_S = 6e-8, 4e-9
_OUTLINE_S, _TAKE_APART_S = 2e-8, 4e-7
_TRANSFORM_S = 2.2e-8
"""Seconds per pixel: of a channel, warped; of a channel, dimmed; of the plate, looked
through and taken apart; of a plane, transformed forth and back."""
_KERNEL_S = 6e-3
"""Seconds for one kernel that is not a disc, on one core."""


class StagePlan(NamedTuple):
    """One stage.

    Attributes
    ----------
    stage : Its name.
    runs : Whether it is run.
    reason : Why, one sentence.
    error : Expected rms error of the picture that running or leaving it costs.
    seconds : Expected time.
    """

    stage: str
    runs: bool
    reason: str
    error: float
    seconds: float


class Plan(NamedTuple):
    """All stages of a plate, in order.

    Attributes
    ----------
    tolerance : That was asked for.
    stages : One for each.
    first_s : What the first frame costs besides: kernels, kept for the next.
    """

    tolerance: float
    stages: tuple[StagePlan, ...]
    first_s: float

    @property
    def error(self) -> float:
        """Expected rms error of the picture."""
        return float(np.sqrt(sum(stage.error**2 for stage in self.stages)))

    @property
    def seconds(self) -> float:
        """Expected time of a frame."""
        return sum(stage.seconds for stage in self.stages)


def plan_of(
    stages: Stages,
    output_window: Window,
    tolerance: float,
    *,
    depth_mm: Float32[np.ndarray, "height width"] | None = None,
    layers: LayerStack | None = None,
) -> Plan:
    """The plan of one plate; looks are listed where they run.

    Parameters
    ----------
    stages : As `prepare_stages` made them.
    output_window : Pixels that are returned.
    tolerance : That `stages` were made for.
    depth_mm : Of a flat plate, from the entrance pupil; None if it has no depth.
    layers : Of a deep plate.
    """
    found = [_distortion(stages, tolerance), _lateral_colour(stages, tolerance)]
    first_s = 0.0
    if layers is not None:
        depth_mm = layers.depth_mm
    if stages.defocus is None or depth_mm is None:
        why = "not wanted" if stages.defocus is None else "the plate holds no depth"
        found += [StagePlan("outlines", False, why, 0, 0)]
        found += [StagePlan("depth of field", False, why, 0, 0)]
    else:
        radius_px = stages.defocus.circle.radius_px(depth_mm)
        defocus = stages.defocus.over(radius_px)
        setup = _setup(radius_px, stages.window, defocus)
        found.append(_outlines(radius_px, setup, layers is not None))
        found.append(_depth_of_field(radius_px, output_window, setup, defocus))
        first_s = _kernels_s(setup, defocus)
    found.append(_falloff(stages, tolerance))
    if stages.look is not None:
        on = prices(stages.look, stages.window)
        found += [StagePlan(p.name, True, p.reason, p.error, p.seconds) for p in on]
    return Plan(tolerance, tuple(found), first_s)


def _distortion(stages: Stages, tolerance: float) -> StagePlan:
    moved = stages.maps[1].displacement_px
    largest = float(np.nanmax(np.abs(moved), initial=0.0))
    pixels = moved[0].size
    if largest == 0:
        return StagePlan("distortion", False, "nothing moves", 0, 0)
    error = Budget.of(tolerance).map_error_px * _PER_PX
    why = f"moves pixels by up to {largest:.3g} px"
    return StagePlan("distortion", True, why, error, 4 * pixels * _WARP_S)


def _lateral_colour(stages: Stages, tolerance: float) -> StagePlan:
    shift = stages.lateral_colour_px
    if stages.maps[0] is not stages.maps[1]:
        error = Budget.of(tolerance).map_error_px * _PER_PX
        why = f"red and blue lie up to {shift:.3g} px from green: a map for each"
        pixels = stages.maps[0].displacement_px[0].size
        return StagePlan("lateral colour", True, why, error, 2 * pixels * _WARP_S)
    if shift == 0:
        return StagePlan("lateral colour", False, "none, or not wanted", 0, 0)
    why = f"at most {shift:.2g} px, which is not seen: one map for all"
    # A sixth: rms over the frame and over two channels of a shift largest in a corner.
    return StagePlan("lateral colour", False, why, shift * _PER_PX / 6, 0)


def _setup(radius_px: np.ndarray, window: Window, defocus: Defocus) -> BlurSetup:
    index = defocus.levels.index(radius_px)
    return defocus.probe(window, levels_in(index, radius_px, defocus))


def _outlines(radius_px: np.ndarray, setup: BlurSetup, is_deep: bool) -> StagePlan:
    name, pixels = "outlines", radius_px.size
    if setup.is_sharp:
        return StagePlan(name, False, "nothing is out of focus", 0, 0)
    if is_deep:
        return StagePlan(name, False, "a deep plate knows what is hidden", 0, 0)
    share = float(outline(radius_px).mean())
    if share == 0:
        why = "no step in depth shows"
        return StagePlan(name, False, why, 0, pixels * _OUTLINE_S)
    why = f"{100 * share:.3g} % of the pixels lie beside a step in depth"
    return StagePlan(name, True, why, 0, pixels * (_OUTLINE_S + _TAKE_APART_S))


def _depth_of_field(
    radius_px: np.ndarray, output: Window, setup: BlurSetup, defocus: Defocus
) -> StagePlan:
    low, high = float(radius_px.min()), float(radius_px.max())
    budget = defocus.budget
    if setup.is_sharp:
        why = f"blur of {max(-low, high):.2g} px at most is not seen"
        return StagePlan("depth of field", False, why, budget.unseen * _PER_PX, 0)
    grid = setup.grid
    place = f"{grid.columns + 1} x {grid.rows + 1}" if grid.varies else "one"
    colour = "for each colour" if setup.chromatic else "for all colours"
    most_px = defocus.circle.most_px
    limit = f", {most_px:.3g} px at most" if np.isfinite(most_px) else ""
    why = (
        f"blur from {low:.3g} to {high:.3g} px{limit}: {len(setup.rooms)} of "
        f"{len(setup.levels)} levels blurred, kernels {place} over the frame "
        f"and {colour}, tiles of {setup.tile} px"
    )
    is_flat = len(setup.levels) == 1
    error = 0.0 if is_flat else _LEVEL_ERROR * defocus.levels.step_px
    if not defocus.bank.is_scaled:
        error = float(np.hypot(error, _KERNEL_ERROR * budget.kernel_error))
    planes = transformed_planes(radius_px, output, setup, defocus)
    seconds = _TRANSFORM_S * sum(n * side**2 for side, n in planes.items())
    return StagePlan("depth of field", True, why, error, seconds)


def transformed_planes(
    radius_px: Float32[np.ndarray, "*layers height width"],
    output: Window,
    setup: BlurSetup,
    defocus: Defocus,
) -> dict[int, float]:
    """Planes of tiles that are transformed forth and back, by the side of the tile, of
    all levels that hold something; surroundings are in the side."""
    index = defocus.levels.index(radius_px)
    index = index.reshape(-1, *index.shape[-2:])
    height, width = index.shape[1:]
    size = setup.tile
    tiles: dict[int, float] = {side: 0.0 for side in setup.rooms.values()}
    for top in range(0, height, size):
        for left in range(0, width, size):
            reach = max(setup.reaches.values())
            rows = slice(max(top - reach, 0), top + size + reach)
            columns = slice(max(left - reach, 0), left + size + reach)
            held = np.unique(index[:, rows, columns])
            for n in held.tolist():
                if n in setup.rooms:
                    tiles[setup.rooms[n]] += 1
    planes = (9 if setup.chromatic else 5) + (15 if setup.grid.varies else 0)
    share = planes * output.width * output.height / (height * width)
    return {side: share * count for side, count in tiles.items()}


def _kernels_s(setup: BlurSetup, defocus: Defocus) -> float:
    if defocus.bank.is_scaled:
        return 0.0
    anchors = len(setup.levels)
    if setup.is_mixed:
        ends = [
            defocus.levels.radius_px(n) for n in (setup.levels[0], setup.levels[-1])
        ]
        first, last = (defocus.bank.anchors.between(r) for r in ends)
        anchors = min(anchors, int(last - first) + 2)
    nodes = (setup.grid.columns + 1) * (setup.grid.rows + 1)
    channels = 3 if setup.chromatic else 1
    return anchors * nodes * channels * _KERNEL_S / 2


def _falloff(stages: Stages, tolerance: float) -> StagePlan:
    gains = [gain for gain in stages.gains if gain is not None]
    if not gains:
        why = "none, or darkens less than is seen"
        return StagePlan("fall-off", False, why, Budget.of(tolerance).gain_error / 4, 0)
    darkest = min(float(np.nanmin(gain)) for gain in gains)
    why = f"darkens to {darkest:.3g} of the axis"
    error = Budget.of(tolerance).gain_error / 4
    return StagePlan("fall-off", True, why, error, sum(g.size for g in gains) * _GAIN_S)
