"""The wavefront of every focal length, from the dots of all its focus states.

Only small bright holes show it: printed dots are wider than the blur, and dark ones
hide what a lens makes of a point.
"""

from collections.abc import Collection

import numpy as np

from lensfit.detect.observations import POINT
from lensfit.fit.fall_off.fall_off_fit import FallOffFit
from lensfit.fit.lens_state import LensState, by_focal_length
from lensfit.fit.take import Take
from lensfit.fit.wavefront.effort import Effort
from lensfit.fit.wavefront.fit import WavefrontFit, fit_wavefront
from lensfit.fit.wavefront.shown import LARGEST_HOLE_CELLS, Shown, hole_cells
from lensfit.progress import Progress


def fit_wavefronts(
    states: list[LensState],
    progress: Progress,
    effort: Effort,
    allowed: Collection[str] | None,
) -> tuple[dict[float, WavefrontFit], dict[float, str]]:
    """One for each focal length whose dots can be used, and why others cannot be."""
    found: dict[float, WavefrontFit] = {}
    without: dict[float, str] = {}
    for focal_mm, mine in by_focal_length(states).items():
        pictured = [s for state in mine for s in _shown_of(state)]
        shown = [s for s in pictured if hole_cells(s) <= LARGEST_HOLE_CELLS]
        if pictured and not shown:
            without[focal_mm] = (
                "the dots themselves are too large; photograph holes less than 1.8 "
                "pixels wide"
            )
        if not shown:
            unsaid = "" if pictured else _unsaid(mine)
            without |= {focal_mm: unsaid} if unsaid else {}
            continue
        try:
            found[focal_mm] = fit_wavefront(
                shown,
                _widest_fall_off(mine),
                progress,
                effort=effort,
                allowed=allowed,
            )
        except (ValueError, np.linalg.LinAlgError) as error:
            without[focal_mm] = f"the dots' shape could not be fitted ({error})"
    return found, without


def _unsaid(states: list[LensState]) -> str:
    """Why no dot's shape could be fitted, where bright dots were photographed, which
    holes might have made; nothing else ever shows it."""
    takes = [take for state in states for take in state.geometry.takes]
    dots = [t for t in takes if t.observations.bright and _has_dots(t)]
    if not dots:
        return ""
    unsaid = {
        "hole_diameter_mm": all(take.mark_diameter_mm is None for take in dots),
        "f_number": all(take.f_number is None for take in dots),
    }
    keys = " and ".join(key for key, missing in unsaid.items() if missing)
    return f"state {keys} of the dots, if they are holes lit from behind" * bool(keys)


def _has_dots(take: Take) -> bool:
    return bool(np.any(take.observations.family == POINT))


def shows_blur(take: Take) -> bool:
    """Whether its dots were pictured, and through which opening is known."""
    return take.cutouts is not None and take.f_number is not None


def _shown_of(state: LensState) -> list[Shown]:
    """The photographs of a state whose dots show the lens' blur."""
    colour = None
    if state.colour:
        colour = state.colour["r"].optics(), state.colour["b"].optics()
    return [
        Shown(
            take,
            take.cutouts,
            state.geometry,
            state.distortion,
            colour,
            k,
            state.pupil.offset_mm,
        )
        for k, take in enumerate(state.geometry.takes)
        if take.cutouts is not None and take.f_number is not None
    ]


def _widest_fall_off(states: list[LensState]) -> FallOffFit | None:
    known = [
        (fall_off.f_number, k, fall_off)
        for k, state in enumerate(states)
        for fall_off in state.fall_off
        if fall_off.f_number is not None
    ]
    return min(known)[-1] if known else None
