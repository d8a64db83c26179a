"""The wavefront once marks have said how large its errors were.

Marks hardly speak of the shape of dots. So the wavefront goes along the errors that its
own fit left open, which change the photographs least, and keeps of its doubt what the
marks leave. One error is added to those that the scatter of dots shows, since what the
model misses is alike in all dots: that all its centroid biases are wrong (`undoing`).
Then the shape of dots is fitted anew as far as that leaves the biases where marks put
them.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from lensfit.fitting.joint_adjustment import Amounts
from lensfit.fitting.take import Take
from lensfit.fitting.wavefront.centroid_biases import (
    moves_of_marks_mm,
    slight_moves_of_marks_mm,
)
from lensfit.fitting.wavefront.constrained_refit import reshaped, undoing
from lensfit.fitting.wavefront.fit import WavefrontFit
from lensfit.fitting.wavefront.misfit import misfit_of
from lensfit.fitting.wavefront.place import moving_together, placed
from lensfit.fitting.wavefront.stages import settled
from lensfit.fitting.wavefront.uncertainty import parameter_moves

_AS_GOOD = 1.1
"""How much worse the shape of dots may be explained."""


def at_chief_rays(found: WavefrontFit) -> list[Take]:
    """The takes with marks where chief rays land, and how its errors move them."""
    stage, gathered = found.stage, found.gathered
    moves = parameter_moves(stage, found.stated_covariance)
    moves_mm = slight_moves_of_marks_mm(stage, gathered, moves)
    return moving_together(placed(stage, gathered), stage, gathered, moves_mm)


def moved_by(
    takes: list[Take],
    found: WavefrontFit,
    errors: Float[np.ndarray, "errors parameters"],
) -> list[Take]:
    """The same (`takes`) with how these errors, of whatever size, move every mark."""
    stage, gathered = found.stage, found.gathered
    moves_mm = moves_of_marks_mm(stage, gathered, errors)
    return moving_together(takes, stage, gathered, moves_mm)


def errors_of(found: WavefrontFit) -> Float[np.ndarray, "errors parameters"]:
    """That all centroid biases are wrong, and then its independent errors."""
    whole = undoing(found.stage, found.gathered)
    return np.concatenate([whole[None], parameter_moves(found.stage, found.covariance)])


def keeping_centroids(found: WavefrontFit) -> WavefrontFit:
    """The wavefront of one setting with centroids where chief rays land, where dots are
    explained as well so.

    Marks of other settings would show how far coma moves a centroid: those of one lie
    on a smooth map wherever it moves them. The map without it is what was measured.
    """
    whole = undoing(found.stage, found.gathered)[None]
    kept = told_by_marks(found, whole, Amounts(np.ones(1), np.zeros((1, 1))))
    return found if kept is None else kept


def told_by_marks(
    found: WavefrontFit,
    errors: Float[np.ndarray, "errors parameters"],
    said: Amounts,
) -> WavefrontFit | None:
    """The wavefront with so much of each error in it; None where that spoils how well
    it explains the shape of dots.

    Parameters
    ----------
    errors : As `errors_of` has them.
    said : How much of each.
    """
    stage = found.stage
    told = replace(stage, parameters=stage.parameters + said.value @ errors)
    stage = reshaped(settled(told), found.gathered)
    # A move too far leads where rays miss the patches, and nothing is defined.
    numbers = (stage.parameters, *stage.equations)
    if not all(np.isfinite(part).all() for part in numbers):
        return None
    misfit = misfit_of(stage, found.families)
    worse = misfit.median / found.misfit.median
    if not worse <= _AS_GOOD:
        return None
    # In retrospect the halves of a fit go to minima of their own, which fixed biases
    # forbid: what dots that it did not see cost it is what it was.
    misfit = misfit._replace(held_out_dots=worse * found.misfit.held_out_dots)
    before = np.diag([0.0, *np.ones(len(errors) - 1)])
    return replace(
        found,
        stage=stage,
        covariance=found.covariance + errors.T @ (said.covariance - before) @ errors,
        misfit=misfit,
    )
