"""The wavefront of every focal length, from dot images at all its focus distances.

Usable are bright and dark dots of known size (by their rims if they are wider than the
blur), checker corners (by their crossing edges) and lines of known width. Wide dots and
corners take longer to fit than small dots, and are used only if there are no small
dots. A line shows the blur across itself alone: lines are used only if nothing else was
photographed, and at more than one setting.

The f-number is the unit of the pupil, and thus of defocus. If no photograph states it,
an assumed value describes the photographed setting equally well, as long as tilted
charts do not extend too far in depth; other settings then remain unknown.
"""

from collections.abc import Collection
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lensfit.detect.observations import Observations
from lensfit.fitting.chart_view import View
from lensfit.fitting.lens_state import LensState, states_by_focal_length
from lensfit.fitting.wavefront.adjusted_wavefront import refit_without_centroid_bias
from lensfit.fitting.wavefront.dot_data import (
    PhotographedFallOff,
    dot_data_of,
    farthest_point_rows,
    unfitted_dot_data,
)
from lensfit.fitting.wavefront.dot_patches import (
    LARGEST_DOT_APERTURE_CELLS,
    LARGEST_RAY_SAMPLED_CELLS,
    DotPhotograph,
    are_of_one_setting,
    dot_aperture_radius_cells,
)
from lensfit.fitting.wavefront.effort import Effort
from lensfit.fitting.wavefront.fit import WavefrontFit, fit_wavefront
from lensfit.fitting.wavefront.start_values import sharp_f_number
from lensfit.optics.spectrum import bands
from lensfit.progress import Progress

_TOO_LARGE = (
    "the dots themselves are too large: photograph dots less than 1.8 pixels wide"
)
_UNDETERMINED = (
    "the points leave the lens undetermined: photograph more of them, at two f-numbers"
)
_LINES_OF_ONE_SETTING = (
    "lines of one setting show too little of it: photograph them at two f-numbers, in "
    "focus, nearer and farther"
)
_LEFT_OUT = "effort none leaves it out"
_ENOUGH_OF_ONE_SETTING = 8
_ASSUMED_F_NUMBER = 4.0
"""The smallest f-number to assume if none is stated."""


class LensWavefronts(NamedTuple):
    """Wavefronts, by focal length in mm.

    Attributes
    ----------
    fitted : Where dots could be used.
    without : Why they could not, for the other focal lengths, and the remedy.
    takes_with_wide_dots : Views whose dots were too wide and left out.
    """

    fitted: dict[float, WavefrontFit]
    without: dict[float, str]
    takes_with_wide_dots: dict[float, list[str]]


def fit_wavefronts(
    states: list[LensState],
    progress: Progress,
    effort: Effort,
    allowed: Collection[str] | None,
) -> LensWavefronts:
    """Fit a wavefront for each focal length whose dots can be used."""
    if effort is Effort.NONE:
        return LensWavefronts(
            {}, dict.fromkeys(states_by_focal_length(states), _LEFT_OUT), {}
        )
    found = LensWavefronts({}, {}, {})
    for focal_mm, mine in states_by_focal_length(states).items():
        known = any(t.f_number for state in mine for t in state.geometry.takes)
        assumed = None if known else _ASSUMED_F_NUMBER
        pictured = [s for state in mine for s in _dot_photographs(state, assumed)]
        usable = _usable_photographs(pictured) or _usable_lines(pictured, mine)
        photographs = _subset_of_one_setting(usable)
        if photographs and not known:
            photographs = _stopped_down(photographs)
        if not photographs:
            why = _reason_without_blur(pictured, mine)
            if why:
                found.without[focal_mm] = why
            continue
        kept = {s.take.name for s in usable}
        names = [one.take.name for one in pictured if _shows_dots(one)]
        found.takes_with_wide_dots[focal_mm] = [
            name for name in names if name not in kept
        ]
        try:
            fitted = fit_wavefront(
                photographs,
                _fall_offs(mine),
                progress,
                effort=effort,
                allowed=allowed,
            )
            if fitted.dot_data.of_one_setting:
                fitted = refit_without_centroid_bias(fitted)
            found.fitted[focal_mm] = _with_unfitted_lines(fitted, photographs, pictured)
        except np.linalg.LinAlgError:
            found.without[focal_mm] = _UNDETERMINED
        except ValueError as error:
            found.without[focal_mm] = f"the dots' shape could not be fitted ({error})"
    return found


