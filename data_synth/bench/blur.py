"""Blur of real photographs: pixels of dots that the fit did not see, predicted.

There is no truth of a real lens. But its blur, convolved with a dot's disc and put
where the dot's centroid says, must be the photograph of that dot. Brightness and
background are found for each; nothing else is. Beside it stand what a user would do
without lensfit, fitted to other dots of the same photographs: one Gaussian for the
whole field, Gaussians that vary smoothly over it, and no blur at all; and the grain of
the pixels. All have the same discs, of the diameter that the fit found.

Errors are relative (L2), in green, over the cells that are a dot's own.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy.interpolate import RBFInterpolator

from data_synth.bench.result import Row, as_tables, bench_result, machine
from data_synth.bench.sets import chosen_sets, shoot_of
from lensfit.errors import LensfitError
from lensfit.fitting.lens_states import fit
from lensfit.fitting.wavefront.aliasing import model_images
from lensfit.fitting.wavefront.centroid_biases import centroid_biases_mm
from lensfit.fitting.wavefront.dot_arrays import show_edges
from lensfit.fitting.wavefront.dot_data import DotData, select_dots
from lensfit.fitting.wavefront.effort import Effort
from lensfit.fitting.wavefront.fit import WavefrontFit
from lensfit.fitting.wavefront.stages import Stage, recentre_patches, stage_on_dots
from lensfit.fitting.wavefront.waves import Transfer, basis_of
from lensfit.programs import forget_programs
from lensfit.progress import Progress, silent, stopwatch
from lensfit.psf.spot import Spot, image_of
from lensfit.workflow.calibration.observe import observe_shoot

SETS = (
    "dot_pattern_01",
    "dot_pattern_05",
    "gopro8",
    "surg_metal",
    "robvis",
    "udacity_wide",
    "line_pattern_01",
)
_DOTS = 200
"""That are predicted, and as many others that Gaussians are fitted to."""
_SIGMAS_CELLS = np.array([0.0, 0.2, 0.35, 0.5, 0.7, 0.9, 1.2, 1.5, 1.9, 2.4, 3.0, 4.0])
_SMOOTHING = 1.0
_APART_MM = 1e3
"""Farther than any field: dots of one photograph are no neighbours of another's."""
_GREEN, _LARGER = 1, 4
"""The channel, and where a pass has the size of discs (`fitting.wavefront.patch`)."""
_SEED = 5


class Prediction(NamedTuple):
    """Relative errors of dots that no fit saw.

    Attributes
    ----------
    lens : By the fitted blur.
    peers : By others, by name.
    noise : What the grain of the pixels alone would leave.
    """

    lens: Float[np.ndarray, " dots"]
    peers: dict[str, Float[np.ndarray, " dots"]]
    noise: Float[np.ndarray, " dots"]


