"""All states of a lens: one fit per focal length and focus distance.

Takes of one state share their geometry and colour; fall-off belongs to each f-number.
"""

from dataclasses import dataclass

import cv2
import jax
import numpy as np

from lensfit.errors import FitError
from lensfit.fit.chief_ray import ChiefRayFit, fit_chief_ray
from lensfit.fit.colour import ChannelColour, fit_colour
from lensfit.fit.geometry import distortion_of
from lensfit.fit.illumination import FallOffFit, fit_illumination
from lensfit.fit.take import Take, grouped
from lensfit.fit.uncertainty import Uncertainty, uncertainty_of
from lensfit.optics.base import BaseProjection
from lensfit.optics.distortion import Distortion, without_idle_degrees
from lensfit.progress import Progress, silent


@dataclass(frozen=True, eq=False)
class LensState:
    """Everything measured at one focal length and focus distance.

    Attributes
    ----------
    focal_length_mm, focus_distance_mm : As on the barrel.
    geometry : The chief-ray fit and its marks.
    distortion : Its lens.
    uncertainty : Of its parameters.
    colour : Red and blue against green; empty for monochrome photographs.
    fall_off : One for each f-number.
    """

    focal_length_mm: float
    focus_distance_mm: float | None
    geometry: ChiefRayFit
    distortion: Distortion
    uncertainty: Uncertainty
    colour: dict[str, ChannelColour]
    fall_off: list[FallOffFit]


@dataclass(frozen=True, eq=False)
class Fitted:
    """States that could be fitted, and why others could not, by take name."""

    states: tuple[LensState, ...]
    failed: dict[str, FitError]


def fit(takes: list[Take], progress: Progress = silent) -> Fitted:
    """Fit a lens to the marks of its photographs.

    Parameters
    ----------
    takes : One for each photograph; any number of focal lengths, focus distances and
        f-numbers of one lens.
    progress : Told how far it is.

    Raises
    ------
    FitError : No state could be fitted; otherwise failures come back with the rest.
        Or some takes of a focal length state their focus distance and others do not.
    """
    _require_like_focus(takes)
    states, failed = [], {}
    for group in grouped(takes):
        try:
            base = states[0].distortion.base if states else None
            states.append(_fit_state(group, takes, progress, base))
        except FitError as error:
            failed |= {take.name: error for take in group}
        except (ValueError, cv2.error) as error:
            reason = FitError(
                f"the fit broke down ({error})",
                where=group[0].name,
                remedy="look at the overlays for marks with wrong numbers",
            )
            failed |= {take.name: reason for take in group}
    if not states:
        raise next(iter(failed.values()), FitError("there are no photographs to fit"))
    return Fitted(tuple(states), failed)


def _require_like_focus(takes: list[Take]) -> None:
    for focal_mm in sorted({take.focal_length_mm for take in takes}):
        mine = [take for take in takes if take.focal_length_mm == focal_mm]
        silent_ones = [take for take in mine if take.focus_distance_mm is None]
        if silent_ones and len(silent_ones) < len(mine):
            raise FitError(
                f"no focus distance is stated, but other takes at {focal_mm:g} mm "
                "state theirs",
                where=silent_ones[0].name,
                remedy="add focus_distance_mm to every take of that focal length",
            )


_distortion_of = jax.jit(distortion_of, static_argnames=("layout",))


def _fit_state(
    group: list[Take],
    takes: list[Take],
    progress: Progress,
    base: BaseProjection | None,
) -> LensState:
    """`base` is that of the states before, so that states can be interpolated."""
    geometry = fit_chief_ray(group, progress, shown=takes, base=base)
    adjustment = geometry.adjustment
    layout = adjustment.layout
    shared = adjustment.parameters[: layout.shared]
    lens = _distortion_of(shared, layout, adjustment.frame)
    # On the host, where taking an array apart compiles nothing.
    distortion = without_idle_degrees(jax.device_get(lens))
    centre = np.asarray(distortion.principal_point_mm)
    radius = float(distortion.reference_radius_mm)
    return LensState(
        focal_length_mm=group[0].focal_length_mm,
        focus_distance_mm=group[0].focus_distance_mm,
        geometry=geometry,
        distortion=distortion,
        uncertainty=uncertainty_of(adjustment),
        colour=fit_colour(geometry.takes, centre, radius),
        fall_off=fit_illumination(geometry.takes, adjustment, centre),
    )
