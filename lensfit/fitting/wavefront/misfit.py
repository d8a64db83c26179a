"""How far the images of dots are from those photographed, seen by the fit or not.

Relative errors of a dot's image: the root of the squares of what is left over that of
the image's own, so that 0.05 is an error of a twentieth.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lensfit.fitting.wavefront.dot_weights import relative_misfit
from lensfit.fitting.wavefront.held_out import held_out_dots, held_out_take
from lensfit.fitting.wavefront.stages import Stage
from lensfit.fitting.wavefront.term_groups import Family


class Misfit(NamedTuple):
    """Relative errors of dots' images.

    Attributes
    ----------
    of_take : Median of each take.
    held_out_dots : Median of takes, for dots the fit did not see.
    held_out_take : Of each take if the fit had not seen it; None where the other takes
        do not determine the fit.
    """

    of_take: Float[np.ndarray, " takes"]
    held_out_dots: float
    held_out_take: tuple[float | None, ...]

    @property
    def median(self) -> float:
        """Of the takes."""
        return float(np.median(self.of_take))


def misfit_of(stage: Stage, families: tuple[Family, ...]) -> Misfit:
    """Where a solve ended, in retrospect."""
    each = relative_misfit(stage.gathered, stage.residual, stage.nuisance[..., 1])
    takes = range(len(stage.gathered.shown))
    of_take = np.array([np.nanmedian(each[stage.gathered.take == k]) for k in takes])
    ratios = [
        held_out_take(stage, families, k) if len(takes) > 1 else None for k in takes
    ]
    return Misfit(
        of_take,
        float(np.median(of_take)) * held_out_dots(stage, families),
        tuple(
            None if ratio is None else ratio * float(now)
            for ratio, now in zip(ratios, of_take, strict=True)
        ),
    )
