"""An ideal lens in place of a measured one: the thin lens of a CG renderer.

Such a renderer keeps its picture where the pinhole would put it: the image lies one
focal length behind the lens whatever the focus (no breathing), the opening is f/N, and
distances count from the lens. A point at z then blurs into a disc of diameter

    (f / N) f |1/z - 1/s|      (s the focus distance).

A real thin lens focused at s has its image at c = f' s / (s - f'). The preset states
the principal distance whose lens has that same blur, c f' = f^2, so that

    c = f^2 / 2s + sqrt(f^4 / 4s^2 + f^2),

and puts the entrance pupil at zero, so that distances count from the lens here too.
"""

import math
from datetime import UTC, datetime

from msgspec import Struct

from lensfit import __version__
from lensfit.errors import PresetError
from lensfit.preset.blocks import Camera, Distortion, FallOff, PositiveFloat, Projection
from lensfit.preset.entry import Entry, Quality
from lensfit.preset.schema import LensName, Preset, Provenance

_NEAREST_FOCUS = 20.0
"""In focal lengths: the nearest focus that the preset has an entry for."""


class ThinCamera(Struct, frozen=True):
    """A CG camera with a thin lens; keys that are not listed are ignored.

    Attributes
    ----------
    focus_distance_m : From the lens; may be infinite.
    width_px, height_px : Of the frame that spans the sensor width.
    """

    focal_length_mm: PositiveFloat
    f_number: PositiveFloat
    focus_distance_m: PositiveFloat
    sensor_width_mm: PositiveFloat
    width_px: int
    height_px: int
    aperture_blades: int = 0


def thin_lens_preset(camera: ThinCamera) -> Preset:
    """The preset of a lens without aberration, distortion or fall-off.

    Raises
    ------
    PresetError : The opening has blades: an ideal lens is round here.
    """
    if camera.aperture_blades:
        raise PresetError(
            f"aperture_blades = {camera.aperture_blades}: the ideal lens is round",
            remedy="state 0 blades, and turn them on with --blades",
        )
    f = camera.focal_length_mm
    height_mm = camera.sensor_width_mm * camera.height_px / camera.width_px
    radius_mm = math.hypot(camera.sensor_width_mm, height_mm) / 2
    stated = camera.focus_distance_m * 1000
    focuses = sorted({_NEAREST_FOCUS * f, stated, math.inf})
    return Preset(
        lens=LensName(f"thin lens {f:g} mm f/{camera.f_number:g}"),
        camera=Camera(
            None, camera.sensor_width_mm, height_mm, camera.width_px, camera.height_px
        ),
        entries=tuple(_entry(camera, focus_mm, radius_mm) for focus_mm in focuses),
        provenance=Provenance(
            created=datetime.now(UTC).isoformat(timespec="seconds"),
            lensfit_version=__version__,
            versions={},
            images=(),
        ),
    )


def _entry(camera: ThinCamera, focus_mm: float, radius_mm: float) -> Entry:
    f = camera.focal_length_mm
    half = f * f / (2 * focus_mm)
    no_loss = (0.0,)
    return Entry(
        focal_length_mm=f,
        focus_distance_mm=focus_mm,
        projection=Projection(
            principal_distance_mm=half + math.hypot(half, f),
            principal_point_mm=(0.0, 0.0),
            entrance_pupil_offset_mm=0.0,
            assumed=("principal_distance_mm", "entrance_pupil_offset_mm"),
        ),
        distortion=Distortion(
            base="rectilinear",
            reference_radius_mm=radius_mm,
            valid_radius=2.0,
            valid_box=(-2.0, -2.0, 2.0, 2.0),
        ),
        lateral_colour=None,
        fall_off=(FallOff(camera.f_number, 2 * radius_mm, no_loss, no_loss, no_loss),),
        terms=(),
        covariance=None,
        quality=Quality(0.0, None, 0, 0, 0),
    )
