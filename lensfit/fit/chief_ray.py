"""The geometric fit of one lens state: poses, focal length, distortion, board errors.

Four stages, each starting from the one before:

1. a compact model (pose, three radial terms; focal length if the views tilt) from
   homographies, on the base projection that suits the marks best;
2. the named terms the photographs ask for, chosen by evidence (`select`), twice;
3. the free field, chosen on top of named terms that are held where they are, since it
   spans them; then a few damped steps with everything free, along the curved valley
   that this leaves;
4. half of every photograph's marks predicting the other half, three times.
"""

import time
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from threadpoolctl import threadpool_limits

from lensfit.errors import FitError
from lensfit.fit.adjust import (
    VALLEY_DAMPING,
    Adjustment,
    adjust,
    equations_at,
    fixed_prior,
    problem_of,
    release,
    solved,
    with_poses_free,
)
from lensfit.fit.parameters import (
    DRIFT_PARAMETERS,
    POSE_PARAMETERS,
    Layout,
    Prior,
)
from lensfit.fit.select import (
    Step,
    Verdict,
    bend_steps,
    choose,
    drift_steps,
    families,
)
from lensfit.fit.stage import Start, start_of
from lensfit.fit.take import Take
from lensfit.fit.trial import Statistics
from lensfit.fit.views import noise_mm2, residuals_of
from lensfit.optics.base import BASE_PROJECTIONS, BaseProjection
from lensfit.progress import Progress, silent

PRIOR_STANDARD_DEVIATION = {
    "focal_length": 0.3,
    "principal_point": 0.05,
    "radial": 1.0,
    "squeeze": 0.1,
    "decentering": 0.05,
    "thin_prism": 0.05,
    "anamorphic": 0.05,
    "free_field": 0.01,
    "row_drift": 0.005,
    "board_bend": 0.01,
    "board_stretch": 0.01,
    "aperture_shift": 0.01,
}
"""In reference radii (or half boards): loose, but enough to keep what the photographs
do not see from wandering; the principal point stays well inside the frame."""

COMPACT_RADIAL_TERMS = 3
HELD_OUT_SEEDS = (0, 1, 2)
_ODD_SQUEEZE = 1.05
"""No spherical lens, and no photosite, differs as much between its axes."""
_WIDE_RADIANS = 0.85
_HELD_OUT_STEPS = 6
_SAMPLE_PER_VIEW = 512


@dataclass(frozen=True, eq=False)
class ChiefRayFit:
    """A fitted lens state, before colour and fall-off.

    Attributes
    ----------
    takes : What was fitted, in the order of the arrays.
    adjustment : The fit.
    kept : Names of the blocks that are free.
    verdicts : What came of every term that was tried.
    focal_length_free : Whether the photographs determine the focal length.
    held_out_rms_px : Mean over seeds, per take, and for all.
    """

    takes: tuple[Take, ...]
    adjustment: Adjustment
    kept: tuple[str, ...]
    verdicts: tuple[Verdict, ...]
    focal_length_free: bool
    held_out_rms_px: float
    held_out_rms_px_of_take: tuple[float, ...]
    notes: tuple[str, ...]
    seconds: dict[str, float]


# Matrices of a few hundred rows gain nothing from several BLAS threads, which spin
# while they wait: on a busy machine a fit took ten times longer.
@threadpool_limits.wrap(limits=1, user_api="blas")
def fit_chief_ray(
    takes: list[Take],
    progress: Progress = silent,
    *,
    shown: list[Take] | None = None,
    base: BaseProjection | None = None,
) -> ChiefRayFit:
    """Fit one lens state (one focal length and focus) to its takes.

    `shown` are the takes of all states of the lens: the box of the free field covers
    them, so that states can be interpolated. `base` is the ideal projection to start
    from; by default the one that suits the marks best.

    Raises
    ------
    FitError : The marks do not determine a lens, or contradict what was stated.
    """
    clock = time.perf_counter
    began = clock()
    require_marks(takes)
    start = start_of(takes, shown or takes)
    compact = _compact(start, base)
    progress("fit", 1, 5)
    after_compact = clock()
    fitted, kept, verdicts = _with_evidence(start, compact, progress)
    after_selection = clock()
    held_out, per_take = held_out_error_px(fitted)
    progress("fit", 5, 5)
    return ChiefRayFit(
        takes=tuple(takes),
        adjustment=fitted,
        kept=kept,
        verdicts=tuple(verdicts),
        focal_length_free=start.focal_length_free,
        held_out_rms_px=held_out,
        held_out_rms_px_of_take=per_take,
        notes=start.notes + _told(fitted),
        seconds={
            "fit_compact": after_compact - began,
            "fit_select": after_selection - after_compact,
            "fit_held_out": clock() - after_selection,
        },
    )


