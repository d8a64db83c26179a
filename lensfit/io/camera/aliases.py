"""Which header entries tell the camera: the alias table.

For each quantity the entries that are understood, the most trustworthy first, with the
factor to lensfit's unit. A project adds its own under ``[aliases]`` of its settings
file (`lensfit.plate.camera.settings`); they count before these.

OpenEXR 3.2   the standard's lens attributes; ``focus`` is metres
CG headers    ``lens/focal``, ``lens/fstop``, ``lens/focus`` (metres), ``lens/aperture``
              (the sensor's width), ``lens/overscan`` (percent)
Nuke          ``nuke/camera/...``, as text (Foundry's developer guide)
V-Ray         ``cameraFocalLength``, ``cameraFNumber``, ``cameraAperture`` (film width;
              with the field of view they agree in headers of versions 3 and 4)
EXIF 2.3      photographs

Looked at and left out: V-Ray's ``cameraTargetDistance`` (units of a scene that the
header does not tell); Redshift's ``rs/camera/fov`` and ``rs/camera/aperture`` (its
manual says radians, scripts in use read degrees, and some take the aperture as inches);
Arnold and RenderMan, which write matrices and no lens; Karma and Mantra, which write no
camera unless told to: tell them ``lens/focal`` and the others.
"""

from typing import NamedTuple

from lensfit.units import MILLIMETRES_PER_METRE


class Alias(NamedTuple):
    """An entry, and what its number is multiplied by.

    Attributes
    ----------
    of_pinhole : A focal length of the pinhole with the picture's angle of view, rather
        than as on the barrel or the zoom ring.
    """

    key: str
    factor: float = 1.0
    of_pinhole: bool = False


SENSOR_WIDTH_KEY = "lens/aperture"
"""Width of what the frame spans, mm: the standard has the whole sensor alone."""

ALIASES: dict[str, tuple[Alias, ...]] = {
    "focal_length_mm": (
        Alias("nominalFocalLength"),
        Alias("lens/focal"),
        Alias("FocalLength"),
        Alias("pinholeFocalLength", of_pinhole=True),
        Alias("effectiveFocalLength", of_pinhole=True),
        Alias("nuke/camera/focal", of_pinhole=True),
        Alias("cameraFocalLength", of_pinhole=True),
    ),
    "f_number": (
        Alias("aperture"),
        Alias("lens/fstop"),
        Alias("cameraFNumber"),
        Alias("fnumber"),
        Alias("FNumber"),
    ),
    "t_number": (Alias("tStop"),),
    "focus_distance_mm": (
        Alias("focus", MILLIMETRES_PER_METRE),
        Alias("lens/focus", MILLIMETRES_PER_METRE),
        Alias("SubjectDistance", MILLIMETRES_PER_METRE),
    ),
    "sensor_width_mm": (
        Alias(SENSOR_WIDTH_KEY),
        Alias("nuke/camera/haperture"),
        Alias("cameraAperture"),
    ),
    "sensor_height_mm": (Alias("nuke/camera/vaperture"),),
    "overscan_percent": (Alias("lens/overscan"),),
    "camera_model": (Alias("cameraModel"), Alias("Model")),
    "lens_model": (Alias("lensModel"), Alias("LensModel")),
    "lens_serial": (Alias("lensSerialNumber"), Alias("LensSerialNumber")),
}
