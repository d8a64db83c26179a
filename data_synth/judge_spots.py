"""Spots of a lens against the exact ray trace: their shape, setting by setting.

A lens that draws many at once (`psfs`) is asked for all of a setting together; any
other is asked one by one. Either way every spot lies around its green chief ray, and is
judged by `psf_error`, which leaves out where it lands.

That is the relative error after the best shift, in L2,
|shifted model - truth| / |truth| over whole pixels. The shift is a real one of any
fraction of a pixel: a phase ramp on the finely sampled model, which is then summed to
pixels, found by damped Gauss-Newton from where the centroids meet. Where the light
lands is judged by chief rays and lateral colour; this is the shape alone.
"""

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Protocol, TypeVar, runtime_checkable

import numpy as np
from jaxtyping import ArrayLike, Float

from data_synth.judged_lens import SpotLens
from data_synth.psf_truth import Group, WavefrontTruth, read_truth
from data_synth.sensor import CHANNELS, Channel

STEPS = 12
CLOSE_ENOUGH = 1e-3
"""Samples; a smaller step changes nothing."""


def psf_error(
    truth: Float[np.ndarray, "size size"],
    model: Float[np.ndarray, "size size"],
    subpixels: int = 1,
) -> float:
    """Relative L2 of the model's shape; 1 for a model without light.

    Parameters
    ----------
    truth, model : Samples, `subpixels` of them to a pixel; each is scaled to sum to 1.
    """
    error, _ = best_shift(truth, model, subpixels)
    return error


def best_shift(
    truth: Float[np.ndarray, "size size"],
    model: Float[np.ndarray, "size size"],
    subpixels: int = 1,
) -> tuple[float, Float[np.ndarray, "2"]]:
    """The relative L2 and the shift of the model (rows, columns, in samples) for it."""
    total = float(model.sum())
    if not np.isfinite(model).all() or total <= 0:
        return 1.0, np.zeros(2)
    target = whole_pixels(truth / truth.sum(), subpixels)
    size = len(truth)
    waves = np.fft.rfft2(model / total)
    ramps = (
        -2j * np.pi * np.fft.fftfreq(size)[:, None],
        -2j * np.pi * np.fft.rfftfreq(size)[None, :],
    )

    def residual(shift):
        moved = waves * np.exp(ramps[0] * shift[0] + ramps[1] * shift[1])
        return moved, _back(moved, size, subpixels) - target

    start = centroid(truth) - centroid(model)
    norm, shift = _polished(residual, ramps, start, size, subpixels)
    return norm / float(np.linalg.norm(target)), shift


def _polished(residual, ramps, shift, size: int, subpixels: int):
    """Damped Gauss-Newton: the least norm of the residual, and its shift."""
    moved, gap = residual(shift)
    norm, damping = float(np.linalg.norm(gap)), 1e-3
    for _ in range(STEPS):
        slopes = np.stack(
            [_back(moved * ramp, size, subpixels).ravel() for ramp in ramps], -1
        )
        normal = slopes.T @ slopes
        normal += damping * np.diag(np.diag(normal) + 1e-30)
        step = -np.linalg.solve(normal, slopes.T @ gap.ravel())
        trial, trial_gap = residual(shift + step)
        trial_norm = float(np.linalg.norm(trial_gap))
        if trial_norm < norm:
            shift, moved, gap, norm = shift + step, trial, trial_gap, trial_norm
            damping /= 5
            if np.abs(step).max() < CLOSE_ENOUGH:
                break
        else:
            damping *= 10
    return norm, shift


def _back(waves, size: int, subpixels: int):
    return whole_pixels(np.fft.irfft2(waves, s=(size, size)), subpixels)


def whole_pixels(
    samples: Float[np.ndarray, "size size"], subpixels: int
) -> Float[np.ndarray, "pixels pixels"]:
    """Summed over `subpixels` x `subpixels` samples."""
    count = len(samples) // subpixels
    return samples.reshape(count, subpixels, count, subpixels).sum(axis=(1, 3))


def centroid(samples: Float[np.ndarray, "size size"]) -> Float[np.ndarray, "2"]:
    """Mean row and column of the light."""
    steps = np.arange(len(samples))
    rows, columns = samples.sum(axis=1), samples.sum(axis=0)
    return np.array([rows @ steps, columns @ steps]) / samples.sum()


Made = TypeVar("Made", bound=SpotLens)
Made_co = TypeVar("Made_co", bound=SpotLens, covariant=True)
SpotMaker = Callable[[float, float], SpotLens]
"""Of f-number and focus distance, mm."""


class Preset(Protocol[Made_co]):
    """The lenses of every state, as lensfit keeps them."""

    def at(
        self, *, focal_length_mm: float, f_number: float, focus_distance_mm: float
    ) -> Made_co:
        """The lens of a state."""
        ...


@runtime_checkable
class DrawsMany(Protocol):
    """A lens that draws all spots of a setting together."""

    def psfs(
        self,
        image_points_mm: ArrayLike,
        object_distance_mm: float,
        channels: Sequence[Channel],
        *,
        pixel_pitch_mm: float,
        size_px: int,
    ) -> ArrayLike:
        """As many as points, by channel, (points, channels, rows, columns)."""
        ...


CLEARLY = 0.85
"""One error decides against another when it is below this part of it."""
SIGN_FIELDS = 6
GREEN = 1


