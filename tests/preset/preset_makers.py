"""Presets for tests, small and with every block in use."""

from typing import Any

import msgspec
import numpy as np

from lensfit.preset.blocks import (
    AberrationTerm,
    Blur,
    Camera,
    ChannelShift,
    Covariance,
    Distortion,
    FallOff,
    FreeField,
    LateralColour,
    Projection,
    Pupil,
    Rim,
    Stop,
)
from lensfit.preset.entry import Entry, Quality, Term
from lensfit.preset.schema import LensName, Preset, Provenance, SourceImage


def make_entry(**changes: Any) -> Entry:
    """A 50 mm lens focused at 2 m; `changes` replace top-level keys."""
    entry = Entry(
        focal_length_mm=50.0,
        focus_distance_mm=2000.0,
        projection=Projection(51.3, (0.1, -0.2), 60.0, ("principal_distance_mm",)),
        distortion=Distortion(
            base="rectilinear",
            reference_radius_mm=15.6,
            valid_radius=1.02,
            valid_box=(-0.8, -0.6, 0.8, 0.6),
            radial_log_slope=(-0.1, 1 / 3, 1e-17),
            decentering=(1e-4, -2e-4, 0.0, 0.0),
            squeeze=1.9,
            squeeze_axis_rad=0.01,
            field=FreeField(3, (1e-5, 2e-5, 3e-5, 4e-5), (0.0, 0.0, 0.0, 1e-6)),
        ),
        lateral_colour=LateralColour(
            ChannelShift((1e-4, -3e-4), (0.0, 0.0), 1.02),
            ChannelShift((-2e-4,), (0.001, 0.0), 1.02),
        ),
        fall_off=(
            FallOff(1.4, 15.9, (0.1, 0.9), (0.1, 1.0), (0.1, 1.1)),
            FallOff(2.8, 15.9, (0.0, 0.3), (0.0, 0.3), (0.0, 0.3)),
        ),
        terms=(
            Term("radial a1", True, -0.1, 1e-5, "", "held-out error fell by 0.2 px"),
            Term("thin prism", False, None, None, "", "BIC rose by 12"),
        ),
        covariance=Covariance.from_matrix(
            ("a1", "a2"), np.array([[4e-10, 1e-10], [1e-10, 9e-10]])
        ),
        quality=Quality(0.021, 0.023, 1900, 1890, 4, 0.03, 1e-11),
    )
    return msgspec.structs.replace(entry, **changes)


def make_blur(**changes: Any) -> Blur:
    """An f/1.4 lens of a few micrometres, with two rims and seven blades."""
    blur = Blur(
        aberrations=(
            AberrationTerm(2, 0, 2, 0, "re", 9.0, (1.5, -0.5)),
            AberrationTerm(3, 1, 1, 1, "re", -4.0),
            AberrationTerm(4, 0, 0, 0, "re", 3.0, (0.5, 0.1)),
        ),
        field_radius_mm=15.6,
        reference_sine=0.35,
        exit_pupil_distance_mm=62.0,
        chief_bend=0.02,
        pupil_magnification=1.2,
        reference_distance_mm=2000.0,
        focus_offset_mm=0.01,
        pupil=Pupil(
            rims=(Rim((0.5, 0.1), (1.1, 0.0)), Rim((-0.5, 0.0), (1.2, 0.01))),
            stop_shift=(0.01, 0.002),
            stretch_along=(-0.08, 0.01),
            stretch_across=(-0.03, 0.005),
            squeeze=1.0,
            blades=7,
            blade_rotation_rad=0.3,
            blade_curvature=0.4,
        ),
        stops=(Stop(1.4, 1.01), Stop(2.8, 0.98)),
        band_centres_nm=(605.0, 538.0, 462.0),
        band_widths_nm=(25.0, 27.0, 24.0),
        round_f_number=1.4,
        assumed=("pupil_magnification",),
    )
    return msgspec.structs.replace(blur, **changes)


def make_preset(*entries: Entry) -> Preset:
    """A preset of these entries, or of one `make_entry`."""
    return Preset(
        lens=LensName("SMC Takumar 50/1.4", "1234567"),
        camera=Camera(None, 24.89, 18.6675, 2048, 1536),
        entries=entries or (make_entry(),),
        provenance=Provenance(
            created="2025-01-31T12:00:00+00:00",
            lensfit_version="0.1.0",
            versions={"jax": "0.8.0", "numpy": "2.3.0"},
            images=(SourceImage("dots.exr", "ab" * 32, "fit"),),
        ),
    )
