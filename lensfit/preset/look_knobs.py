"""Knobs of effects that no chart photograph shows: filters, glass, white balance.

An effect is off while its gain is 0, whatever else of it is set. Sizes are percent of
the width of the frame, so that a proxy looks like the full plate; thresholds are
scene-linear. `lensfit.rendering.look` describes each effect and its energy balance.
"""

from typing import Annotated

from msgspec import Meta, Struct

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
        float,
        Meta(ge=0, le=10, description="Growth of the size with the blur of the light"),
    ] = 1.0
    glint_gain: Annotated[
        Share, Meta(description="Share of the light above the threshold in streaks")
    ] = 0.0
    glint_threshold: Annotated[
        Threshold, Meta(description="Brightest channel from which light glints")
    ] = 4.0
    glint_streaks: Annotated[
        int, Meta(ge=1, le=64, description="Streaks of each light")
    ] = 6
    glint_length_percent: Annotated[
        float, Meta(ge=0.1, le=50, description="Length of a streak of green light")
    ] = 10.0
    glint_rotation_deg: Annotated[
        Angle, Meta(description="Azimuth of one streak, from right towards down")
    ] = 0.0
    glint_dispersion: Annotated[
        float,
        Meta(ge=0, le=5, description="Growth with wavelength, 1 as diffraction has it"),
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
    ghost_count: Annotated[
        int, Meta(ge=1, le=16, description="Ghosts of each highlight")
    ] = 3
    ghost_reach: Annotated[
        float,
        Meta(
            ge=-2, le=2, description="Place of the last, 1 mirrored through the centre"
        ),
    ] = 1.0
    ghost_size_percent: Annotated[
        float, Meta(ge=0.1, le=50, description="Diameter of the last ghost")
    ] = 8.0
    ghost_tint: Annotated[
        float, Meta(ge=-1, le=1, description="Colour of ghosts: 1 green, -1 magenta")
    ] = 0.0
    white_balance_kelvin: Annotated[
        float,
        Meta(ge=1700, le=25000, description="Light that is white; more is warmer"),
    ] = 6500.0
    white_balance_tint: Annotated[
        float, Meta(ge=-150, le=150, description="Green light counts as white: magenta")
    ] = 0.0
