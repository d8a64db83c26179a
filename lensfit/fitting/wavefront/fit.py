"""The wavefront of a lens at one focal length, from all its dot photographs at once.

The fit passes through the stages of `descent`, from every multistart candidate that is
still open (`multistart`), and its result has an uncertainty. Takes of other focus
distances share everything but defocus: the lens only moves against the sensor (unit
focusing), so the same ray lands further out by the principal-distance ratio.

Where all photographs were taken at one f-number or on one side of focus, a wavefront
that explains them predicts other settings poorly: aberrations and defocus compensate
each other there, and not elsewhere.
"""

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from lensfit.fitting.select import TermDecision
from lensfit.fitting.wavefront.coarse import CoarseFit, coarse_fit, solve_on_all_dots
from lensfit.fitting.wavefront.descent import (
    cost_at_initial_weights,
    fine_fit,
    fit_selected_term_groups,
    last_fit,
    middle_fit,
    other_side_cost,
    pixel_fit,
)
from lensfit.fitting.wavefront.dot_data import (
    DotData,
    PhotographedFallOff,
    dot_data_of,
    rows_spread_over_takes,
    select_dots,
    widen_beam,
)
from lensfit.fitting.wavefront.dot_patches import DotPhotograph, rim_patches
from lensfit.fitting.wavefront.effort import Effort
from lensfit.fitting.wavefront.misfit import Misfit, misfit_of
from lensfit.fitting.wavefront.multistart import (
    DECISIVE,
    Candidate,
    best_candidate,
    candidate_at,
    have_starts_agreed,
    is_side_determined,
    leading_candidates,
    open_candidates,
    runs_against_statements,
)
from lensfit.fitting.wavefront.parameters import Layout
from lensfit.fitting.wavefront.stages import (
    Stage,
    add_stated_distances,
    recentre_patches,
    solve_stage,
    stage_on_dots,
    stage_with_beam,
)
from lensfit.fitting.wavefront.start_values import IN_FOCUS_MM, stated_defocus_mm
from lensfit.fitting.wavefront.stated import stated_beam
from lensfit.fitting.wavefront.term_groups import (
    TermGroup,
    candidate_term_groups,
    terms_that_change_with_focus,
)
from lensfit.fitting.wavefront.uncertainty import (
    ModelErrors,
    covariance_of,
    model_errors_of,
    undetermined_term_groups,
)
from lensfit.optics.spectrum import Bands, bands
from lensfit.optics.terms import (
    decentring_terms,
    rotational_terms,
    two_mirror_terms,
)
from lensfit.progress import Progress, silent
from lensfit.psf.blur_quality import ROUGH_BLUR


def extrapolation_notes(dot_data: DotData) -> tuple[str, ...]:
    """One sentence for each kind of setting to which the blur is extrapolated."""
    return (*_stop_extrapolation(dot_data), *_focus_extrapolation(dot_data))


def _stop_extrapolation(dot_data: DotData) -> tuple[str, ...]:
    widest, *others = dot_data.f_numbers
    if others:
        return ()
    if all(one.take.f_number is None for one in dot_data.photographs):
        return (
            "the blur holds for the stop that was photographed, which the preset calls "
            f"f/{widest:g} since nobody stated it: state f_number of each take",
        )
    return (
        f"the blur was photographed at f/{widest:g} alone and is extrapolated to other "
        "stops: photograph the dots at a second f-number",
    )


def _focus_extrapolation(dot_data: DotData) -> tuple[str, ...]:
    """By stated distances; without any, the side of focus is itself unknown."""
    stated_mm = stated_defocus_mm(dot_data)
    if not np.isfinite(stated_mm).all():
        return ()
    near, far = np.any(stated_mm > IN_FOCUS_MM), np.any(stated_mm < -IN_FOCUS_MM)
    if near and far:
        return ()
    if not (near or far):
        return (
            "the blur was photographed in focus alone and is extrapolated out of "
            "focus: add takes focused nearer and farther than the chart",
        )
    return (
        "the blur was photographed on one side of focus alone and is extrapolated to "
        "the other: add takes focused on the other side of the chart",
    )


