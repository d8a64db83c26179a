"""Knobs of the pupil, which shapes lights out of focus.

They act alike on a measured lens and on an ideal one; `lensfit.preset.adjusted_pupil`
describes each. Energy is conserved: a light out of focus has the same energy whatever
its shape.
"""

from typing import Annotated

from msgspec import Meta, Struct

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
        Annotated[
            int,
            Meta(
                ge=0, le=16, description="Blades of the stop, 0 for round, or 3 or more"
            ),
        ]
        | None
    ) = None
    blade_rotation_deg: Annotated[
        float,
        Meta(
            ge=-360, le=360, description="Turns blades and filter image, deg clockwise"
        ),
    ] = 0.0
    roundness: (
        Annotated[
            float,
            Meta(ge=0, le=1, description="Of the blades: 0 straight, 1 round"),
        ]
        | None
    ) = None
    ring_brightness: Annotated[
        float,
        Meta(
            ge=-10,
            le=10,
            description="Lights out of focus brighter at the edge (> 0) or in the "
            "middle (< 0)",
        ),
    ] = 0.0
    squeeze: Annotated[
        float,
        Meta(
            ge=0.25, le=4, description="Height over width of lights out of focus (oval)"
        ),
    ] = 1.0
    cat_eye_gain: Annotated[
        float,
        Meta(ge=0, le=3, description="Gain of the rims that clip lights off the axis"),
    ] = 1.0
    cat_eye_percent: (
        Annotated[
            float,
            Meta(
                ge=0,
                le=90,
                description="Part of the pupil that a rim hides from the corner, "
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
            Meta(
                ge=0,
                le=100,
                description="Largest radius of blur, percent of the sensor's width",
            ),
        ]
        | None
    ) = None
    depth_levels: (
        Annotated[
            int,
            Meta(
                ge=2,
                le=1000,
                description="Levels of depth; by the tolerance if left out",
            ),
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
