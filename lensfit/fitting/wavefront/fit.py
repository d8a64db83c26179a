"""The wavefront of a lens at one focal length, from all its dot photographs at once.

The fit goes down as `descent` says, in every valley that is open yet (`multistart`);
what was learnt comes with its uncertainty. Takes of other focus distances share
everything but defocus: the lens only moves against the sensor (unit focusing), so the
same ray lands further out by the ratio of the principal distances.

A wavefront that explains its photographs says little of others where all were taken at
one f-number or on one side of focus: aberrations and defocus make up for each other
there, and part elsewhere.
"""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensfit.fitting.fall_off.fall_off_fit import FallOffFit
from lensfit.fitting.select import Verdict
from lensfit.fitting.wavefront.coarse import Coarse, coarse_fit, with_all_dots
from lensfit.fitting.wavefront.descent import (
    asked_for,
    fair_cost,
    fine_fit,
    last_fit,
    middle_fit,
    suits_other_side,
)
from lensfit.fitting.wavefront.dot_patches import Shown, with_rims
from lensfit.fitting.wavefront.effort import Effort
from lensfit.fitting.wavefront.gather import (
    Gathered,
    chosen,
    gather,
    spread_over_takes,
)
from lensfit.fitting.wavefront.misfit import Misfit, misfit_of
from lensfit.fitting.wavefront.multistart import (
    Valley,
    deepest,
    runs_against_statements,
    side_is_told,
    still_open,
    valley_at,
)
from lensfit.fitting.wavefront.parameters import Layout
from lensfit.fitting.wavefront.stages import Stage, focus_stated, on_dots
from lensfit.fitting.wavefront.start import IN_FOCUS_MM, stated_defocus_mm
from lensfit.fitting.wavefront.term_groups import Family, families_of
from lensfit.fitting.wavefront.uncertainty import (
    covariance_of,
    unseen,
    unshown_covariance_of,
)
from lensfit.kernel.blur_quality import ROUGH_BLUR
from lensfit.optics.spectrum import Bands, bands
from lensfit.optics.terms import (
    decentring_terms,
    rotational_terms,
    two_mirror_terms,
)
from lensfit.progress import Progress, silent


def guessed_of(gathered: Gathered) -> tuple[str, ...]:
    """One sentence for each kind of setting that nobody photographed."""
    return (*_at_other_stops(gathered), *_beyond_focus(gathered))


def _at_other_stops(gathered: Gathered) -> tuple[str, ...]:
    widest, *others = gathered.f_numbers
    if others:
        return ()
    if all(one.take.f_number is None for one in gathered.shown):
        return (
            "the blur holds for the stop that was photographed, which the preset calls "
            f"f/{widest:g} since nobody stated it: state f_number of each take",
        )
    return (
        f"the blur was photographed at f/{widest:g} alone and is guessed at other "
        "stops: photograph the dots at a second f-number",
    )


def _beyond_focus(gathered: Gathered) -> tuple[str, ...]:
    """By what was stated; where nothing was, the side of focus is in doubt itself."""
    stated_mm = stated_defocus_mm(gathered)
    if not np.isfinite(stated_mm).all():
        return ()
    near, far = np.any(stated_mm > IN_FOCUS_MM), np.any(stated_mm < -IN_FOCUS_MM)
    if near and far:
        return ()
    if not (near or far):
        return (
            "the blur was photographed in focus alone and is guessed out of focus: add "
            "takes focused nearer and farther than the chart",
        )
    return (
        "the blur was photographed on one side of focus alone and is guessed on the "
        "other: add takes focused on the other side of the chart",
    )