def _told(fitted: Adjustment) -> tuple[str, ...]:
    """What the user should know of how the fit ended."""
    notes = []
    if not fitted.converged:
        notes.append(
            "the fit ended at its step limit: some terms are hardly determined, "
            "see their standard deviations"
        )
    squeezed = fitted.parameters[fitted.layout.blocks["squeeze"]]
    ratio = float(np.exp(np.hypot(*squeezed)))
    if ratio > _ODD_SQUEEZE:
        notes.append(
            f"one axis of the picture is {100 * (ratio - 1):.0f} % longer than stated: "
            "check pitch_mm (square marks have one pitch) and anamorphic_squeeze"
        )
    return tuple(notes)


def squared_px(adjustment: Adjustment) -> Float[np.ndarray, "views marks"]:
    """Squared residual of every mark, square pixels."""
    squared = np.sum(adjustment.residual_mm() ** 2, -1)
    return squared / adjustment.stack.mm_per_px[:, None] ** 2


def rms(squared: np.ndarray, chosen: Bool[np.ndarray, "..."]) -> float:
    """Root mean square over the chosen marks; NaN if there are none."""
    return float(np.sqrt(np.mean(squared[chosen]))) if chosen.any() else float("nan")


def held_out_error_px(
    adjustment: Adjustment, seeds: tuple[int, ...] = HELD_OUT_SEEDS
) -> tuple[float, tuple[float, ...]]:
    """Error on the half of each view's marks that a fit has not seen.

    Model and poses are fitted anew to a random half; the mean over seeds, for all
    photographs and for each.
    """
    whole, each = [], []
    for seed in seeds:
        fitted, seen = fitted_to_half(adjustment, seed)
        squared = squared_px(fitted)
        unseen = adjustment.used & ~seen
        whole.append(rms(squared, unseen))
        each.append([rms(s, u) for s, u in zip(squared, unseen, strict=True)])
    return float(np.mean(whole)), tuple(np.mean(each, axis=0).tolist())


def fitted_to_half(
    adjustment: Adjustment, seed: int
) -> tuple[Adjustment, Bool[np.ndarray, "views marks"]]:
    """The same model and weights fitted to a random half of the marks; which half."""
    seen = np.random.default_rng(seed).random(adjustment.weight.shape) < 0.5
    problem = problem_of(adjustment, np.where(seen, adjustment.weight, 0.0))
    return solved(adjustment, problem, _HELD_OUT_STEPS, VALLEY_DAMPING), seen


def _compact(start: Start, base: BaseProjection | None) -> Adjustment:
    """Stage 1, on the given base projection or the one that leaves least."""
    bases = BASE_PROJECTIONS[: 2 if start.half_angle_rad > _WIDE_RADIANS else 1]
    bases = bases if base is None else (base,)
    best = None
    for base in bases:
        fitted = _compact_on(start, replace(start.layout, base=base))
        squared = squared_px(fitted)
        score = float(np.median(squared[fitted.stack.present]))
        if best is None or score < 0.95 * best[0]:
            best = (score, fitted)
    assert best is not None
    return best[1]


