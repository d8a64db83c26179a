"""Statements that the width of dots contradicts: focus distances, f-numbers, blur.

`diameter_px` of a dot is that of the disc of the same second moments V: D^2 = 16 V.
The moments of dot aperture, lens and defocus add. Three things follow:

- Of views of one target from one place at one f-number, the one that is in focus is the
  sharpest; and a focus distance s blurs a target at z by a disc of about
  f^2/N |1/z - 1/s|, whatever the lens.
- Of two f-numbers at one focus the parts that defocus adds are as 1/N^2, so the ratio
  of f-numbers follows from the widths in and out of focus; aberration mixes in with
  opposite signs on the two sides of focus, so both are averaged. A wrong f-number is
  wrong alike on both sides; those of two views exchanged, on one.
- Else, of two views at one focus, the one stopped further down can only be wider
  through motion or a turned focus ring.
"""

import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from lensfit.fitting.chart_view import View
from lensfit.units import dioptres_from_mm
from lensfit.workflow.statements.contradiction import Contradiction

_CENTRAL = 0.45
_FEWEST = 9
_WIDER_RATIO, _WIDER_PX = 1.35, 1.5
_STOP_RATIO, _ONE_SIDED_RATIO = 1.3, 1.5
"""Three quarters of a stop; with one side of focus only, more."""
_TWO_STOPS = 0.8
"""Most that one f-number is of another for their blur to differ."""
_ALIKE_RATIO = 1.6
"""Of the two sides of focus, which aberration parts."""
_LEAST_PX2 = 0.05
_SHARPER_RATIO = 1.04
_MANY_TIMES, _MANY_PX, _FEWEST_SHARP = 2.0, 1.0, 2
_OFF_LOG = 0.25
"""Engraved distances are good to some percent."""
_IN_FOCUS_DIOPTRES = 0.01


def unlikely_blur(takes: Sequence[View]) -> list[Contradiction]:
    """Views that are blurred, but for what a wrong f-number explains."""
    stops = {one.stated for one in contradicted_f_numbers(takes)}
    rest = [take for take in takes if take.f_number not in stops]
    return list(blurred_views(rest))


