"""The wavefront of a lens at one focal length, from all its dot photographs at once.

Stages are those of `stages`, terms enter as `evidence` says, and what was learnt comes
with its uncertainty. Takes of other focus distances share everything but defocus: the
lens only moves against the sensor (unit focusing), so the same ray lands further out
by the ratio of the principal distances.
"""

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from lensfit.fit.illumination import FallOffFit
from lensfit.fit.select import Verdict
from lensfit.fit.wavefront.blades import EVIDENTLY, with_blades
from lensfit.fit.wavefront.coarse import coarse_fit
from lensfit.fit.wavefront.effort import Effort
from lensfit.fit.wavefront.evidence import choose, held_out_dots, held_out_take
from lensfit.fit.wavefront.families import (
    FINE,
    LAST,
    MIDDLE,
    Family,
    deviation_of,
    families_of,
)
from lensfit.fit.wavefront.gather import (
    Gathered,
    chosen,
    gather,
    spread_over_takes,
)
from lensfit.fit.wavefront.normal import Points
from lensfit.fit.wavefront.parameters import Layout
from lensfit.fit.wavefront.shown import Shown
from lensfit.fit.wavefront.stages import (
    Stage,
    chi_squared,
    freed,
    on_dots,
    reweighed,
    settled,
    solved,
)
from lensfit.fit.wavefront.uncertainty import covariance_of, unseen
from lensfit.fit.wavefront.weigh import MODEL_SHARE, relative_misfit
from lensfit.optics.spectrum import Bands, bands
from lensfit.optics.terms import (
    decentring_terms,
    rotational_terms,
    two_mirror_terms,
)
from lensfit.progress import Progress, silent

TERMS = rotational_terms(9) + decentring_terms()
COLOUR_TERMS = rotational_terms(5)
CYLINDER_TERMS = tuple(t for t in two_mirror_terms(5) if t not in TERMS)
CYLINDER_COLOURS = two_mirror_terms(1)
"""What a lens with cylinders has besides."""
_GROUPS, _STOPS = 8, 4
"""Room for so many defocus values and f-numbers, so that one program serves most."""
_BETWEEN = 5
"""Passes between two findings of weights."""
_COSTLY = 1.05
"""How much worse the photographs may be explained without what was left out."""
_LAST_STEPS, _LAST_TOLERANCE = 6, 5e-4
_LAST_POINTS = Points(image=1536, design=768, evenly_lit=False)
"""Shifting all rays of the pupil together, rims included, hardly changes an image. Few
rays make that valley look steep: a fit would end on its way along it, and believe that
it knows the place."""


@dataclass(frozen=True, eq=False)
class WavefrontFit:
    """What the photographs say about the wavefront.

    Attributes
    ----------
    gathered : Every dot.
    stage : The fit, on the dots it was made from.
    families : What is free.
    verdicts : What came of every family that was tried.
    covariance : Of all parameters.
    unseen : Families that the photographs do not see.
    sign_known : Whether stated distances or the photographs settle the sign of defocus.
    misfit : Median relative error of a dot's image, per take.
    held_out_misfit : The same for dots the fit did not see.
    held_out_takes : The same for each take if the fit had not seen it; None where the
        other takes do not determine the fit.
    converged : Whether the last solve met its tolerance.
    notes : One sentence for each thing the photographer should know.
    """

    gathered: Gathered
    stage: Stage
    families: tuple[Family, ...]
    verdicts: tuple[Verdict, ...]
    covariance: Float[np.ndarray, "parameters parameters"]
    unseen: tuple[str, ...]
    sign_known: bool
    misfit: Float[np.ndarray, " takes"]
    held_out_misfit: float
    held_out_takes: tuple[float | None, ...]
    converged: bool
    notes: tuple[str, ...]

    def has(self, family: str) -> bool:
        """Whether a family of parameters was fitted and kept."""
        return any(one.name == family for one in self.families)


