"""The judge: a lens against the exact ray trace that photographed it.

`judge(lens, folder)` takes a preset, or any function that makes a lens at an f-number
and a focus distance, and a folder that `write_shoot` filled with its truth. Every
figure is a plain number, ready for JSON:

    chief_ray_px        per focus state, rms inside the frame after one affine map
    lateral_colour_px   r-g and b-g, rms over all focus states
    illumination_worst  per f-number and focus, over the frame
    psf                 relative L2 after the best shift: median and 90th percentile
                        over field points and channels, for all photographed settings,
                        for each of them, and for those that were never photographed
    defocus_sign        "right", "wrong", or "undecided" for a lens that cannot tell
    covered             percent of errors within one stated deviation (68 if they are
                        true), of what the lens says (`judge_deviations`)
    chief_ray_at_focus_px, lateral_colour_at_focus_px, covered_at_focus
                        of objects as far away as the lens is focused (`judge_depths`)
    flags               what no map or fall-off may do, one sentence each
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from data_synth.judge_depths import depth_figures
from data_synth.judge_deviations import covered_figures
from data_synth.judge_spots import (
    GREEN,
    Preset,
    defocus_sign,
    maker_of,
    spot_figures,
)
from data_synth.judged_lens import Lens, affinely_aligned, flags_of
from data_synth.psf_truth import WavefrontTruth, read_truth
from data_synth.sensor import CHANNELS
from data_synth.thin_lens import ThinLens
from lensfit.errors import LensfitError

Maker = Callable[[float, float], Lens]
"""Of f-number and focus distance, mm."""


def judge(
    lens: Preset[Lens] | Maker, folder: str | Path, *, every: int = 1
) -> dict[str, Any]:
    """All figures of a lens.

    Parameters
    ----------
    lens : A preset with `at(focal_length_mm=, f_number=, focus_distance_mm=)`, or a
        function (f_number, focus_distance_mm) -> lens.
    folder : A shoot with `truth_wavefront.npz`.
    every : Judge spots at every so manieth field point only.

    Raises
    ------
    OSError : The folder holds no truth.

    A lens that says (by a `LensfitError`) that it knows no point-spread function gets
    None for it, and a flag.
    """
    truth = read_truth(Path(folder))
    make = maker_of(lens, truth)
    geometry = geometry_figures(make, truth)
    flags = geometry.pop("flags")
    figures = geometry | {"psf": None, "defocus_sign": "undecided", "flags": flags}
    try:
        figures["psf"] = spot_figures(make, truth, every)
        figures["defocus_sign"] = defocus_sign(make, truth)
    except LensfitError as error:
        flags.append(f"no point-spread function: {error}")
    figures |= depth_figures(make, Path(folder), truth.frame)
    return figures | {"covered": covered_figures(make, truth)}


def geometry_figures(
    lens: Preset[Lens] | Maker, truth: WavefrontTruth
) -> dict[str, Any]:
    """Chief rays, lateral colour, fall-off and flags: what needs no spots.

    Parameters
    ----------
    lens : As for `judge`.
    truth : What the tracer says; groups are not looked at.
    """
    make = maker_of(lens, truth)
    chief, colour, flags = _chief_figures(make, truth)
    return {
        "chief_ray_px": chief,
        "lateral_colour_px": colour,
        "illumination_worst": _illumination_worst(make, truth),
        "flags": flags,
    }


def thin_lens_figures(folder: str | Path) -> dict[str, Any]:
    """The same figures of a perfect thin lens with a disc for blur: the control.

    Raises
    ------
    OSError : The folder holds no truth.
    """
    focal_mm = read_truth(Path(folder)).focal_length_mm
    return judge(partial(ThinLens, focal_mm), folder, every=2)


def _chief_figures(make: Maker, truth: WavefrontTruth):
    """rms per focus state, lateral colour over all states, and flags."""
    half_mm = np.array(truth.frame.size_mm) / 2
    pitch_mm = np.array(truth.frame.pitch_mm)
    widest = min(f_number for f_number, _ in truth.settings)
    chief: dict[str, float] = {}
    away: dict[str, list[np.ndarray]] = {"r-g": [], "b-g": []}
    flags: list[str] = []
    for focus_mm, landed in zip(truth.focus_mm, truth.chief_mm, strict=True):
        lens = make(widest, focus_mm)
        inside = (np.abs(landed[:, GREEN]) <= half_mm).all(axis=1)
        inside &= np.isfinite(landed).all(axis=(1, 2))
        points = truth.chief_object_mm[inside]
        made = np.stack([np.asarray(lens.project(points, channel=c)) for c in CHANNELS])
        true = np.moveaxis(landed[inside], 1, 0)
        aligned = affinely_aligned(made[GREEN], true[GREEN])
        chief[f"{focus_mm:g}"] = _rms((aligned - true[GREEN]) / pitch_mm)
        for key, k in (("r-g", 0), ("b-g", 2)):
            made_shift, true_shift = made[k] - made[GREEN], true[k] - true[GREEN]
            away[key].append((made_shift - true_shift) / pitch_mm)
        flags += flags_of(lens, truth, landed, f"focused at {focus_mm:g} mm")
    colour = {key: _rms(np.concatenate(rows)) for key, rows in away.items()}
    return chief, colour, flags


def _rms(vectors: Float[np.ndarray, "points 2"]) -> float:
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=-1))))


def _illumination_worst(make: Maker, truth: WavefrontTruth) -> dict[str, float]:
    """Largest departure in any channel that is known, both 1 at the point nearest the
    middle."""
    half_mm = np.array(truth.frame.size_mm) / 2 * (1 + 1e-6)
    worst = {}
    for (f_number, focus_mm), points, light in zip(
        truth.settings, truth.light_mm, truth.light, strict=True
    ):
        inside = np.isfinite(points).all(axis=1)
        inside &= (np.abs(np.nan_to_num(points, nan=np.inf)) <= half_mm).all(axis=1)
        places, true = points[inside], light[inside]
        middle = int(np.argmin(np.hypot(*places.T)))
        lens = make(f_number, focus_mm)
        rows = [lens.relative_illumination(places, channel=c) for c in CHANNELS]
        made = np.stack([np.asarray(row) for row in rows], axis=-1)
        error = made / made[middle] - true / true[middle]
        known = np.isfinite(true)
        worst[f"f{f_number:g}_focus{focus_mm:g}"] = float(np.abs(error[known]).max())
    return worst
