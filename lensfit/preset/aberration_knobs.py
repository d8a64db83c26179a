"""Knobs that scale, remove or replace the measured aberrations.

A gain multiplies the measured amount: 1 leaves it, 0 turns it off. A value with a unit
replaces it (None leaves it), with higher orders in proportion; gains multiply that too.
`lensfit.preset.adjusted_lens` describes the effect of each knob.

- ``_um`` of a blur: rms radius of the spot that this aberration alone makes, at the
  place of the field where that is largest and at the widest aperture (of an ideal lens:
  at its f-number). Focal surfaces and axial colour are positive where light is focused
  in front of the sensor; coma and spherical as their terms in `optics.terms`.
- ``lateral_*_um``: largest displacement over the field against green, outwards.
- ``_stops``: loss of light at the edge of the field, in stops.

The edge of the field is the sensor's corner.
"""

from typing import Annotated

from msgspec import Meta, Struct

BLUR_FAMILIES = (
    "axial_colour",
    "field_curvature",
    "astigmatism_sagittal",
    "astigmatism_tangential",
    "coma",
    "spherical",
    "other_aberrations",
)
"""Aberrations that shape the blur; each has a gain and an amount in um."""


def _gain(of: str, least: float = -100.0, most: float = 100.0) -> Meta:
    return Meta(ge=least, le=most, description=f"Gain of {of}: 0 none, 1 as measured")


def _instead(of: str, unit: str, least: float, most: float) -> Meta:
    return Meta(ge=least, le=most, description=f"{of} in place of the measured, {unit}")


def _spot(of: str) -> Meta:
    return _instead(of, "um of spot radius (rms)", -1000.0, 1000.0)


def _stops(of: str) -> Meta:
    return _instead(of, "stops at the edge of the field", 0.0, 20.0)


class AberrationKnobs(
    Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True, kw_only=True
):
    """Knobs of the aberrations; neutral as they stand here.

    Attributes
    ----------
    chromatic_gain : Of everything that depends on colour.
    lateral_red_gain, lateral_blue_gain : Of where red and blue land.
    axial_colour_gain : Of what focus changes with colour.
    field_curvature_gain : Of the medial focal surface, from its place on the axis.
    astigmatism_sagittal_gain, astigmatism_tangential_gain : Of the sagittal and the
        tangential focal surface, from the medial one.
    coma_gain, spherical_gain : All orders, and at all colours.
    other_aberrations_gain : Trefoil, oblique spherical and whatever is left.
    distortion_gain : Of every coefficient of the map, which has an inverse for any.
    natural_vignetting_gain : Foreshortening of the pupil.
    optical_vignetting_gain : The rims of the barrel; see cat_eye_gain for their shape.
    mechanical_vignetting_gain : The rest of what was photographed.
    """

    chromatic_gain: Annotated[float, _gain("all that depends on colour")] = 1.0
    lateral_red_gain: Annotated[float, _gain("lateral colour of red")] = 1.0
    lateral_blue_gain: Annotated[float, _gain("lateral colour of blue")] = 1.0
    axial_colour_gain: Annotated[float, _gain("axial colour")] = 1.0
    field_curvature_gain: Annotated[float, _gain("field curvature")] = 1.0
    astigmatism_sagittal_gain: Annotated[float, _gain("sagittal astigmatism")] = 1.0
    astigmatism_tangential_gain: Annotated[float, _gain("tangential astigmatism")] = 1.0
    coma_gain: Annotated[float, _gain("coma")] = 1.0
    spherical_gain: Annotated[float, _gain("spherical aberration")] = 1.0
    other_aberrations_gain: Annotated[float, _gain("trefoil and the rest")] = 1.0
    distortion_gain: Annotated[float, _gain("distortion", -10.0, 10.0)] = 1.0
    natural_vignetting_gain: Annotated[float, _gain("natural vignetting", 0.0)] = 1.0
    optical_vignetting_gain: Annotated[float, _gain("optical vignetting", 0.0)] = 1.0
    mechanical_vignetting_gain: Annotated[
        float, _gain("mechanical vignetting", 0.0)
    ] = 1.0

    lateral_red_um: (
        Annotated[
            float,
            _instead(
                "Displacement of red", "um outwards, the largest", -5000.0, 5000.0
            ),
        ]
        | None
    ) = None
    lateral_blue_um: (
        Annotated[
            float,
            _instead(
                "Displacement of blue", "um outwards, the largest", -5000.0, 5000.0
            ),
        ]
        | None
    ) = None
    axial_colour_um: Annotated[float, _spot("Axial colour")] | None = None
    field_curvature_um: Annotated[float, _spot("Field curvature")] | None = None
    astigmatism_sagittal_um: Annotated[float, _spot("Sagittal astigmatism")] | None = (
        None
    )
    astigmatism_tangential_um: (
        Annotated[float, _spot("Tangential astigmatism")] | None
    ) = None
    coma_um: Annotated[float, _spot("Coma")] | None = None
    spherical_um: Annotated[float, _spot("Spherical aberration")] | None = None
    other_aberrations_um: Annotated[float, _spot("Trefoil and the rest")] | None = None
    distortion_percent: (
        Annotated[
            float,
            _instead("Distortion", "percent of the radius at its edge", -60.0, 60.0),
        ]
        | None
    ) = None
    natural_vignetting_stops: Annotated[float, _stops("Natural vignetting")] | None = (
        None
    )
    optical_vignetting_stops: Annotated[float, _stops("Optical vignetting")] | None = (
        None
    )
    mechanical_vignetting_stops: (
        Annotated[float, _stops("Mechanical vignetting")] | None
    ) = None