def _usable_photographs(pictured: list[DotPhotograph]) -> list[DotPhotograph]:
    """The photographs that can be used: those of charts of small holes; where there are
    none, of broad dots and checker corners.

    A chart is one of small holes if any photograph shows them small. They may be wider
    in others, which count as much: what is small in the coarse cells of a wide blur is
    broad in focus.
    """
    corners = [one for one in pictured if one.take.observations.are_corners]
    dots = [one for one in pictured if _shows_dots(one)]
    sized = [(one, dot_aperture_radius_cells(one)) for one in dots]
    small = {
        one.take.target for one, cells in sized if cells <= LARGEST_RAY_SAMPLED_CELLS
    }
    broad = [one for one, cells in sized if cells <= LARGEST_DOT_APERTURE_CELLS]
    of_small = [one for one in broad if one.take.target in small]
    return of_small or [*broad, *corners]


def _usable_lines(
    pictured: list[DotPhotograph], states: list[LensState]
) -> list[DotPhotograph]:
    """The photographs of lines, where nothing else was photographed, at more than one
    setting: lines of one setting show too little to move their chief rays by."""
    lines = [one for one in pictured if one.take.observations.are_lines]
    if _saw_dots(states) or are_of_one_setting(lines):
        return []
    return lines


def _with_unfitted_lines(
    fitted: WavefrontFit, used: list[DotPhotograph], pictured: list[DotPhotograph]
) -> WavefrontFit:
    """The fit to some photographs with those of lines, if it was made without."""
    lines = [one for one in pictured if one.take.observations.are_lines]
    if not lines or any(one.take.observations.are_lines for one in used):
        return fitted
    return replace(fitted, unfitted=unfitted_dot_data(fitted.dot_data, lines, bands(3)))


def _shows_dots(photograph: DotPhotograph) -> bool:
    return not photograph.take.observations.are_edges


def _subset_of_one_setting(photographs: list[DotPhotograph]) -> list[DotPhotograph]:
    """Of many photographs of one setting those that look least alike: more of them
    say the same again."""
    if len(photographs) <= _ENOUGH_OF_ONE_SETTING or not are_of_one_setting(
        photographs
    ):
        return photographs
    looks = np.array([_frame_coverage(one.take) for one in photographs])
    rows = farthest_point_rows(
        looks, np.arange(len(photographs)), _ENOUGH_OF_ONE_SETTING
    )
    return [photographs[k] for k in rows]


def _frame_coverage(view: View) -> Float[np.ndarray, "4"]:
    """Mean position and spread of its detections, as shares of the frame."""
    seen = view.observations.points_px / np.asarray(view.observations.image_size_px)
    return np.concatenate([seen.mean(0), 2 * seen.std(0)])


def _stopped_down(photographs: list[DotPhotograph]) -> list[DotPhotograph]:
    """The photographs with an assumed f-number that is consistent with their blur."""
    f_number = round(sharp_f_number(dot_data_of(photographs, bands(3))), 1)
    return [one._replace(f_number=f_number) for one in photographs]


def _reason_without_blur(pictured: list[DotPhotograph], states: list[LensState]) -> str:
    """Why no photograph can be used, and the remedy; empty where there are neither dots
    nor lines."""
    if any(_shows_dots(one) for one in pictured):
        return _TOO_LARGE
    if _saw_dots(states):
        return "state hole_diameter_mm of the dots, which are blurred to their middle"
    if pictured:
        return _LINES_OF_ONE_SETTING
    if any(one.are_lines for one in _observations_of(states)):
        return "state line_width_mm of the lines, whose edges blur hides"
    return ""


def _saw_dots(states: list[LensState]) -> bool:
    """Whether dots were photographed, of known diameter or not."""
    return any(np.isfinite(one.diameter_px).any() for one in _observations_of(states))


def _observations_of(states: list[LensState]) -> list[Observations]:
    return [view.observations for state in states for view in state.geometry.takes]


def _dot_photographs(
    state: LensState, assumed_f_number: float | None
) -> list[DotPhotograph]:
    """The photographs of a state whose dots or corners can be fitted."""
    colour = None
    if state.colour:
        colour = state.colour["r"].optics(), state.colour["b"].optics()
    return [
        DotPhotograph(
            view,
            view.dot_images,
            state.geometry,
            state.distortion,
            colour,
            k,
            state.pupil.offset_mm,
            f_number,
        )
        for k, view in enumerate(state.geometry.takes)
        if view.dot_images is not None
        and (view.mark_diameter_mm is not None or view.observations.are_corners)
        if (f_number := view.f_number or assumed_f_number) is not None
    ]


def _fall_offs(states: list[LensState]) -> tuple[PhotographedFallOff, ...]:
    """One for every f-number, the widest first."""
    found = {}
    for state in states:
        for one in state.fall_off:
            if one.f_number is not None and one.f_number not in found:
                c_mm = float(state.distortion.principal_distance_mm)
                found[one.f_number] = PhotographedFallOff(one.f_number, c_mm, one)
    return tuple(found[f_number] for f_number in sorted(found))
