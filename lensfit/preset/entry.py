"""One entry of a preset: the lens at one focal length and focus distance.

An entry holds the blocks that make the lens, the decision on every candidate term with
its reason, the covariance of the fitted parameters and the quality of the fit.
"""

import math
from typing import Annotated

from msgspec import Meta, Struct

from lensfit.preset.blocks import (
    Blur,
    Covariance,
    Distortion,
    FallOff,
    LateralColour,
    PositiveFloat,
    Projection,
)

Count = Annotated[int, Meta(ge=0)]


class Term(Struct, frozen=True, forbid_unknown_fields=True):
    """One term of the model that was tried.

    Attributes
    ----------
    name : Of the term.
    kept : Whether it is part of the lens.
    value, standard_deviation : In `unit`; None for a term of several numbers.
    unit : "mm", "rad", "px"; "" for a plain number.
    reason : Why it was kept or left, one sentence.
    """

    name: str
    kept: bool
    value: float | None
    standard_deviation: float | None
    unit: str
    reason: str


class Quality(Struct, frozen=True, forbid_unknown_fields=True):
    """How good the entry is.

    Attributes
    ----------
    rms_px : Reprojection error over the points that were fitted.
    held_out_rms_px : The same over points the fit had not seen; None if none were kept.
    points_detected, points_used, photographs : What it rests on.
    largest_standard_deviation_px : Of the predicted position, over the frame.
    round_trip_px : Largest error of undistorting and redistorting, frame and overscan.
    """

    rms_px: Annotated[float, Meta(ge=0)]
    held_out_rms_px: Annotated[float, Meta(ge=0)] | None
    points_detected: Count
    points_used: Count
    photographs: Count
    largest_standard_deviation_px: float | None = None
    round_trip_px: float | None = None


class Entry(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The lens at one focal length and focus distance.

    Attributes
    ----------
    focal_length_mm : As on the barrel.
    focus_distance_mm : From the sensor plane, as on the barrel; "inf" in the file when
        infinite, null when nobody said.
    lateral_colour : None when none was measured or none was found.
    fall_off : One for each f-number that was measured, widest first; may be empty.
    covariance : Of the numbers of the chief-ray fit that are not known exactly, terms
        that it left out included, named and counted as in
        `lensfit.preset.lens_of_entry`; None if unknown.
    blur : None when it was not measured.
    """

    focal_length_mm: PositiveFloat
    focus_distance_mm: PositiveFloat | None
    projection: Projection
    distortion: Distortion
    lateral_colour: LateralColour | None
    fall_off: tuple[FallOff, ...]
    terms: tuple[Term, ...]
    covariance: Covariance | None
    quality: Quality
    blur: Blur | None = None

    def __str__(self) -> str:
        focus = self.focus_distance_mm
        if focus is None:
            return f"{self.focal_length_mm:g} mm"
        at = "infinity" if math.isinf(focus) else f"{focus:g} mm"
        return f"{self.focal_length_mm:g} mm focused at {at}"