def unlikely_focus_distances(takes: Sequence[View]) -> Iterator[Contradiction]:
    """One where the sharpest views should be blurred over many times their width."""
    known = [
        (width, blur, take)
        for take in takes
        if (width := central_diameter_px(take)) and (blur := stated_blur_px(take))
    ]
    if len(known) < _FEWEST_SHARP:
        return
    known.sort(key=lambda one: one[0])
    sharpest = known[: max(_FEWEST_SHARP, len(known) // 3)]
    if not all(_is_too_sharp(width, blur, take) for width, blur, take in sharpest):
        return
    width, blur, take = sharpest[0]
    name, focus_mm = Path(take.name).stem, float(take.focus_distance_mm or 0)
    yield Contradiction(
        kind="side_of_focus",
        limit="undistortion",
        text=f"focus_distance_mm = {focus_mm:.4g} and target_distance_mm = "
        f"{take.target_distance_mm:.4g} of “{name}” would blur its dots to "
        f"{blur:.0f} px, but they are {width:.1f} px wide",
        remedy="check focus_distance_mm of all views, and its unit",
        statement="focus_distance_mm",
        stated=focus_mm,
        agrees_with=take.target_distance_mm,
        images=tuple(one.name for _, _, one in sharpest),
    )


def _is_too_sharp(width_px: float, blur_px: float, take: View) -> bool:
    """For a focus distance that is no engraving a few percent off."""
    focus, target = float(take.focus_distance_mm or 0), take.target_distance_mm or 1.0
    apart = abs(float(np.log(max(focus, 1e-3) / target)))
    return apart > _OFF_LOG and blur_px > _MANY_TIMES * width_px + _MANY_PX


def exchanged_focus_distances(takes: Sequence[View]) -> Iterator[Contradiction]:
    """Views stated out of focus that are sharper, at every f-number, than those that
    are stated in focus."""
    sharper: dict[float, list[tuple[float, View, View]]] = {}
    for one in takes:
        for two in takes:
            if not _is_in_focus(one) or _is_in_focus(two) or not _same_stop(one, two):
                continue
            mine, theirs = central_diameter_px(one), central_diameter_px(two)
            if mine is None or theirs is None or two.focus_distance_mm is None:
                continue
            ratios = sharper.setdefault(two.focus_distance_mm, [])
            ratios.append((mine / theirs, one, two))
    for focus_mm, found in sharper.items():
        ratios = [ratio for ratio, _, _ in found]
        if len(ratios) < 2 or min(ratios) < 1 or max(ratios) < _SHARPER_RATIO:
            continue
        _, blurred, sharp = max(found, key=lambda one: one[0])
        yield Contradiction(
            kind="side_of_focus",
            limit="look",
            text=f"focus_distance_mm of views are exchanged: “{Path(sharp.name).stem}”,"
            f" stated at {focus_mm:.4g} mm, is sharper than "
            f"“{Path(blurred.name).stem}”, stated in focus",
            remedy="check focus_distance_mm and image of every view",
            statement="focus_distance_mm",
            images=tuple(two.name for _, _, two in found),
        )
        return


def stated_blur_px(take: View) -> float | None:
    """Diameter of the disc that stated distances mean; None if they are not stated."""
    focus, target, stop = take.focus_distance_mm, take.target_distance_mm, take.f_number
    if focus is None or target is None or stop is None:
        return None
    apart = abs(1 / target - 1 / focus)
    return float(take.focal_length_mm**2 / stop * apart / take.pixel_mm[0])


def blurred_views(takes: Sequence[View]) -> Iterator[Contradiction]:
    """Views that are wider than another of the same target, focus and f-number."""
    widths = {id(take): central_diameter_px(take) for take in takes}
    named: set[str] = set()
    for take in takes:
        mine = widths[id(take)]
        for other in takes:
            theirs = widths[id(other)]
            if other is take or mine is None or theirs is None:
                continue
            wider = mine > _WIDER_RATIO * theirs and mine > theirs + _WIDER_PX
            if wider and take.name not in named and _no_wider(take, other):
                named.add(take.name)
                mine_name, other_name = Path(take.name).stem, Path(other.name).stem
                yield Contradiction(
                    kind="blurred_view",
                    limit="look",
                    text=f"“{mine_name}” is blurred: its dots are {mine:.1f} px wide, "
                    f"those of “{other_name}”, of the same target and focus, "
                    f"{theirs:.1f} px",
                    remedy=f"leave “{mine_name}” out or shoot it again, locked off and "
                    "focused as stated",
                    statement=f"focus_distance_mm of {mine_name}",
                    images=(take.name,),
                )


def central_diameter_px(take: View) -> float | None:
    """Median width of the bright dots near the middle of the frame."""
    seen = take.observations
    half = np.asarray(seen.image_size_px) / 2
    away = np.linalg.norm(seen.points_px - half, axis=1) / np.linalg.norm(half)
    diameter = seen.diameter_px[(away < _CENTRAL) & ~seen.overlapping]
    diameter = diameter[np.isfinite(diameter)]
    if not seen.bright or len(diameter) < _FEWEST:
        return None
    return float(np.median(diameter))


def f_number_ratios(
    takes: Sequence[View],
) -> dict[tuple[float, float], list[float]]:
    """For pairs of f-numbers, wide and narrow, their ratio by each side of focus."""
    ratios: dict[tuple[float, float], list[float]] = {}
    for one, two in _two_stops_out_of_focus(takes):
        added, less = _added_px2(one, takes), _added_px2(two, takes)
        if added is None or less is None or min(added, less) < _LEAST_PX2:
            continue
        pair = one.f_number or np.nan, two.f_number or np.nan
        ratios.setdefault(pair, []).append(float(np.sqrt(added / less)))
    return ratios


def _two_stops_out_of_focus(takes: Sequence[View]) -> Iterator[tuple[View, View]]:
    """Views that differ by their f-number alone: the wide one first."""
    for one, two in itertools.permutations(takes, 2):
        if not _same_focus(one, two) or not one.f_number or not two.f_number:
            continue
        if one.f_number < _TWO_STOPS * two.f_number and not _is_in_focus(one):
            yield one, two


def contradicted_f_numbers(takes: Sequence[View]) -> Iterator[Contradiction]:
    """F-numbers whose ratio is not that of the blur out of focus, else those that two
    views have exchanged."""
    yield from list(_contradicted_ratios(takes)) or _exchanged_f_numbers(takes)


def _exchanged_f_numbers(takes: Sequence[View]) -> Iterator[Contradiction]:
    """Of two views that differ by their f-number alone, each is blurred as is stated of
    the other. One that moved is wider, but makes the other no sharper."""
    for one, two in _two_stops_out_of_focus(takes):
        added, less = _added_px2(one, takes), _added_px2(two, takes)
        wide, narrow = stated_blur_px(one), stated_blur_px(two)
        if added is None or less is None or not wide or not narrow:
            continue
        if _changed_in_focus_px(one, two, takes) > wide:
            continue
        middle = wide * narrow  # halfway between both, and squared
        if _LEAST_PX2 < 16 * added < middle < 16 * less:
            yield _exchange_of_f_numbers(one, two)
            return


def _changed_in_focus_px(wide: View, narrow: View, takes: Sequence[View]) -> float:
    """Disc that aberration, or another cause, adds between two stops in focus; infinite
    where it is not seen. Nothing smaller is known to be defocus."""
    sharp = [
        [
            width
            for take in takes
            if _is_in_focus(take)
            and _same_place(take, one)
            and take.f_number == one.f_number
            and (width := central_diameter_px(take)) is not None
        ]
        for one in (wide, narrow)
    ]
    if not all(sharp):
        return np.inf
    return abs(min(sharp[0]) ** 2 - min(sharp[1]) ** 2) ** 0.5


def _exchange_of_f_numbers(wide: View, narrow: View) -> Contradiction:
    names = f"“{Path(wide.name).stem}” and “{Path(narrow.name).stem}”"
    return Contradiction(
        kind="f_number",
        limit="undistortion",
        text=f"f_number of {names} are exchanged: the view stated at "
        f"f/{narrow.f_number:g} is blurred as f/{wide.f_number:g} blurs, and the "
        "reverse",
        remedy="exchange f_number of both views, or their files",
        statement="f_number",
        stated=narrow.f_number,
        agrees_with=wide.f_number,
        images=(wide.name, narrow.name),
    )


def _contradicted_ratios(takes: Sequence[View]) -> Iterator[Contradiction]:
    for (wide, narrow), ratios in f_number_ratios(takes).items():
        mean = float(np.exp(np.mean(np.log(ratios))))
        off = mean / (narrow / wide)
        limit = _STOP_RATIO if len(ratios) > 1 else _ONE_SIDED_RATIO
        # One blurred view changes one side alone.
        alike = max(ratios) < _ALIKE_RATIO * min(ratios)
        if alike and max(off, 1 / off) > limit:
            yield f_number_contradiction(wide, narrow, wide * mean, takes)


def f_number_contradiction(
    wide: float, narrow: float, measured: float, takes: Sequence[View]
) -> Contradiction:
    """The record of a stop that is not as stated beside the widest."""
    images = tuple(take.name for take in takes if take.f_number == narrow)
    return Contradiction(
        kind="f_number",
        limit="undistortion",
        text=f"f/{narrow:g} is stated, but beside f/{wide:g} the blur out of focus "
        f"agrees with f/{measured:.1f}",
        remedy=f"check f_number of the views at f/{narrow:g} and f/{wide:g}",
        statement="f_number",
        stated=narrow,
        agrees_with=measured,
        images=images,
    )


def _added_px2(take: View, takes: Sequence[View]) -> float | None:
    """Variance that defocus adds to that in focus, where the sharpest view counts: one
    of them may have moved, and defocus is much wider than what a stop changes there."""
    blurred = central_diameter_px(take)
    sharp = [
        central_diameter_px(other)
        for other in takes
        if _is_in_focus(other)
        and other.target == take.target
        and other.focal_length_mm == take.focal_length_mm
    ]
    known = [one for one in sharp if one is not None]
    if blurred is None or not known:
        return None
    return (blurred**2 - min(known) ** 2) / 16


def _is_in_focus(take: View) -> bool:
    focus, target = take.focus_distance_mm, take.target_distance_mm
    if focus is None or target is None:
        return False
    return abs(dioptres_from_mm(focus) - dioptres_from_mm(target)) < _IN_FOCUS_DIOPTRES


def _same_place(one: View, other: View) -> bool:
    return (
        one.target == other.target
        and one.focal_length_mm == other.focal_length_mm
        and one.target_distance_mm == other.target_distance_mm
    )


def _same_focus(one: View, other: View) -> bool:
    """Whether two views differ by their f-number alone."""
    same = one.focus_distance_mm == other.focus_distance_mm
    return same and _same_place(one, other)


def _same_stop(one: View, other: View) -> bool:
    """Whether two views differ by their focus alone."""
    return one.f_number == other.f_number and _same_place(one, other)


def _no_wider(take: View, other: View) -> bool:
    """Whether a view cannot be wider than the other by what is stated."""
    if not _same_focus(take, other) or take.target_distance_mm is None:
        return False
    if take.f_number is None or other.f_number is None:
        return take.f_number == other.f_number
    return take.f_number >= 0.95 * other.f_number
