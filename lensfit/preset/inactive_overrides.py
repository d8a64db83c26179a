"""Inactive overrides: knobs that have no effect on this lens, one sentence each.

A gain multiplies what was measured. If the lens has none of it (an ideal lens, one
whose blur was not photographed, an imported one) there is nothing to multiply, and the
picture stays as it is. The sentence names the knob that states an amount, or adds what
is lacking. A gain of zero has its full effect and is not reported.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from lensfit.lens import Lens
from lensfit.optics.lateral import ChannelShift
from lensfit.preset.adjusted_aberration import terms_of_group
from lensfit.preset.adjusted_vignetting import photographed_parts
from lensfit.preset.knob_groups import (
    BLUR_TERM_GROUPS,
    LEAST_BLADES,
    AberrationKnobs,
    BokehKnobs,
)

_GAIN = "_gain"
_UNITS = {"distortion": "_percent", "vignetting": "_stops"}
_CHROMATIC = ("lateral_red", "lateral_blue", "axial_colour")
_PARTS = ("natural_vignetting", "optical_vignetting", "mechanical_vignetting")
_CALLED = {
    "chromatic": "colour error",
    "lateral_red": "lateral colour of red",
    "lateral_blue": "lateral colour of blue",
    "axial_colour": "axial colour",
    "field_curvature": "field curvature",
    "astigmatism_sagittal": "astigmatism",
    "astigmatism_tangential": "astigmatism",
    "coma": "coma",
    "spherical": "spherical aberration",
    "other_aberrations": "trefoil or other aberrations",
    "distortion": "distortion",
    "natural_vignetting": "natural vignetting",
    "optical_vignetting": "optical vignetting",
    "mechanical_vignetting": "mechanical vignetting",
}


class InactiveOverride(NamedTuple):
    """A knob that has no effect.

    Attributes
    ----------
    name : Of the knob.
    lacking : What is not there, as a clause.
    remedies : Knobs that would add some.
    """

    name: str
    lacking: str
    remedies: tuple[str, ...]

    def __str__(self) -> str:
        *first, last = (f"--{name.replace('_', '-')}" for name in self.remedies)
        options = f"{', '.join(first)} or {last}" if first else last
        return f"{self.name} has no effect: {self.lacking}; {options} adds some"


def inactive_overrides(
    lens: Lens,
    aberration: AberrationKnobs,
    bokeh: BokehKnobs,
    *,
    blur_is_known: bool = True,
) -> tuple[InactiveOverride, ...]:
    """Knobs that have no effect on this lens.

    Parameters
    ----------
    lens : As it was measured.
    blur_is_known : False for a lens whose blur was measured, at an f-number that nobody
        knows: its aberrations and its pupil are then not checked.
    """
    if aberration == AberrationKnobs() and bokeh == BokehKnobs():
        return ()
    has = _has_chief_rays(lens, aberration) | _has_parts(lens, aberration, bokeh)
    if blur_is_known:
        has |= _has_aberrations(lens, aberration)
        has["chromatic"] = _is_in(lens, "chromatic") or any(map(has.get, _CHROMATIC))
    found = [
        InactiveOverride(
            f"{name}{_GAIN}",
            f"the preset has no {_CALLED[name]}",
            knobs_that_state(name),
        )
        for name, is_there in has.items()
        if not is_there and _is_adjusted(aberration, f"{name}{_GAIN}")
    ]
    return (
        (*found, *_inactive_pupil_overrides(lens, bokeh))
        if blur_is_known
        else tuple(found)
    )


def knobs_that_state(name: str) -> tuple[str, ...]:
    """Knobs that state how much there is of an aberration."""
    if name == "chromatic":
        return tuple(knob for one in _CHROMATIC for knob in knobs_that_state(one))
    unit = next((u for end, u in _UNITS.items() if name.endswith(end)), "_um")
    return (name + unit,)


def _is_adjusted(knobs: AberrationKnobs | BokehKnobs, name: str) -> bool:
    return getattr(knobs, name) not in (0, 1)


def _is_stated(knobs: AberrationKnobs, name: str) -> bool:
    """Whether an amount is stated, even of none: a gain multiplies that."""
    return any(getattr(knobs, knob) is not None for knob in knobs_that_state(name))


def _has_chief_rays(lens: Lens, knobs: AberrationKnobs) -> dict[str, bool]:
    d, lateral = lens.distortion, lens.lateral_colour or (None, None)
    bent = any(np.any(np.asarray(one)) for one in (d.radial, d.named, d.free))
    return {
        "distortion": bent or _is_stated(knobs, "distortion"),
        "lateral_red": _moves(lateral[0]) or _is_stated(knobs, "lateral_red"),
        "lateral_blue": _moves(lateral[1]) or _is_stated(knobs, "lateral_blue"),
    }


def _moves(shift: ChannelShift | None) -> bool:
    return shift is not None and any(
        np.any(np.asarray(one))
        for one in (shift.radial, shift.shift_mm, shift.strain, shift.decentering)
    )


def _has_parts(
    lens: Lens, aberration: AberrationKnobs, bokeh: BokehKnobs
) -> dict[str, bool]:
    """Parts of the fall-off that are requested; a stated rim hides light by itself."""
    if not any(_is_adjusted(aberration, f"{part}{_GAIN}") for part in _PARTS):
        return {}
    return {
        part: photographed
        or _is_stated(aberration, part)
        or (part == "optical_vignetting" and bool(bokeh.cat_eye_percent))
        for part, photographed in zip(_PARTS, photographed_parts(lens), strict=True)
    }


def _has_aberrations(lens: Lens, knobs: AberrationKnobs) -> dict[str, bool]:
    return {n: _is_stated(knobs, n) or _is_in(lens, n) for n in BLUR_TERM_GROUPS}


def _is_in(lens: Lens, name: str) -> bool:
    return lens.blur is not None and bool(terms_of_group(lens.blur.aberration, name))


def _inactive_pupil_overrides(
    lens: Lens, knobs: BokehKnobs
) -> Iterator[InactiveOverride]:
    pupil = None if lens.blur is None else lens.blur.pupil
    blades = knobs.blades or 0
    if knobs.blades is None and knobs.filter_image is None and pupil is not None:
        blades = float(pupil.blades)
    if blades < LEAST_BLADES:
        clause = "the pupil has no blades"
        if knobs.blade_rotation_deg != 0 and knobs.filter_image is None:
            yield InactiveOverride(
                "blade_rotation_deg", clause, ("blades", "filter_image")
            )
        if knobs.roundness is not None:
            yield InactiveOverride("roundness", clause, ("blades",))
    has_rims = pupil is not None and pupil.rim_shift.size > 0
    if (
        _is_adjusted(knobs, "cat_eye_gain")
        and not has_rims
        and knobs.cat_eye_percent is None
    ):
        clause = "the preset has no rims that clip lights"
        yield InactiveOverride("cat_eye_gain", clause, ("cat_eye_percent",))
