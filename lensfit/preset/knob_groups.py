"""The knobs by what they adjust: measured aberrations, the pupil, the look.

Aberrations are scaled, removed or replaced. A gain multiplies the measured amount: 1
leaves it, 0 turns it off. A value with a unit replaces it (None leaves it), with higher
orders in proportion; gains multiply that too. `lensfit.preset.adjusted_lens` describes
the effect of each knob.

- ``_um`` of a blur: rms radius of the spot that this aberration alone makes, at the
  place of the field where that is largest and at the widest aperture (of an ideal lens:
  at its f-number). Focal surfaces and axial colour are positive where light is focused
  in front of the sensor; coma and spherical as their terms in `optics.terms`.
- ``lateral_*_um``: largest displacement over the field against green, outwards.
- ``_stops``: loss of light at the edge of the field, in stops.

The edge of the field is the sensor's corner.

The pupil shapes lights out of focus. Its knobs act alike on a measured lens
and on an ideal one; `lensfit.preset.adjusted_pupil` describes each. Energy is
conserved: a light out of focus has the same energy whatever its shape.

The look has effects that no chart photograph shows: filters, glass, white balance. An
effect is off while its gain is 0, whatever else of it is set. Sizes are percent of
the width of the frame, so that a proxy looks like the full plate; thresholds are
scene-linear. `lensfit.rendering.look` describes each effect and its energy balance.
"""

from typing import Annotated

from msgspec import Meta, Struct

BLUR_TERM_GROUPS = (
    "axial_colour",
    "field_curvature",
    "astigmatism_sagittal",
    "astigmatism_tangential",
    "coma",
    "spherical",
    "other_aberrations",
)
"""Aberrations that shape the blur; each has a gain and an amount in um."""


def _within(least: float, most: float, description: str) -> Meta:
    return Meta(ge=least, le=most, description=description)


def _gain(of: str, least: float = -100.0, most: float = 100.0) -> Meta:
    return _within(least, most, f"Gain of {of}: 0 none, 1 as measured")


def _instead(of: str, unit: str, least: float, most: float) -> Meta:
    return _within(least, most, f"{of} in place of the measured, {unit}")


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


LEAST_BLADES = 3
"""Fewer are round."""


class BokehKnobs(
    Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True, kw_only=True
):
    """Knobs of the opening; neutral as they stand here.

    Attributes
    ----------
    blades : At every f-number, their opening of the same area as a round one; 0 is
        round, 1 and 2 enclose nothing and are refused. None as measured.
    blade_rotation_deg : Turns blades and filter image, clockwise as the picture shows
        them beyond the focus distance.
    roundness : Of the blades; None as measured.
    ring_brightness : b > 0 makes the light (1 + b) q^2b at the share q of the way from
        the middle to the edge: 1 + b times the mean at the edge; b < 0 makes it
        (1 + |b|) (1 - q^2)^|b|: as much in the middle.
    squeeze : Height over width of a light out of focus; its area stays.
    cat_eye_gain : A point sees the rims of the barrel as if it were so many times
        farther from the axis: 0 leaves the round opening, and takes away the optical
        vignetting too.
    cat_eye_percent : In place of the measured rims, one that hides this share of the
        widest opening from the sensor's corner.
    filter_image : Picture of the opening's transmission, in place of its blades; its
        larger side is the diameter of the stop. Upright beyond the focus distance, and
        turned by half a turn before it.
    maximum_blur_percent : Largest radius that depth may blur to, in percent of the
        sensor's width; None leaves it to the plate's depth.
    depth_levels : Levels that a plate's depth is cut into, evenly in blur; None leaves
        it to the tolerance.
    """

    blades: (
        Annotated[int, _within(0, 16, "Blades of the stop, 0 for round, or 3 or more")]
        | None
    ) = None
    blade_rotation_deg: Annotated[
        float, _within(-360, 360, "Turns blades and filter image, deg clockwise")
    ] = 0.0
    roundness: (
        Annotated[float, _within(0, 1, "Of the blades: 0 straight, 1 round")] | None
    ) = None
    ring_brightness: Annotated[
        float,
        _within(
            -10,
            10,
            "Lights out of focus brighter at the edge (> 0) or in the middle (< 0)",
        ),
    ] = 0.0
    squeeze: Annotated[
        float, _within(0.25, 4, "Height over width of lights out of focus (oval)")
    ] = 1.0
    cat_eye_gain: Annotated[
        float, _within(0, 3, "Gain of the rims that clip lights off the axis")
    ] = 1.0
    cat_eye_percent: (
        Annotated[
            float,
            _within(
                0,
                90,
                "Part of the pupil that a rim hides from the corner, "
                "in place of the measured, percent",
            ),
        ]
        | None
    ) = None
    filter_image: (
        Annotated[
            str, Meta(description="EXR or PNG that lights out of focus look like")
        ]
        | None
    ) = None
    maximum_blur_percent: (
        Annotated[
            float,
            _within(0, 100, "Largest radius of blur, percent of the sensor's width"),
        ]
        | None
    ) = None
    depth_levels: (
        Annotated[
            int, _within(2, 1000, "Levels of depth; by the tolerance if left out")
        ]
        | None
    ) = None

    def __post_init__(self) -> None:
        """Run by the reader of files, too, which names the file and the knob's group.

        Raises
        ------
        ValueError : There are blades, and too few to enclose an opening.
        """
        if self.blades is not None and 0 < self.blades < LEAST_BLADES:
            raise ValueError(
                f"blades is {self.blades}; an aperture has no blades (0) or at least "
                f"{LEAST_BLADES}"
            )


