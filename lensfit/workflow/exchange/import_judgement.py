"""Whether a fitted preset is the lens that the file holds.

Distances are on the photograph, px. Half a pixel is what a compositor begins to see
between plate and CG. A fit that is several pixels off and leaves the half of what there
was to explain has failed: the preset would be another lens.
"""

from pathlib import Path

from lensfit.errors import ExchangeError
from lensfit.fitting.exchange.samples import Residual

_VISIBLE_PX = 0.5
_FAR_PX = 3.0
_UNEXPLAINED = 0.5
"""Part of the distortion (rms, after the squeeze) that a failed fit leaves."""


def refuse_failed_fit(
    state: str, left: Residual, distortion: Residual, path: Path
) -> None:
    """Nothing, where the fit explains the distortion at all.

    Parameters
    ----------
    left : How far the fitted lens is off.
    distortion : How far a lens without distortion, but with the squeeze, is off.

    Raises
    ------
    ExchangeError : The worst difference is above 3 px, and the rms above half of that
        of no distortion; or either is not a number.
    """
    near = left.worst_px <= _FAR_PX
    explained = left.rms_px <= _UNEXPLAINED * distortion.rms_px
    if near or explained:
        return
    raise ExchangeError(
        f"lensfit's terms cannot follow the distortion at {state}: {left}, where no "
        f"distortion at all would leave rms {distortion.rms_px:.2g} px",
        where=path,
        remedy="check that the file is whole, and the size and units that it states",
    )


def visible_notes(state: str, left: Residual, colour: Residual | None) -> list[str]:
    """A sentence for each that is worse than half a pixel somewhere."""
    known = {"distortion": left, "lateral colour": colour}
    return [
        f"the preset differs visibly from the file: {name} at {state}: {residual}"
        for name, residual in known.items()
        if residual is not None and residual.worst_px > _VISIBLE_PX
    ]