TERMS = rotational_terms(9) + decentring_terms()
COLOUR_TERMS = rotational_terms(5)
CYLINDER_TERMS = tuple(t for t in two_mirror_terms(5) if t not in TERMS)
CYLINDER_COLOURS = two_mirror_terms(1)
"""What a lens with cylinders has besides."""
_BEHIND_CYLINDERS = 2
"""Times as many dots in the fine stage: the field is not alike around the axis."""
_RIMS_FOR_A_DOT = 2
"""Times as many rims as dots: each shows one direction of the blur."""
_GROUPS, _STOPS = 8, 4
"""Room for so many defocus values and f-numbers, so that one program serves most."""
_HOPELESS, _VALLEYS = 1.2, 4
"""How much worse than the best a valley may be and go on to full pixels, and how many:
each takes as long as all that came before."""
_OTHERS_OF_ONE_SETTING = 2
"""Starts that have their turn after the promising ones where all photographs have one
setting: lenses that draw it alike are alike to whoever photographs there again."""
_SUSPECT = 0.08
"""Share of a dot's image, held out, from which on the other side of focus is tried:
where it was stated rightly a third of this is usual."""
_EXPLAINED = 4.0
"""Cost of a dot and channel, smoothed, up to which no other start is tried: a residual
of a tenth of the peak on one cell, or of a twentieth on four."""


@dataclass(frozen=True, eq=False)
class WavefrontFit:
    """What the photographs say about the wavefront.

    Attributes
    ----------
    gathered : Every dot.
    stage : The fit, on the dots it was made from.
    families : What is free.
    verdicts : What came of every family that was tried.
    covariance : Of all parameters that are free, as the scatter of dots has it.
    unshown_covariance : What is added to it in all that is stated: of what was left
        out, and of errors that no dot shows.
    unseen : Families that the photographs do not see.
    sign_known : Whether stated distances or the photographs settle the sign of defocus.
    mirrored : Whether the dots look as if they lay on the other side of focus than was
        stated; looked at only where they are ill explained.
    misfit : How far the images of dots are from those photographed.
    """

    gathered: Gathered
    stage: Stage
    families: tuple[Family, ...]
    verdicts: tuple[Verdict, ...]
    covariance: Float[np.ndarray, "parameters parameters"]
    unshown_covariance: Float[np.ndarray, "parameters parameters"]
    unseen: tuple[str, ...]
    sign_known: bool
    mirrored: bool
    misfit: Misfit

    @property
    def converged(self) -> bool:
        """Whether the last solve met its tolerance."""
        return self.stage.converged

    @property
    def stated_covariance(self) -> Float[np.ndarray, "parameters parameters"]:
        """Of all parameters."""
        return self.covariance + self.unshown_covariance

    @property
    def behind_mosaic(self) -> bool:
        """Whether photosites of one colour alone saw the shape of some dots."""
        return any(s.cutouts.mosaic is not None for s in self.gathered.shown)

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
        return (*said, *self.guessed)

    @property
    def guessed(self) -> tuple[str, ...]:
        """Which settings nobody photographed, in a sentence each."""
        return guessed_of(self.gathered)

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
    spectrum = spectrum or bands(3)
    every = gather(shown, spectrum)
    layout = _layout_of(every)
    few = chosen(every, spread_over_takes(every, effort.coarse_dots(len(shown))))
    coarse = coarse_fit(few, layout, fall_off, allowed)
    progress("wavefront", 1, 4)
    middle = _open_after_middle(coarse, few)
    progress("wavefront", 2, 4)
    times = _BEHIND_CYLINDERS if layout.anamorphic else 1
    fine_dots = times * effort.fine_dots(len(shown))
    more = _finest(every, shown, spectrum, fine_dots)
    stages = [focus_stated(on_dots(one.stage, more)) for one in middle]
    fine = [fine_fit(s, _families_at(s, allowed), effort.rounds) for s in stages]
    valleys = [valley_at(stage, fair_cost) for stage in fine]
    progress("wavefront", 3, 4)
    best = deepest(valleys).stage
    chosen_fit, families, verdicts = asked_for(best, _families_at(best, allowed))
    final = last_fit(chosen_fit, families)
    progress("wavefront", 4, 4)
    misfit = misfit_of(final, families)
    suspect = coarse.side_stated and not misfit.held_out_dots <= _SUSPECT
    mirrored = suspect and suits_other_side(best)
    against = mirrored or runs_against_statements(final)
    settled = coarse.side_stated or _side_is_settled(every, valleys)
    covariance = covariance_of(final, families)
    return WavefrontFit(
        gathered=every,
        stage=final,
        families=families,
        verdicts=verdicts,
        covariance=covariance,
        unshown_covariance=unshown_covariance_of(
            final, _families_at(final, allowed), covariance
        ),
        unseen=unseen(final, families, covariance),
        sign_known=settled and not against,
        mirrored=mirrored,
        misfit=misfit,
    )