Share = Annotated[float, Meta(ge=0, le=1)]
Threshold = Annotated[float, Meta(ge=0, le=1e6)]
HaloSize = Annotated[float, Meta(ge=0.01, le=20)]
Angle = Annotated[float, Meta(ge=-360, le=360)]


class LookKnobs(
    Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True, kw_only=True
):
    """Knobs of the look; neutral as they stand here."""

    bloom_gain: Annotated[
        Share, Meta(description="Share of the light above the threshold that blooms")
    ] = 0.0
    bloom_threshold: Annotated[
        Threshold, Meta(description="Brightest channel from which light blooms")
    ] = 1.0
    bloom_size_percent: Annotated[
        HaloSize, Meta(description="Radius that holds half of the bloom, in focus")
    ] = 1.0
    bloom_growth: Annotated[
        float, _within(0, 10, "Growth of the size with the blur of the light")
    ] = 1.0
    glint_gain: Annotated[
        Share, Meta(description="Share of the light above the threshold in streaks")
    ] = 0.0
    glint_threshold: Annotated[
        Threshold, Meta(description="Brightest channel from which light glints")
    ] = 4.0
    glint_streaks: Annotated[int, _within(1, 64, "Streaks of each light")] = 6
    glint_length_percent: Annotated[
        float, _within(0.1, 50, "Length of a streak of green light")
    ] = 10.0
    glint_rotation_deg: Annotated[
        Angle, Meta(description="Azimuth of one streak, from right towards down")
    ] = 0.0
    glint_dispersion: Annotated[
        float, _within(0, 5, "Growth with wavelength, 1 as diffraction has it")
    ] = 1.0
    pro_mist_gain: Annotated[
        Share, Meta(description="Share of all light that a mist filter scatters")
    ] = 0.0
    pro_mist_size_percent: Annotated[
        HaloSize, Meta(description="Radius that holds half of the scattered light")
    ] = 3.0
    diffusion_gain: Annotated[
        Share, Meta(description="Share of all light that softens detail")
    ] = 0.0
    diffusion_size_percent: Annotated[
        HaloSize, Meta(description="Radius that holds half of the softened light")
    ] = 0.3
    ghost_gain: Annotated[
        Share, Meta(description="Light of all ghosts over that of their highlight")
    ] = 0.0
    ghost_threshold: Annotated[
        Threshold, Meta(description="Brightest channel from which light throws ghosts")
    ] = 4.0
    ghost_count: Annotated[int, _within(1, 16, "Ghosts of each highlight")] = 3
    ghost_reach: Annotated[
        float, _within(-2, 2, "Place of the last, 1 mirrored through the centre")
    ] = 1.0
    ghost_size_percent: Annotated[
        float, _within(0.1, 50, "Diameter of the last ghost")
    ] = 8.0
    ghost_tint: Annotated[
        float, _within(-1, 1, "Colour of ghosts: 1 green, -1 magenta")
    ] = 0.0
    white_balance_kelvin: Annotated[
        float, _within(1700, 25000, "Light that is white; more is warmer")
    ] = 6500.0
    white_balance_tint: Annotated[
        float, _within(-150, 150, "Green light counts as white: magenta")
    ] = 0.0