TERMS = rotational_terms(9) + decentring_terms()
COLOUR_TERMS = rotational_terms(5)
CYLINDER_TERMS = tuple(t for t in two_mirror_terms(5) if t not in TERMS)
CYLINDER_COLOURS = two_mirror_terms(1)
"""Further terms of a lens with cylinders."""
_DOTS_FACTOR_ANAMORPHIC = 2
"""Factor on the dots of the fine stage: the field is not symmetric about the axis."""
_RIMS_PER_DOT = 2
"""Each rim determines one direction of the blur."""
_GROUPS, _STOPS = 8, 4
"""Room for so many defocus values and f-numbers, so that one program serves most."""
_HOPELESS, _MOST_CANDIDATES = 1.2, 4
"""Largest cost over the best one's of candidates that go on to full pixels, and how
many: each takes as long as all stages before."""
_MOST_ON_PIXELS = 2
"""Candidates that are fitted to all dots of the fine stage: each takes as long as all
the rest."""
_ALIKE = 1.01
"""Cost over the best one's up to which new robust weights may reverse the order of two
candidates."""
_Choice = Callable[..., list[Candidate]]
"""One of the rules of `multistart`."""
_EXPLAINED = 4.0
"""Cost of a dot and channel, smoothed, up to which no other start is tried: a residual
of a tenth of the peak on one cell, or of a twentieth on four."""


@dataclass(frozen=True, eq=False)
class WavefrontFit:
    """The wavefront that explains the photographs, and how well it is known.

    Attributes
    ----------
    dot_data : Every dot.
    stage : The fit, on the dots it was made from.
    term_groups : Term groups that are free.
    term_decisions : The decision on every candidate term group.
    covariance : Of all parameters that are free, from the scatter over dots.
    model_errors : What is added to it, for what was left out and for errors that no
        dot shows.
    undetermined_term_groups : Term groups that the photographs do not determine.
    side_settled : Whether stated distances or the photographs choose a side of focus.
    other_side_cost : Of the best lens on the other side of focus than was stated, over
        that of this one; NaN where no side was stated.
    misfit : How far the images of dots are from those photographed.
    unfitted : Photographs at the same focus distances that were not fitted, as those of
        lines where there are dots: where their chief rays land follows from the rest.
    """

    dot_data: DotData
    stage: Stage
    term_groups: tuple[TermGroup, ...]
    term_decisions: tuple[TermDecision, ...]
    covariance: Float[np.ndarray, "parameters parameters"]
    model_errors: ModelErrors
    undetermined_term_groups: tuple[str, ...]
    side_settled: bool
    other_side_cost: float
    misfit: Misfit
    unfitted: DotData | None = None

    @property
    def converged(self) -> bool:
        """Whether the last solve met its tolerance."""
        return self.stage.converged

    @property
    def sign_known(self) -> bool:
        """Whether the sign of defocus is known: a side of focus was chosen, and neither
        dots nor statements speak against it."""
        against = self.mirrored or runs_against_statements(self.stage)
        return self.side_settled and not against

    @property
    def mirrored(self) -> bool:
        """Whether the dots are explained decisively better on the other side of focus
        than was stated."""
        return self.other_side_cost * DECISIVE < 1

    @property
    def fits_stated_side(self) -> bool:
        """Whether the dots are explained decisively better as was stated."""
        return self.sign_known and self.other_side_cost > DECISIVE

    @property
    def total_covariance(self) -> Float[np.ndarray, "parameters parameters"]:
        """Of all parameters, as reports state it."""
        return self.covariance + self.model_errors.of_blur

    @property
    def behind_mosaic(self) -> bool:
        """Whether the shape of some dots was recorded behind a colour mosaic."""
        return any(s.dot_images.mosaic is not None for s in self.dot_data.photographs)

    @property
    def notes(self) -> tuple[str, ...]:
        """One sentence for each thing the photographer should know."""
        said = _notes(
            self.sign_known,
            self.converged,
            self.misfit.held_out_dots,
            against=runs_against_statements(self.stage),
            mirrored=self.mirrored,
        )
        return (*said, *self.extrapolation_notes)

    @property
    def extrapolation_notes(self) -> tuple[str, ...]:
        """Settings to which the blur is extrapolated, in a sentence each."""
        return extrapolation_notes(self.dot_data)

    def has(self, term_group: str) -> bool:
        """Whether a term group was fitted and kept."""
        return any(one.name == term_group for one in self.term_groups)


