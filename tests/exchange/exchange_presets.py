"""Lenses for exchange: a zoom of two focal lengths, and one nobody else can hold."""

import msgspec

from lensfit.preset.blocks import (
    Camera,
    ChannelShift,
    Distortion,
    FallOff,
    FreeField,
    LateralColour,
    Projection,
)
from lensfit.preset.entry import Entry, Quality
from lensfit.preset.schema import LensName, Preset, Provenance

SIZE_PX = (640, 480)
SENSOR_MM = (24.0, 18.0)


def make_entry(focal_mm: float = 50.0, focus_mm: float = 2000.0, **changes) -> Entry:
    """A barrel of some pixels, with lateral colour and fall-off at two stops."""
    known = dict(
        focal_length_mm=focal_mm,
        focus_distance_mm=focus_mm,
        projection=Projection(focal_mm * 1.02, (0.1, -0.2), 60.0),
        distortion=Distortion(
            base="rectilinear",
            reference_radius_mm=15.0,
            valid_radius=1.2,
            valid_box=(-1.0, -0.8, 1.0, 0.8),
            radial_log_slope=(-2.0 / focal_mm, 0.02),
            decentering=(2e-4, -1e-4),
        ),
        lateral_colour=LateralColour(
            ChannelShift((1e-4, 2e-4), (0.0, 0.0), 1.2, (1e-5, 2e-5), (1e-5, 0.0)),
            ChannelShift((-2e-4, 1e-4), (0.001, 0.0), 1.2),
        ),
        fall_off=(
            FallOff(1.4, 15.5, (0.1, 0.6), (0.1, 0.6), (0.1, 0.6)),
            FallOff(4.0, 15.5, (0.02, 0.1), (0.02, 0.1), (0.02, 0.1)),
        ),
        terms=(),
        covariance=None,
        quality=Quality(0.02, 0.02, 100, 100, 1),
    )
    return Entry(**(known | changes))


def make_preset(*entries: Entry) -> Preset:
    return Preset(
        lens=LensName("Test 50/1.4", "42"),
        camera=Camera("Camera", *SENSOR_MM, *SIZE_PX),
        entries=entries or (make_entry(),),
        provenance=Provenance("2025-01-31T12:00:00+00:00", "0.1.0", {}, ()),
    )


def make_lopsided() -> Preset:
    """A free field that no other program's model has."""
    entry = make_entry()
    field = FreeField(3, (0.0, 4e-4, 0.0, 0.0), (0.0, 0.0, 5e-4, 0.0))
    return make_preset(
        msgspec.structs.replace(
            entry, distortion=msgspec.structs.replace(entry.distortion, field=field)
        )
    )
