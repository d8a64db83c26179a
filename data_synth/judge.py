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
    flags               what no map or fall-off may do, one sentence each
"""

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from data_synth.bands import CHANNELS
from data_synth.judge_maps import affinely_aligned, flags_of
from data_synth.psf_error import psf_error
from data_synth.psf_truth import Group, WavefrontTruth, read_truth
from data_synth.stand_ins import Lens, ThinLens, mirrored_distance_mm
from lensfit.errors import LensfitError

Maker = Callable[[float, float], Lens]
CLEARLY = 0.85
"""One error decides against another when it is below this part of it."""
SIGN_FIELDS = 6
GREEN = 1


def judge(lens: Any, folder: str | Path, *, every: int = 1) -> dict[str, Any]:
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
    make = _maker(lens, truth)
    geometry = geometry_figures(make, truth)
    flags = geometry.pop("flags")
    figures = geometry | {"psf": None, "defocus_sign": "undecided", "flags": flags}
    try:
        errors = [
            _spot_errors(make, truth, k, range(0, len(truth.spot_chief_mm[k]), every))
            for k in range(len(truth.groups))
        ]
        figures["psf"] = _psf_figures(truth.groups, errors)
        figures["defocus_sign"] = _defocus_sign(make, truth)
    except LensfitError as error:
        flags.append(f"no point-spread function: {error}")
    return figures


def geometry_figures(lens: Any, truth: WavefrontTruth) -> dict[str, Any]:
    """Chief rays, lateral colour, fall-off and flags: what needs no spots.

    Parameters
    ----------
    lens : As for `judge`.
    truth : What the tracer says; groups are not looked at.
    """
    make = _maker(lens, truth)
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


def _maker(lens: Any, truth: WavefrontTruth) -> Maker:
    if not hasattr(lens, "at"):
        return lens
    made: dict[tuple[float, float], Lens] = {}

    def make(f_number: float, focus_distance_mm: float) -> Lens:
        key = f_number, focus_distance_mm
        if key not in made:
            made[key] = lens.at(
                focal_length_mm=truth.focal_length_mm,
                f_number=f_number,
                focus_distance_mm=focus_distance_mm,
            )
        return made[key]

    return make


def named(group: Group) -> str:
    """A setting as a key: f1.4_focus1430_object2000."""
    return (
        f"f{group.f_number:g}_focus{group.focus_distance_mm:g}"
        f"_object{group.object_distance_mm:g}"
    )


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
    """Largest departure in any channel, both 1 at the point nearest the middle."""
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
        worst[f"f{f_number:g}_focus{focus_mm:g}"] = float(np.abs(error).max())
    return worst


def _spot_errors(
    make: Maker, truth: WavefrontTruth, number: int, fields: range
) -> Float[np.ndarray, "fields 3"]:
    """Per field point and channel; NaN where the truth has no light."""
    group = truth.groups[number]
    lens = make(group.f_number, group.focus_distance_mm)
    errors = np.full((len(fields), len(CHANNELS)), np.nan)
    for row, point in enumerate(fields):
        for k, channel in enumerate(CHANNELS):
            true = truth.psf[number][point, k]
            if np.isfinite(true).all():
                made = _drawn(lens, truth, number, point, channel)
                errors[row, k] = psf_error(true, made, group.subpixels)
    return errors


def _drawn(
    lens: Lens,
    truth: WavefrontTruth,
    number: int,
    point: int,
    channel: str,
    object_distance_mm: float | None = None,
) -> np.ndarray:
    group = truth.groups[number]
    made = lens.psf(
        truth.spot_chief_mm[number][point],
        object_distance_mm or group.object_distance_mm,
        channel=channel,
        pixel_pitch_mm=truth.frame.pitch_mm[0] / group.subpixels,
        size_px=group.size,
    )
    return np.asarray(made, float)


def _psf_figures(groups: tuple[Group, ...], errors: list[np.ndarray]) -> dict[str, Any]:
    """Medians and 90th percentiles, pooled and by setting."""
    by_setting = {named(g): _spread([e]) for g, e in zip(groups, errors, strict=True)}
    pools: dict[str, list[np.ndarray]] = {"photographed": [], "stop": [], "depth": []}
    chart_mm = next(g.object_distance_mm for g in groups if g.photographed)
    for group, error in zip(groups, errors, strict=True):
        if group.photographed:
            pools["photographed"].append(error)
        elif group.object_distance_mm == chart_mm:
            pools["stop"].append(error)
        else:
            pools["depth"].append(error)
    channels = np.concatenate(pools["photographed"])
    return {
        "all": _spread(pools["photographed"]),
        "by_channel": {c: _spread([channels[:, k]]) for k, c in enumerate(CHANNELS)},
        "unseen_stop": _spread(pools["stop"]),
        "unseen_depth": _spread(pools["depth"]),
        "by_setting": by_setting,
    }


def _spread(errors: list[np.ndarray]) -> dict[str, float | None]:
    values = np.concatenate([e.ravel() for e in errors]) if errors else np.zeros(0)
    values = values[np.isfinite(values)]
    if not len(values):
        return {"median": None, "p90": None}
    return {
        "median": float(np.median(values)),
        "p90": float(np.percentile(values, 90)),
    }


def _defocus_sign(make: Maker, truth: WavefrontTruth) -> str:
    """Whether spots out of focus look like their own side of focus, or the other's.

    Over photographed settings that are out of focus; the settings are told apart by
    the shape of the light alone.
    """
    own, other = [], []
    for number, group in enumerate(truth.groups):
        away = abs(1 / group.focus_distance_mm - 1 / group.object_distance_mm)
        if not group.photographed or away * group.object_distance_mm < 0.02:
            continue
        lens = make(group.f_number, group.focus_distance_mm)
        mirrored_mm = mirrored_distance_mm(
            group.focus_distance_mm, group.object_distance_mm
        )
        fields = len(truth.spot_chief_mm[number])
        for point in range(0, fields, math.ceil(fields / SIGN_FIELDS)):
            true = truth.psf[number][point, GREEN]
            if not np.isfinite(true).all():
                continue
            made = _drawn(lens, truth, number, point, "g")
            mirrored = _drawn(lens, truth, number, point, "g", mirrored_mm)
            own.append(psf_error(true, made, group.subpixels))
            other.append(psf_error(true, mirrored, group.subpixels))
    if not own:
        return "undecided"
    mine, theirs = float(np.median(own)), float(np.median(other))
    if mine < CLEARLY * theirs:
        return "right"
    return "wrong" if theirs < CLEARLY * mine else "undecided"