def fit_wavefront(
    photographs: list[DotPhotograph],
    fall_offs: tuple[PhotographedFallOff, ...] = (),
    progress: Progress = silent,
    *,
    effort: Effort = Effort.NORMAL,
    spectrum: Bands | None = None,
    allowed: Collection[str] | None = None,
) -> WavefrontFit:
    """Fit the wavefront to the dots of all photographs of one focal length.

    Parameters
    ----------
    photographs : Photographs whose f-number is known.
    fall_offs : Measured, the widest f-number first.
    allowed : Names of the term groups that may be free (`term_groups.SEIDEL`); None for
        all.
    """
    spectrum = spectrum or bands(3)
    every = replace(dot_data_of(photographs, spectrum), fall_offs=fall_offs)
    layout = _layout_of(every)
    few = select_dots(
        every, rows_spread_over_takes(every, effort.coarse_dots(len(photographs)))
    )
    coarse = coarse_fit(few, layout, allowed)
    progress("wavefront", 1, 4)
    middle = _candidates_after_middle(coarse, few)
    progress("wavefront", 2, 4)
    times = _DOTS_FACTOR_ANAMORPHIC if layout.anamorphic else 1
    fine_dots = times * effort.fine_dots(len(photographs))
    more = _fine_dots(every, photographs, spectrum, fine_dots)
    begun = _pixel_candidates(middle, more, allowed, both_sides=not coarse.side_stated)
    fine = [fine_fit(stage, effort.rounds) for stage in begun]
    candidates = [candidate_at(stage, cost_at_initial_weights) for stage in fine]
    progress("wavefront", 3, 4)
    best = best_candidate(candidates).stage
    chosen_fit, term_groups, term_decisions = fit_selected_term_groups(
        best, _term_groups_at(best, allowed)
    )
    beam = stated_beam(chosen_fit.parameters, chosen_fit.dot_data, layout)
    final = last_fit(stage_with_beam(chosen_fit, beam), term_groups)
    progress("wavefront", 4, 4)
    misfit = misfit_of(final, term_groups)
    other_side = other_side_cost(final) if coarse.side_stated else math.nan
    settled = coarse.side_stated or _is_side_settled(every, candidates)
    covariance = covariance_of(final, term_groups)
    return WavefrontFit(
        dot_data=widen_beam(every, beam),
        stage=final,
        term_groups=term_groups,
        term_decisions=term_decisions,
        covariance=covariance,
        model_errors=model_errors_of(
            final, _term_groups_at(final, allowed), covariance
        ),
        undetermined_term_groups=undetermined_term_groups(
            final, term_groups, covariance
        ),
        side_settled=settled,
        other_side_cost=other_side,
        misfit=misfit,
    )


def _fine_dots(
    every: DotData, photographs: list[DotPhotograph], spectrum: Bands, dots: int
) -> DotData:
    """So many dots of each photograph, of large ones several rims.

    A part of a rim does not determine the position of its dot, a whole dot does: of one
    setting, where no other determines how coma moves dots, whole ones are kept.
    """
    if every.of_one_setting or all(one.take.rims is None for one in photographs):
        return select_dots(every, rows_spread_over_takes(every, dots))
    rims = dot_data_of(rim_patches(photographs), spectrum)
    rims = replace(rims, fall_offs=every.fall_offs)
    return select_dots(rims, rows_spread_over_takes(rims, _RIMS_PER_DOT * dots))


def _is_side_settled(every: DotData, candidates: list[Candidate]) -> bool:
    """Whether the side of focus of the chart is determined where statements do not
    determine it. Dots of one setting do not; and there is none if all takes were stated
    to be in focus."""
    if not every.of_one_setting:
        return is_side_determined(candidates)
    return bool(np.all(np.abs(stated_defocus_mm(every)) <= IN_FOCUS_MM))


