"""Plates and a preset for the tests of `lensfit apply`."""

import numpy as np

from lensfit.coords import Window
from lensfit.io.exr import ExrImage, ExrPart, write_exr
from lensfit.plate.apply_options import ApplyOptions
from lensfit.preset.blocks import (
    Camera,
    ChannelShift,
    Distortion,
    FallOff,
    LateralColour,
    Projection,
)
from lensfit.preset.entry import Entry, Quality
from lensfit.preset.schema import LensName, Preset, Provenance
from lensfit.rendering.render_stages import Switches

DISPLAY = Window.of_size(96, 64)
DATA = Window(-8, -6, 103, 69)
CAMERA = {"lens/focal": 35.0, "lens/fstop": 2.8, "lens/focus": 2.0}
SENSOR = {"lens/aperture": 36.0}


def make_preset(*focal_lengths_mm, stops=(2.8,)):
    def entry(focal_length_mm):
        return Entry(
            focal_length_mm=focal_length_mm,
            focus_distance_mm=2000.0,
            projection=Projection(focal_length_mm, (0.1, -0.1), 50.0),
            distortion=Distortion(
                base="rectilinear",
                reference_radius_mm=21.6,
                valid_radius=1.5,
                valid_box=(-1.5, -1.5, 1.5, 1.5),
                radial_log_slope=(-0.2 * 35 / focal_length_mm,),
            ),
            lateral_colour=LateralColour(
                ChannelShift((4e-3,), (0.0, 0.0), 1.5),
                ChannelShift((-4e-3,), (0.0, 0.0), 1.5),
            ),
            fall_off=tuple(
                FallOff(stop, 21.6, (0.2, 0.6), (0.2, 0.6), (0.2, 0.6))
                for stop in stops
            ),
            terms=(),
            covariance=None,
            quality=Quality(0.02, 0.02, 100, 100, 1),
        )

    return Preset(
        lens=LensName("Test 35"),
        camera=Camera(None, 36.0, 24.0, 960, 640),
        entries=tuple(entry(f) for f in focal_lengths_mm or (35.0,)),
        provenance=Provenance("2025-01-01T00:00:00+00:00", "0.1.0", {}, ()),
    )


def scene(window):
    x, y = np.moveaxis(window.pixel_centres(), -1, 0)
    planes = [np.sin(x / 7), np.cos(y / 6), np.sin((x + y) / 9)]
    return (1.2 + 0.5 * np.stack(planes, -1)).astype(np.float32)


def write_plate(path, attributes=None, extra=None, window=DATA, name=""):
    rgb = scene(window)
    channels = {n: rgb[..., i].copy() for i, n in enumerate("RGB")}
    channels["A"] = np.ones(rgb.shape[:2], np.float32)
    channels |= extra or {}
    header = {**CAMERA, **SENSOR} if attributes is None else attributes
    part = ExrPart(channels, window, DISPLAY, header, name=name)
    write_exr(path, ExrImage((part,)))
    return path


def sharp(**changes) -> ApplyOptions:
    """Options for plates without depth: no depth of field, and otherwise these."""
    return ApplyOptions(**{"switches": Switches(defocus=False), **changes})