def fit_wavefront(
    shown: list[Shown],
    fall_off: FallOffFit | None,
    progress: Progress = silent,
    *,
    effort: Effort = Effort.NORMAL,
    spectrum: Bands | None = None,
    allowed: Collection[str] | None = None,
) -> WavefrontFit:
    """Fit the wavefront to the dots of all photographs of one focal length.

    Parameters
    ----------
    shown : Photographs whose f-number is known.
    fall_off : Measured at the widest f-number, or None.
    allowed : Names of the families that may be free (`families.SEIDEL`); None for all.
    """
    every = gather(shown, spectrum or bands(3))
    cylinders = every.dots.sections is not None
    layout = Layout(
        TERMS + CYLINDER_TERMS if cylinders else TERMS,
        COLOUR_TERMS + CYLINDER_COLOURS if cylinders else COLOUR_TERMS,
        groups=max(_GROUPS, len(every.groups)),
        stops=max(_STOPS, len(every.f_numbers) - 1),
        anamorphic=cylinders,
    )
    few = chosen(every, spread_over_takes(every, effort.coarse_dots))
    coarse, sign_known, families = coarse_fit(few, layout, fall_off, allowed)
    progress("wavefront", 1, 4)
    middle = _middle(coarse, families)
    progress("wavefront", 2, 4)
    more = chosen(every, spread_over_takes(every, effort.fine_dots))
    defocus_mm = coarse.mean[layout.blocks["defocus"]]
    families = families_of(more, layout, defocus_mm, allowed)
    fine = _fine(more, middle, families, effort.rounds)
    progress("wavefront", 3, 4)
    fine, families, verdicts = _chosen(fine, families)
    final = _ended(fine, families)
    progress("wavefront", 4, 4)
    covariance = covariance_of(final, families)
    misfit, held_out = _misfits(final, families)
    return WavefrontFit(
        gathered=every,
        stage=final,
        families=families,
        verdicts=verdicts,
        covariance=covariance,
        unseen=unseen(final, families, covariance),
        sign_known=sign_known,
        misfit=misfit,
        held_out_misfit=float(np.median(misfit)) * held_out_dots(final, families),
        held_out_takes=held_out,
        converged=bool(final.solution and final.solution.converged),
        notes=_notes(sign_known, final),
    )


def _middle(coarse: Stage, families: tuple[Family, ...]) -> Stage:
    """Fifth order on less smoothed dots."""
    stage = replace(coarse, smoothing=1.5)
    stage = freed(stage, deviation_of(families, stage.layout, MIDDLE))
    return solved(solved(stage))


def _fine(
    gathered: Gathered, middle: Stage, families: tuple[Family, ...], rounds: int
) -> Stage:
    """Everything on full pixels; the blades as soon as the rest is nearly right."""
    stage = replace(on_dots(middle, gathered), smoothing=0.0)
    stage = settled(freed(stage, deviation_of(families, middle.layout, FINE)))
    stage = solved(with_blades(stage, EVIDENTLY))
    if not stage.blades:
        stage = with_blades(stage)
    for _ in range(rounds):
        stage = reweighed(solved(stage, _BETWEEN), MODEL_SHARE)
    return solved(stage)


def _chosen(
    fine: Stage, families: tuple[Family, ...]
) -> tuple[Stage, tuple[Family, ...], tuple[Verdict, ...]]:
    """With only the families that stay, if that holds what the choice expects."""
    kept, verdicts = choose(fine, families)
    deviation = deviation_of(kept, fine.layout, FINE)
    dropped = (fine.deviation > 0) & (deviation == 0)
    if not dropped.any():
        return fine, kept, verdicts
    parameters = np.where(dropped, fine.mean, fine.parameters)
    stage = freed(replace(fine, parameters=parameters), deviation)
    stage = solved(solved(stage))
    # It is made in retrospect, from second derivatives, which may be wrong far off.
    if chi_squared(stage) > _COSTLY * chi_squared(fine):
        return fine, families, tuple(replace(v, kept=True) for v in verdicts)
    return stage, kept, verdicts


def _ended(stage: Stage, families: tuple[Family, ...]) -> Stage:
    """After the last solves."""
    stage = freed(stage, deviation_of(families, stage.layout, LAST))
    stage = replace(stage, points=_LAST_POINTS)
    stage = solved(stage, _LAST_STEPS, _LAST_TOLERANCE)
    assert stage.solution is not None
    converged = stage.solution.converged
    # Seen once more from where the patches have been moved to.
    stage = settled(stage, 1)
    assert stage.solution is not None
    return replace(stage, solution=stage.solution._replace(converged=converged))


def _misfits(
    stage: Stage, families: tuple[Family, ...]
) -> tuple[np.ndarray, tuple[float | None, ...]]:
    """Per take: of the fit, and if the fit had not seen it."""
    each = relative_misfit(stage.gathered, stage.residual, stage.nuisance[..., 1])
    takes = range(len(stage.gathered.shown))
    misfit = np.array([np.nanmedian(each[stage.gathered.take == k]) for k in takes])
    if len(misfit) < 2:
        return misfit, (None,) * len(misfit)
    factors = [held_out_take(stage, families, k) for k in takes]
    held_out = tuple(
        None if f is None else float(f * m)
        for f, m in zip(factors, misfit, strict=True)
    )
    return misfit, held_out


def _notes(sign_known: bool, stage: Stage) -> tuple[str, ...]:
    notes = []
    if not sign_known:
        notes.append(
            "the photographs do not tell on which side of focus the chart was: state "
            "focus_distance_mm and target_distance_mm, or add a take on the other side"
        )
    if stage.solution is not None and not stage.solution.converged:
        notes.append("the fit of the dots' shape did not converge")
    return tuple(notes)