def bench_blur(
    data: str | Path,
    out_dir: str | Path | None = None,
    *,
    only: str | Sequence[str] | None = None,
    effort: Effort = Effort.NORMAL,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Fit and predict every set of dots, or one.

    Parameters
    ----------
    data : Folder with ``real``.
    out_dir : Folder for bench_blur.json.
    only : Name of a set, or several.

    Returns
    -------
    "rows" with median and 90th percentile of each set beside those of others, "sets"
    with seconds, "machine", and "errors", one line for each set without blur.

    Raises
    ------
    LensfitError : There is no set of that name, or the results cannot be written.
    """
    on, rows, sets, errors = machine(), [], [], []
    names = [one.name for one in chosen_sets(SETS if only is None else only)]
    for done, name in enumerate(names):
        progress("sets", done, len(names))
        forget_programs()
        try:
            with stopwatch() as spent:
                fitted = _fitted(name, Path(data), effort)
            rows += _rows(name, prediction_of(fitted))
        except LensfitError as error:
            errors.append(f"{name}: {error}")
            continue
        sets.append({"set": name, "seconds": spent["seconds"]})
    progress("sets", len(names), len(names))
    return bench_result(
        "blur", on, out_dir, rows=as_tables(rows), sets=sets, errors=errors
    )


def prediction_of(fitted: WavefrontFit) -> Prediction:
    """Of some dots of all photographs, chosen by chance.

    Raises
    ------
    LensfitError : Dots are small holes, whose rims nobody sees.
    """
    stage, every = fitted.stage, fitted.dot_data
    if every.dots.broad is None:
        raise LensfitError("its dots are too small to be predicted by their rims")
    rows = np.random.default_rng(_SEED).permutation(_unseen_rows(fitted))
    half = min(_DOTS, len(rows) // 2)
    larger = _larger(stage, select_dots(every, rows[-half:]))
    test, train = (
        _resized(select_dots(every, some), larger)
        for some in (rows[:half], rows[half : 2 * half])
    )
    place_mm = test.observed_mm - centroid_biases_mm(stage, test)
    lens, signal = model_images(stage, test, place_mm)[:, _GREEN], _signal(test)
    return Prediction(
        _errors_of_lens(test, lens, signal),
        _errors_of_gaussians(train, test, signal),
        np.nan_to_num(_grain_of(test, lens)) / signal,
    )


def _larger(stage: Stage, whole: DotData) -> float:
    """Share by which the discs are larger than stated, as the fit found it; of rims,
    which do not say, by whole dots behind its blur."""
    if show_edges(stage.dot_data.dots).any():
        stage = recentre_patches(stage_on_dots(stage, whole))
    return float(np.nanmedian(stage.nuisance[:, _GREEN, _LARGER]))


def _unseen_rows(fitted: WavefrontFit) -> Int[np.ndarray, " rows"]:
    """Dots that the fit was not made from."""
    seen, every = (
        np.round(np.column_stack([_middles_mm(g), g.take]), 6)
        for g in (fitted.stage.dot_data, fitted.dot_data)
    )
    known = {tuple(row) for row in seen.tolist()}
    rows = [k for k, row in enumerate(every.tolist()) if tuple(row) not in known]
    return np.array(rows, int)


def _middles_mm(dot_data: DotData) -> Float[np.ndarray, "dots 2"]:
    """Of the dots in the field, whichever part of them is shown."""
    broad = dot_data.dots.broad
    assert broad is not None
    return np.asarray(dot_data.dots.field_mm + broad.rim_mm)


def _fitted(name: str, data: Path, effort: Effort) -> WavefrontFit:
    (one,) = chosen_sets(name)
    observed = observe_shoot(shoot_of(one, data), None, silent)
    takes = [o.take for o in observed if o.take is not None]
    fitted = fit(takes, effort=effort)
    if not fitted.wavefronts:
        why = "; ".join(fitted.unmeasured_blur.values()) or "its chart has no dots"
        raise LensfitError(f"no blur was measured: {why}")
    return next(iter(fitted.wavefronts.values()))


def _rows(name: str, found: Prediction) -> list[Row]:
    rows = []
    for what, share in (("median", 0.5), ("90th percentile", 0.9)):
        peers = {k: float(np.quantile(v, share)) for k, v in found.peers.items()}
        value, noise = (float(np.quantile(v, share)) for v in (found.lens, found.noise))
        rows.append(
            Row(
                name,
                f"unseen dots, relative error, {what}",
                value,
                min(peers.values()),
                1.5 * noise,
                peers | {"grain": noise},
            )
        )
    return rows


def _resized(dot_data: DotData, larger: float) -> DotData:
    """With discs as large as the fit found them."""
    broad = dot_data.dots.broad
    assert broad is not None
    broad = broad._replace(disc_mm=(1 + larger) * broad.disc_mm)
    return replace(dot_data, dots=dot_data.dots._replace(broad=broad))


def _errors_of_lens(
    test: DotData,
    image: Float[np.ndarray, "dots rows columns"],
    signal: Float[np.ndarray, " dots"],
) -> Float[np.ndarray, " dots"]:
    """Where the fitted lens lets no light through there is no image: all is error."""
    errors = _left_of(test, image) / signal
    return np.where(np.isnan(errors), 1.0, errors)


def _errors_of_gaussians(
    train: DotData, test: DotData, signal: Float[np.ndarray, " dots"]
) -> dict[str, Float[np.ndarray, " dots"]]:
    """Of Gaussians that were fitted to other dots."""
    count, trained = len(train.take), _signal(train)
    each = [_left_of(train, _behind(train, np.full(count, s))) for s in _SIGMAS_CELLS]
    each = np.stack(each) / trained
    one = _SIGMAS_CELLS[int(np.argmin(np.median(each, 1)))]
    varying = RBFInterpolator(
        _places(train),
        _SIGMAS_CELLS[np.argmin(each, 0)],
        kernel="linear",
        smoothing=_SMOOTHING,
    )
    there = np.maximum(varying(_places(test)), 0.0)
    sigmas_cells = {
        "one Gaussian": np.full(len(test.take), one),
        "a Gaussian over the field": there,
        "no blur": np.zeros(len(test.take)),
    }
    return {
        name: _left_of(test, _behind(test, sigma_cells)) / signal
        for name, sigma_cells in sigmas_cells.items()
    }


def _places(dot_data: DotData) -> Float[np.ndarray, "dots 3"]:
    """In the field, photographs far from each other."""
    return np.column_stack([dot_data.dots.field_mm, _APART_MM * dot_data.take])


def _signal(dot_data: DotData) -> Float[np.ndarray, " dots"]:
    """Norm of the light of every dot over what lies around a disc without blur: one for
    all images, since a wide haze and the background that is found beside it make up for
    each other, and its own would make any error small."""
    return _over_background(dot_data, _behind(dot_data, np.zeros(len(dot_data.take))))


def _behind(
    dot_data: DotData, sigma_cells: Float[np.ndarray, " dots"]
) -> Float[np.ndarray, "dots rows columns"]:
    """Images of discs at their centroids behind Gaussians."""
    place_mm = dot_data.observed_mm[:, _GREEN]
    arrays = dot_data.transfer, dot_data.dots.cell_mm, place_mm, sigma_cells
    image = _discs(jax.tree.map(jnp.asarray, arrays), dot_data.light.shape[-1])
    return np.asarray(image)


@partial(jax.jit, static_argnames="cells")
def _discs(arrays: tuple[Transfer, Array, Array, Array], cells: int) -> Array:
    """Images of a brightness of 1."""

    def one(part: tuple[Transfer, Array, Array, Array]) -> Array:
        transfer, cell_mm, place_mm, sigma_cells = part
        basis = basis_of(-place_mm, cell_mm, cells, transfer)
        ray = Spot(jnp.zeros((1, 2)), jnp.ones(1), jnp.zeros(1))
        profile = basis.profile(ray, (sigma_cells * cell_mm) ** 2)
        return basis.cell_light(image_of(ray, profile))

    return jax.lax.map(one, arrays)


class _Found(NamedTuple):
    """Brightness and background found for every image.

    Attributes
    ----------
    light, used : Of the cells, and where they tell both; no light elsewhere.
    left : What the images leave of it.
    background : Of every dot.
    """

    light: Float[np.ndarray, "dots rows columns"]
    used: Bool[np.ndarray, "dots rows columns"]
    left: Float[np.ndarray, "dots rows columns"]
    background: Float[np.ndarray, " dots"]


def _found(dot_data: DotData, image: Float[np.ndarray, "dots rows columns"]) -> _Found:
    """By least squares."""
    used = (dot_data.valid & ~dot_data.clipped)[:, _GREEN]
    light = np.where(used, dot_data.light[:, _GREEN], 0.0)
    design = np.stack([image, np.ones_like(image)], -1) * used[..., None]
    inner = np.einsum("drci,drcj->dij", design, design)
    right = np.einsum("drci,drc->di", design, light)
    found = np.linalg.solve(inner, right[..., None])[..., 0]
    left = light - np.einsum("drci,di->drc", design, found)
    return _Found(light, used, left, found[:, 1])


def _over_background(
    dot_data: DotData, image: Float[np.ndarray, "dots rows columns"]
) -> Float[np.ndarray, " dots"]:
    """Norm of the light of dots over the background that is found beside images."""
    found = _found(dot_data, image)
    over = (found.light - found.background[:, None, None]) * found.used
    return np.linalg.norm(over, axis=(1, 2))


def _left_of(
    dot_data: DotData, image: Float[np.ndarray, "dots rows columns"]
) -> Float[np.ndarray, " dots"]:
    """Norm of what images leave of dots."""
    return np.linalg.norm(_found(dot_data, image).left, axis=(1, 2))


def _grain_of(
    dot_data: DotData, image: Float[np.ndarray, "dots rows columns"]
) -> Float[np.ndarray, " dots"]:
    """Norm of what is left from one cell to the next, which no image explains."""
    found = _found(dot_data, image)
    used, left = found.used, found.left
    pair = used[..., 1:] & used[..., :-1]
    step = np.where(pair, left[..., 1:] - left[..., :-1], 0.0)
    grain = np.sqrt(np.sum(step**2, (1, 2)) / 2 / np.maximum(pair.sum((1, 2)), 1))
    return grain * np.sqrt(used.sum((1, 2)))
