"""The stages that a plate needs at a tolerance, run or left out, with their cost.

Errors are rms of the picture, display-referred, as measured on a path-traced scene and
on 1/f pictures; seconds are of two cores of a current machine; GiB are the peak of the
process. All are expectations: `lensfit bench render` measures them.
"""

from typing import Any, NamedTuple

import cv2
import numpy as np
from jaxtyping import Float32

from lensfit.coords import Window
from lensfit.cores import available_cores
from lensfit.rendering.defocus_cost import DefocusCost, defocus_cost
from lensfit.rendering.layer_stack import LayerStack
from lensfit.rendering.look.light import least_sigma_px
from lensfit.rendering.look.stack import Look
from lensfit.rendering.outlines import STEP_GROWTH, STEP_PX
from lensfit.rendering.plate_defocus import Defocus
from lensfit.rendering.render_stages import Budget, Stages

_PER_PX = 0.1
"""Rms change of a picture per pixel that it is shifted."""
_WARP_S, _GAIN_S = 6e-8, 4e-9
"""Seconds per pixel: of a channel, warped; of a channel, dimmed."""
_PROGRAM_GIB, _LENS_GIB = 0.35, 0.35
"""Of the process without a picture; of JAX where a lens has maps of its own."""
_PIXEL_BYTES, _MAP_BYTES = 90.0, 60.0
"""Plate, its channels, what has landed and the result, per pixel; maps and gains of a
lens that has some."""
_LENS_S = 1.5
"""For the programs and the rays of a lens that is not ideal, in a new process."""
_LOOK_S = {
    "pro-mist": 2e-8,
    "diffusion": 4e-8,
    "ghosting": 9e-8,
    "glint": 7e-8,
    "bloom": 6e-8,
    "white balance": 3e-9,
}
"""Seconds per pixel, measured on frames of two to eight megapixels; those of glints and
ghosts are of a frame with highlights all over it, which is the most."""
_HALO_ERROR = 4e-4
"""Rms change of a picture per share, at a Gaussian of one pixel that is left."""


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
    tolerance : As requested.
    stages : One for each.
    first_s : What the first frame costs besides: the rays of a lens, kept for the next.
    gib : Of memory that the process takes at most.
    cores : That times and memory are those of.
    """

    tolerance: float
    stages: tuple[StagePlan, ...]
    first_s: float
    gib: float
    cores: int

    @property
    def error(self) -> float:
        """Expected rms error of the picture."""
        return float(np.sqrt(sum(stage.error**2 for stage in self.stages)))

    @property
    def seconds(self) -> float:
        """Expected time of a frame."""
        return sum(stage.seconds for stage in self.stages)

    def facts(self) -> dict[str, Any]:
        """The plan for other programs."""
        return {
            "tolerance": self.tolerance,
            "expected_error": self.error,
            "expected_seconds": self.seconds,
            "first_frame_seconds": self.first_s,
            "expected_gib": round(self.gib, 2),
            "cores": self.cores,
            "stages": [stage._asdict() for stage in self.stages],
        }


def plan_of(
    stages: Stages,
    output_window: Window,
    tolerance: float,
    *,
    depth_mm: Float32[np.ndarray, "height width"] | None = None,
    layers: LayerStack | None = None,
    cores: int | None = None,
) -> Plan:
    """The plan of one plate; looks are listed where they run.

    Parameters
    ----------
    stages : As `prepare_stages` made them.
    output_window : Pixels that are returned.
    tolerance : That `stages` were made for.
    depth_mm : Of a flat plate, from the entrance pupil; None if it has no depth.
    layers : Of a deep plate.
    cores : That render it; those of this process if None.
    """
    cores = cores or available_cores()
    found = [_distortion(stages, tolerance), _lateral_colour(stages, tolerance)]
    cost = None
    if layers is not None:
        depth_mm = layers.depth_mm
    if stages.defocus is None or depth_mm is None:
        why = "not wanted" if stages.defocus is None else "the plate holds no depth"
        found += [StagePlan("outlines", False, why, 0, 0)]
        found += [StagePlan("depth of field", False, why, 0, 0)]
    else:
        radius_px = stages.defocus.circle.radius_px(depth_mm)
        cost = defocus_cost(
            radius_px, stages.window, output_window, stages.defocus, cores
        )
        found.append(_outlines(radius_px, cost, layers is not None))
        found.append(_depth_of_field(radius_px, cost, stages.defocus))
    found.append(_falloff(stages, tolerance))
    if stages.look is not None:
        found += _looks(stages.look, stages.window)
    own = cost is not None and stages.defocus is not None and not stages.defocus.is_disc
    first_s = _LENS_S if own and cost is not None and not cost.is_sharp else 0.0
    pixels = stages.window.width * stages.window.height
    bends = stages.maps[1].displacement_px.any() or stages.gains[1] is not None
    each = _PIXEL_BYTES + bool(bends) * _MAP_BYTES
    gib = _PROGRAM_GIB + own * _LENS_GIB + pixels * each / 2**30
    gib += 0.0 if cost is None else cost.gib
    return Plan(tolerance, tuple(found), first_s, gib, cores)


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


def _outlines(
    radius_px: Float32[np.ndarray, "*layers height width"],
    cost: DefocusCost,
    is_deep: bool,
) -> StagePlan:
    name = "outlines"
    if cost.is_sharp:
        return StagePlan(name, False, "nothing is out of focus", 0, 0)
    if is_deep:
        return StagePlan(name, False, "a deep plate knows what is hidden", 0, 0)
    share = _beside_steps(radius_px)
    if share == 0:
        return StagePlan(name, False, "no step in depth shows", 0, 0)
    why = f"{100 * share:.3g} % of the pixels lie beside a step in depth"
    return StagePlan(name, True, why, 0, cost.surfaces_s)


def _beside_steps(radius_px: Float32[np.ndarray, "height width"]) -> float:
    """Share of the pixels that lie beside a step in depth, on either side."""
    cross = np.ones((3, 3), np.uint8)
    near, far = cv2.dilate(radius_px, cross), cv2.erode(radius_px, cross)
    largest = np.maximum(np.abs(near), np.abs(far))
    return float((near - far > STEP_PX + STEP_GROWTH * largest).mean())


def _depth_of_field(
    radius_px: np.ndarray, cost: DefocusCost, defocus: Defocus
) -> StagePlan:
    low, high = float(radius_px.min()), float(radius_px.max())
    if cost.is_sharp:
        why = f"blur of {max(-low, high):.2g} px at most is not seen"
        unseen = defocus.budget.unseen_px * _PER_PX
        return StagePlan("depth of field", False, why, unseen, 0)
    most_px = defocus.circle.most_px
    limit = f", {most_px:.3g} px at most" if np.isfinite(most_px) else ""
    colour = "for each colour" if cost.channels > 1 else "for all colours"
    why = (
        f"blur from {low:.3g} to {high:.3g} px{limit}: {cost.surfaces} surfaces, "
        f"{defocus.budget.rays} rays {colour}, {cost.tiles} tiles"
    )
    error = defocus.tolerance
    return StagePlan("depth of field", True, why, error, cost.rays_s)


def _falloff(stages: Stages, tolerance: float) -> StagePlan:
    gains = [gain for gain in stages.gains if gain is not None]
    if not gains:
        why = "none, or darkens less than is seen"
        return StagePlan("fall-off", False, why, Budget.of(tolerance).gain_error / 4, 0)
    darkest = min(float(np.nanmin(gain)) for gain in gains)
    why = f"darkens to {darkest:.3g} of the axis"
    error = Budget.of(tolerance).gain_error / 4
    return StagePlan("fall-off", True, why, error, sum(g.size for g in gains) * _GAIN_S)


def _looks(look: Look, window: Window) -> list[StagePlan]:
    """The looks that run over a window, in order."""
    knobs, pixels = look.knobs, window.width * window.height
    shares = {
        "pro-mist": knobs.pro_mist_gain,
        "diffusion": knobs.diffusion_gain,
        "ghosting": knobs.ghost_gain,
        "glint": knobs.glint_gain,
        "bloom": knobs.bloom_gain,
        "white balance": 0.0,
    }
    halo_error = _HALO_ERROR / least_sigma_px(look.tolerance) ** 3
    return [
        StagePlan(
            name,
            True,
            _look_reason(name, look),
            shares[name] * halo_error,
            pixels * _LOOK_S[name],
        )
        for name in look.runs
    ]


def _look_reason(name: str, look: Look) -> str:
    """Its effect in one sentence."""
    knobs = look.knobs
    match name:
        case "pro-mist":
            share, size = knobs.pro_mist_gain, knobs.pro_mist_size_percent
        case "diffusion":
            share, size = knobs.diffusion_gain, knobs.diffusion_size_percent
        case "bloom":
            share, size = knobs.bloom_gain, knobs.bloom_size_percent
        case "ghosting":
            return (
                f"{knobs.ghost_count} of each light above {knobs.ghost_threshold:g}, "
                f"{100 * knobs.ghost_gain:.3g} % of its light together"
            )
        case "glint":
            return (
                f"{100 * knobs.glint_gain:.3g} % of the light above "
                f"{knobs.glint_threshold:g} in {knobs.glint_streaks} streaks of "
                f"{look.px(knobs.glint_length_percent):.3g} px"
            )
        case _:
            kelvin, tint = knobs.white_balance_kelvin, knobs.white_balance_tint
            return f"{kelvin:g} K, tint {tint:g}"
    above = f" above {knobs.bloom_threshold:g}" if name == "bloom" else ""
    half = look.px(size)
    return f"{100 * share:.3g} % of the light{above}, half of it within {half:.3g} px"