def _compact_on(start: Start, layout: Layout) -> Adjustment:
    """A sample of the marks is enough to come near."""
    chunks = start.stack.chunking.sample(_SAMPLE_PER_VIEW)
    prior = with_poses_free(fixed_prior(layout, len(start.takes)), layout)
    first = layout.blocks["radial"].start
    prior = release(prior, slice(first, first + COMPACT_RADIAL_TERMS), 0.3)
    adjustment = start.adjustment(layout, prior)
    adjustment = adjust(adjustment, rounds=2, chunks=chunks)
    blocks = ["aperture_shift"]
    if start.focal_length_free:
        blocks += ["focal_length", "principal_point"]
    for name in blocks:
        prior = release(prior, layout.blocks[name], PRIOR_STANDARD_DEVIATION[name])
    return adjust(replace(adjustment, prior=prior), rounds=2, chunks=chunks)


def _with_evidence(
    start: Start, compact: Adjustment, progress: Progress
) -> tuple[Adjustment, tuple[str, ...], list[Verdict]]:
    """Stages 2 and 3."""
    views, layout = len(start.takes), compact.layout
    always = _always(layout, views, start.focal_length_free)
    terms = families(layout, start.largest)
    if start.focal_length_free:
        del terms["principal_point"]  # it is in every model then
    free_field = {n: terms.pop(n) for n in ("free_field",) if n in terms}
    adjustment, kept, verdicts = compact, {}, []
    for turn in range(2):
        adjustment, kept, verdicts = _chosen(adjustment, always, terms)
        progress("fit", 2 + turn, 5)
    names = [terms[f][n - 1].name for f, n in kept.items()]
    if layout.bend_degree:
        # On top of the lens, never instead of it: seen frontally, a bent board
        # and a distorting lens are one and the same.
        lens = np.setdiff1d(_indices(always, kept, terms), _spanned(layout))
        bends = {
            "board_bend": bend_steps(layout, views),
            "row_drift": drift_steps(layout, views),
        }
        adjustment, more, others = _chosen(adjustment, lens, bends)
        verdicts = verdicts + others
        names += [bends[f][n - 1].name for f, n in more.items()]
        everything = np.union1d(
            _indices(always, kept, terms), _indices(lens, more, bends)
        )
        adjustment = _all_free(adjustment, everything)
    if free_field:
        adjustment, more, others = _with_free_field(adjustment, always, free_field)
        verdicts, names = verdicts + others, names + more
    progress("fit", 4, 5)
    return adjustment, tuple(names), verdicts


def _with_free_field(
    named: Adjustment, always: np.ndarray, steps: dict[str, list[Step]]
) -> tuple[Adjustment, list[str], list[Verdict]]:
    """Stage 3; afterwards everything that was kept is free again."""
    fitted, kept, verdicts = _chosen(named, always, steps)
    if not kept:
        return named, [], verdicts
    step = steps["free_field"][kept["free_field"] - 1]
    everything = np.union1d(np.flatnonzero(named.prior.free), step.indices)
    return _all_free(fitted, everything), [step.name], verdicts


def _all_free(adjustment: Adjustment, everything: np.ndarray) -> Adjustment:
    """One more round with all these free, each with a loose prior around zero."""
    prior = _prior_of(adjustment, np.zeros(0, int), everything)
    prior = Prior(np.where(prior.free, 0.0, prior.mean), prior.standard_deviation)
    released = replace(adjustment, prior=prior)
    return adjust(released, rounds=1, damping=VALLEY_DAMPING)


def _spanned(layout: Layout) -> np.ndarray:
    """Lens terms of degree three and more, held while bends are tried."""
    blocks = [layout.blocks[name] for name in ("radial", "anamorphic")]
    return np.concatenate([np.arange(b.start, b.stop) for b in blocks])