def judge_spots(
    lens: Preset[SpotLens] | SpotMaker,
    folder: str | Path,
    *,
    every: int = 1,
    only: tuple[float, float, float] | None = None,
) -> dict[str, Any] | None:
    """The point-spread figures of `judge`, without the rest.

    Parameters
    ----------
    lens : A preset, or a function (f_number, focus_distance_mm) -> lens.
    folder : A shoot with `truth_wavefront.npz`.
    every : Judge spots at every so manieth field point only.
    only : f-number, focus and object distance (mm): "median" and "p90" of that setting
        alone, or None where the truth does not know it.

    Raises
    ------
    OSError : The folder holds no truth.
    LensfitError : The lens knows no point-spread function.
    """
    truth = read_truth(Path(folder))
    make = maker_of(lens, truth)
    if only is None:
        return spot_figures(make, truth, every)
    for k, group in enumerate(truth.groups):
        setting = group.f_number, group.focus_distance_mm, group.object_distance_mm
        if np.allclose(setting, only, rtol=1e-6):
            return _spread([_errors(make, truth, k, every)])
    return None


def maker_of(
    lens: Preset[Made] | Callable[[float, float], Made], truth: WavefrontTruth
) -> Callable[[float, float], Made]:
    """Makes each lens once; a function is used as it is."""
    if callable(lens):
        return lens
    made: dict[tuple[float, float], Made] = {}

    def make(f_number: float, focus_distance_mm: float) -> Made:
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


def spot_figures(
    make: SpotMaker, truth: WavefrontTruth, every: int = 1
) -> dict[str, Any]:
    """Medians and 90th percentiles, pooled and by setting."""
    groups = truth.groups
    errors = [_errors(make, truth, k, every) for k in range(len(groups))]
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


def defocus_sign(make: SpotMaker, truth: WavefrontTruth) -> str:
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
        points = range(0, fields, math.ceil(fields / SIGN_FIELDS))
        seen = [p for p in points if np.isfinite(truth.psf[number][p, GREEN]).all()]
        for distance_mm, found in ((None, own), (mirrored_mm, other)):
            made = _drawn(lens, truth, number, seen, ("g",), distance_mm)
            for point, spots in zip(seen, made, strict=True):
                true = truth.psf[number][point, GREEN]
                found.append(psf_error(true, spots[0], group.subpixels))
    if not own:
        return "undecided"
    mine, theirs = float(np.median(own)), float(np.median(other))
    if mine < CLEARLY * theirs:
        return "right"
    return "wrong" if theirs < CLEARLY * mine else "undecided"


def mirrored_distance_mm(focus_mm: float, object_mm: float) -> float:
    """The distance that is as much out of focus on the other side, in dioptres."""
    dioptres = 2 / focus_mm - 1 / object_mm
    return 1 / max(dioptres, 1e-7)


def _errors(
    make: SpotMaker, truth: WavefrontTruth, number: int, every: int
) -> Float[np.ndarray, "fields 3"]:
    """Per field point and channel; NaN where the truth has no light."""
    group = truth.groups[number]
    lens = make(group.f_number, group.focus_distance_mm)
    fields = range(0, len(truth.spot_chief_mm[number]), every)
    lit = np.all(np.isfinite(truth.psf[number][::every]), axis=(2, 3))
    errors = np.full(lit.shape, np.nan)
    rows = np.flatnonzero(lit.any(axis=1))
    made = _drawn(lens, truth, number, [fields[row] for row in rows], CHANNELS)
    for row, spots in zip(rows, made, strict=True):
        for k in np.flatnonzero(lit[row]):
            true = truth.psf[number][fields[row], k]
            errors[row, k] = psf_error(true, spots[k], group.subpixels)
    return errors


def _drawn(
    lens: SpotLens,
    truth: WavefrontTruth,
    number: int,
    points: Sequence[int],
    channels: Sequence[Channel],
    object_distance_mm: float | None = None,
) -> Float[np.ndarray, "points channels size size"]:
    group = truth.groups[number]
    chiefs_mm = truth.spot_chief_mm[number][list(points)]
    distance_mm = object_distance_mm or group.object_distance_mm
    pitch_mm = truth.frame.pitch_mm[0] / group.subpixels
    if len(chiefs_mm) == 0:
        return np.zeros((0, len(channels), group.size, group.size))
    if isinstance(lens, DrawsMany):
        made = lens.psfs(
            chiefs_mm,
            distance_mm,
            channels,
            pixel_pitch_mm=pitch_mm,
            size_px=group.size,
        )
        return np.asarray(made, float)

    def drawn(at_mm: np.ndarray, channel: Channel) -> np.ndarray:
        one = lens.psf(
            at_mm, distance_mm, channel, pixel_pitch_mm=pitch_mm, size_px=group.size
        )
        return np.asarray(one, float)

    return np.array([[drawn(at, c) for c in channels] for at in chiefs_mm])


def _spread(errors: list[np.ndarray]) -> dict[str, float | None]:
    values = np.concatenate([e.ravel() for e in errors]) if errors else np.zeros(0)
    values = values[np.isfinite(values)]
    if not len(values):
        return {"median": None, "p90": None}
    return {
        "median": float(np.median(values)),
        "p90": float(np.percentile(values, 90)),
    }