def _candidates_after_middle(coarse: CoarseFit, few: DotData) -> list[Candidate]:
    """The candidates that smoothed dots do not exclude.

    Where higher orders shape the dots, third order does not determine which start is
    the best: the candidates that it rejected are tried in turn until one explains the
    dots, or several starts have ended in one lens.
    """
    found = [
        candidate_at(middle_fit(one.stage, coarse.term_groups))
        for one in coarse.candidates
    ]
    enough = _EXPLAINED * len(few.take) * (3 if few.colour else 1)
    for one in coarse.rejected:
        explained = min(candidate.cost for candidate in found) <= enough
        if explained or have_starts_agreed(found):
            break
        stage = solve_on_all_dots(one, few).stage
        found.append(candidate_at(middle_fit(stage, coarse.term_groups)))
    both_sides = not coarse.side_stated
    return open_candidates(found, _HOPELESS, _MOST_CANDIDATES, both_sides=both_sides)


def _pixel_candidates(
    middle: list[Candidate],
    more: DotData,
    allowed: Collection[str] | None,
    *,
    both_sides: bool,
) -> list[Stage]:
    """The candidates on full pixels of more dots.

    A few dots on full pixels show the way there, which of several candidates are alike
    and which are no lens; more dots would show the same, and take several times as
    long. Dots that a candidate has not seen tell most about it: those that predict them
    best go on.
    """

    def on_pixels(stage: Stage) -> Stage:
        stage = add_stated_distances(stage)
        return pixel_fit(stage, _term_groups_at(stage, allowed))

    def on_more(stage: Stage) -> Stage:
        stage = add_stated_distances(stage_on_dots(stage, more))
        return recentre_patches(stage)

    def chosen(
        stages: list[Stage], choose: _Choice, ratio: float, most: int
    ) -> list[Stage]:
        if len(stages) == 1:  # nothing to compare it with
            return stages
        found = [candidate_at(stage, cost_at_initial_weights) for stage in stages]
        return [one.stage for one in choose(found, ratio, most, both_sides=both_sides)]

    stages = [on_pixels(one.stage) for one in middle]
    stages = chosen(stages, open_candidates, _HOPELESS, _MOST_CANDIDATES)
    stages = [on_more(stage) for stage in stages]
    stages = chosen(stages, leading_candidates, DECISIVE, _MOST_ON_PIXELS)
    stages = [solve_stage(stage) for stage in stages]
    return chosen(stages, leading_candidates, _ALIKE, _MOST_ON_PIXELS)


def _term_groups_at(
    stage: Stage, allowed: Collection[str] | None
) -> tuple[TermGroup, ...]:
    """All term groups that may be free; priors of defocus depend on the start."""
    begun_mm = stage.mean[stage.layout.blocks["defocus"]]
    return candidate_term_groups(stage.dot_data, stage.layout, begun_mm, allowed)


def _layout_of(every: DotData) -> Layout:
    cylinders = every.dots.sections is not None
    terms = TERMS + CYLINDER_TERMS if cylinders else TERMS
    return Layout(
        terms,
        COLOUR_TERMS + CYLINDER_COLOURS if cylinders else COLOUR_TERMS,
        groups=max(_GROUPS, len(every.groups)),
        stops=max(_STOPS, len(every.f_numbers) - 1),
        focus_terms=terms_that_change_with_focus(terms),
        anamorphic=cylinders,
    )


def _notes(
    sign_known: bool,
    converged: bool,
    held_out_misfit: float,
    *,
    against: bool,
    mirrored: bool,
) -> tuple[str, ...]:
    notes = []
    if mirrored:
        notes.append(
            "the dots look as if they lay on the other side of focus than "
            "focus_distance_mm and target_distance_mm state: were those of near and "
            "far takes swapped?"
        )
    elif against:
        notes.append(
            "the blur was found on other sides of focus than focus_distance_mm and "
            "target_distance_mm state: if these are right, the blur is not to be "
            "relied on; photograph smaller holes, or more pixels"
        )
    elif not sign_known:
        notes.append(
            "the photographs do not determine on which side of focus the chart was: "
            "state focus_distance_mm and target_distance_mm, or add a take on the "
            "other side"
        )
    if not converged:
        notes.append("the fit of the dots' shape did not converge")
    if not held_out_misfit <= ROUGH_BLUR:
        known = np.isfinite(held_out_misfit)
        by = f" by {100 * held_out_misfit:.0f} %" if known else ""
        notes.append(
            f"the fit misses the dots' shape{by}: its blur is not to be used; look at "
            "the overlays, and stop down further or photograph smaller holes"
        )
    return tuple(notes)