def _chosen(
    adjustment: Adjustment,
    always: np.ndarray,
    terms: dict[str, list[Step]],
) -> tuple[Adjustment, dict[str, int], list[Verdict]]:
    """Linearise, choose among `terms`, and fit what was chosen.

    Parameters that are neither in `always` nor in `terms` stay where they are.
    """
    tried = np.unique(
        np.concatenate([always, *(s[-1].indices for s in terms.values())])
    )
    everything = _prior_of(adjustment, tried, tried)
    precision = np.where(everything.free, 1.0, 0.0)
    precision = precision / np.maximum(everything.standard_deviation, 1e-30) ** 2
    offset = adjustment.parameters - everything.mean
    found = choose(
        *halves_of(replace(adjustment, prior=everything)),
        precision,
        offset,
        always,
        terms,
        int(adjustment.used.sum()),
        _px_per_deviation(adjustment),
    )
    chosen = _indices(always, found.kept, terms)
    started = replace(
        adjustment,
        parameters=adjustment.parameters + found.step,
        prior=_prior_of(adjustment, tried, chosen),
    )
    return adjust(started), found.kept, found.verdicts


def _always(layout: Layout, views: int, focal_length: bool) -> np.ndarray:
    """Parameters in every model: poses, and the pinhole where it can be known."""
    local = layout.shared + np.arange(layout.local * views).reshape(views, -1)
    poses = local[:, :POSE_PARAMETERS].ravel()
    pinhole = [layout.blocks["focal_length"], layout.blocks["principal_point"]]
    known = [np.arange(w.start, w.stop) for w in pinhole if focal_length]
    return np.concatenate([*known, poses]).astype(int)


def _indices(
    always: np.ndarray, kept: dict[str, int], terms: dict[str, list[Step]]
) -> np.ndarray:
    chosen = [terms[family][level - 1].indices for family, level in kept.items()]
    return np.unique(np.concatenate([always, *chosen]))


def _prior_of(adjustment: Adjustment, tried: np.ndarray, free: np.ndarray) -> Prior:
    """Loose priors around zero on `free`; zero for what was tried and is not free.

    Every other parameter is held at its present value.
    """
    layout, views = adjustment.layout, len(adjustment.weight)
    deviation = np.zeros(layout.size(views))
    for name, where in layout.blocks.items():
        deviation[where] = PRIOR_STANDARD_DEVIATION[name]
    local = deviation[layout.shared :].reshape(views, -1)
    local[:, :POSE_PARAMETERS] = 3.0
    local[:, POSE_PARAMETERS:] = PRIOR_STANDARD_DEVIATION["row_drift"]
    bend = local[:, POSE_PARAMETERS + DRIFT_PARAMETERS :]
    bend[:] = PRIOR_STANDARD_DEVIATION["board_bend"]
    mask = np.zeros(len(deviation), bool)
    mask[free] = True
    mean = adjustment.parameters.copy()
    mean[tried] = 0.0
    return Prior(mean, np.where(mask, deviation, 0.0))


def _px_per_deviation(adjustment: Adjustment) -> float:
    """Pixels that a whitened residual of one stands for, on average."""
    variance = noise_mm2(adjustment.stack) + adjustment.model_variance_mm2[:, None]
    mean = np.mean(variance[adjustment.used])
    return float(np.sqrt(mean) / adjustment.stack.mm_per_px.mean())


def halves_of(adjustment: Adjustment) -> tuple[Statistics, Statistics]:
    """Normal equations of the full model on two random halves of the marks."""
    here = equations_at(adjustment)
    matrix, gradient = np.asarray(here.matrix), np.asarray(here.gradient)
    squares = np.asarray(here.chi_squared)
    deal = adjustment.stack.chunking
    residuals = residuals_of(adjustment.stack) * adjustment.used
    counts = deal.cut(residuals) * deal.real
    one, other = (
        Statistics(
            matrix[half],
            gradient[half],
            float(squares[half]),
            int(counts[:, half::2].sum()),
        )
        for half in (0, 1)
    )
    return one, other


def require_marks(takes: list[Take], fewest: int = 12) -> None:
    """Refuse takes with too few marks to fix a pose.

    Raises
    ------
    FitError : Naming the take.
    """
    for take in takes:
        if len(take.observations) < fewest:
            raise FitError(
                f"only {len(take.observations)} marks, {fewest} are needed",
                where=take.name,
                remedy="photograph more of the target",
            )
