"""The wavefront once marks have said how large its errors were.

Marks hardly speak of the shape of dots, so the wavefront is not solved again: it goes
along the errors that its own fit left open, which change the photographs least, and
keeps of its doubt what the marks leave. One error is added to those that the scatter of
dots shows, since what the model misses is alike in all dots: that all it says of drags
is wrong (`place.undoing`).
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from lensfit.fit.take import Take
from lensfit.fit.wavefront.fit import WavefrontFit, misfits
from lensfit.fit.wavefront.place import placed, undoing
from lensfit.fit.wavefront.stages import settled
from lensfit.fit.wavefront.uncertainty import parameter_moves

_AS_GOOD = 1.1
"""How much worse the shape of dots may be explained; at 1.5 the blur of dots below a
pixel was spoiled."""


def at_chief_rays(found: WavefrontFit) -> list[Take]:
    """The takes with marks where chief rays land, and how its errors move them."""
    moves = parameter_moves(found.stage, found.covariance)
    return placed(found.stage, found.gathered, moves)


def asking_marks(
    found: WavefrontFit, errors: Float[np.ndarray, "errors parameters"]
) -> list[Take]:
    """The same with how these errors move every mark."""
    return placed(found.stage, found.gathered, errors, exactly=True)


def errors_of(found: WavefrontFit) -> Float[np.ndarray, "errors parameters"]:
    """Its independent errors, and that all drags are wrong, first."""
    whole = undoing(found.stage, found.gathered)
    return np.concatenate([whole[None], parameter_moves(found.stage, found.covariance)])


def told_by_marks(
    found: WavefrontFit,
    errors: Float[np.ndarray, "errors parameters"],
    amounts: Float[np.ndarray, " errors"],
    covariance: Float[np.ndarray, "errors errors"],
) -> WavefrontFit | None:
    """The wavefront with so much of each error in it; None where that spoils how well
    it explains the shape of dots.

    Parameters
    ----------
    errors : As `errors_of` has them.
    covariance : Of the amounts.
    """
    parameters = found.stage.parameters + amounts @ errors
    stage = settled(replace(found.stage, parameters=parameters), 1)
    misfit, held_out = misfits(stage, found.families)
    worse = float(np.median(misfit)) / float(np.median(found.misfit))
    if not worse <= _AS_GOOD:
        return None
    before = np.diag([0.0, *np.ones(len(errors) - 1)])
    return replace(
        found,
        stage=stage,
        covariance=found.covariance + errors.T @ (covariance - before) @ errors,
        misfit=misfit,
        held_out_misfit=worse * found.held_out_misfit,
        held_out_takes=held_out,
    )