def _finest(
    every: Gathered, shown: list[Shown], spectrum: Bands, dots: int
) -> Gathered:
    """So many dots of each photograph, of large ones several rims.

    A part of a rim leaves open where its dot is, a whole dot does not: of one setting,
    where no other says how coma moves dots, whole ones are kept.
    """
    if every.of_one_setting or all(one.take.rims is None for one in shown):
        return chosen(every, spread_over_takes(every, dots))
    rims = gather(with_rims(shown), spectrum)
    return chosen(rims, spread_over_takes(rims, _RIMS_FOR_A_DOT * dots))


def _side_is_settled(every: Gathered, valleys: list[Valley]) -> bool:
    """Whether it is known on which side of focus the chart was, where statements leave
    that open: dots of one setting do not tell it, and it is none if all were stated to
    be in focus."""
    if not every.of_one_setting:
        return side_is_told(valleys)
    return bool(np.all(np.abs(stated_defocus_mm(every)) <= IN_FOCUS_MM))


def _open_after_middle(coarse: Coarse, few: Gathered) -> list[Valley]:
    """The valleys that smoothed dots leave open.

    Where higher orders shape the dots, third order does not tell which start is the
    best: those that it put behind have their turn until one explains the dots.
    """
    found = [
        valley_at(middle_fit(one.stage, coarse.families)) for one in coarse.valleys
    ]
    enough = _EXPLAINED * len(few.take) * (3 if few.colour else 1)
    most = _OTHERS_OF_ONE_SETTING if few.of_one_setting else None
    for one in coarse.others[:most]:
        if min(valley.cost for valley in found) <= enough:
            break
        stage = with_all_dots(one, few).stage
        found.append(valley_at(middle_fit(stage, coarse.families)))
    if few.of_one_setting:
        return still_open(found, _HOPELESS, 1)
    both_sides = not coarse.side_stated
    return still_open(found, _HOPELESS, _VALLEYS, both_sides=both_sides)


def _families_at(stage: Stage, allowed: Collection[str] | None) -> tuple[Family, ...]:
    """All that may be free; priors of defocus depend on where the fit began."""
    begun_mm = stage.mean[stage.layout.blocks["defocus"]]
    return families_of(stage.gathered, stage.layout, begun_mm, allowed)


def _layout_of(every: Gathered) -> Layout:
    cylinders = every.dots.sections is not None
    return Layout(
        TERMS + CYLINDER_TERMS if cylinders else TERMS,
        COLOUR_TERMS + CYLINDER_COLOURS if cylinders else COLOUR_TERMS,
        groups=max(_GROUPS, len(every.groups)),
        stops=max(_STOPS, len(every.f_numbers) - 1),
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
            "focus_distance_mm and target_distance_mm say: were those of near and far "
            "takes swapped?"
        )
    elif against:
        notes.append(
            "the blur was found on other sides of focus than focus_distance_mm and "
            "target_distance_mm say: if these are right, the blur is not to be relied "
            "on; photograph smaller holes, or more pixels"
        )
    elif not sign_known:
        notes.append(
            "the photographs do not tell on which side of focus the chart was: state "
            "focus_distance_mm and target_distance_mm, or add a take on the other side"
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
