"""Which header entries tell the camera: the alias table.

For each quantity the entries that are understood, the most trustworthy first, with the
factor to lensfit's unit. A project adds its own under ``[aliases]`` of its settings
file (`lensfit.plate.camera.settings`); they count before these.

OpenEXR 3.2   the standard's lens attributes; ``focus`` is metres. "Standard
              Attributes", openexr.com/en/latest/StandardAttributes.html
CG headers    ``lens/focal``, ``lens/fstop``, ``lens/focus`` (metres), ``lens/aperture``
              (the sensor's width), ``lens/overscan`` (percent). No renderer's own: a
              convention that the artist sets up, as custom metadata of the renderer
Nuke          ``nuke/camera/...``, as text. "Metadata", Nuke Python Developer's Guide,
              learn.foundry.com/nuke/developers/80/pythondevguide/metadata.html
V-Ray         ``cameraFocalLength``, ``cameraFNumber``, ``cameraAperture`` (film width).
              No page of its manual was found to list them; with ``cameraFov`` they
              agree in headers that versions 3 and 4 wrote
EXIF 2.3      photographs. CIPA DC-008, "Exchangeable image file format", section 4.6

Looked at and left out (`lensfit.io.camera.unmapped` lists what a header has of them):

V-Ray         ``cameraTargetDistance``: units of a scene that the header does not tell
Redshift      ``rs/camera/fov``, ``rs/camera/aperture``: "EXR Metadata", Redshift for
              Cinema 4D, help.maxon.net, says radians; scripts in use read degrees, and
              some take the aperture as inches
Arnold, RenderMan, Karma, Mantra
              no page of their manuals was found that documents entries of the lens;
              tell them to write ``lens/focal`` and the others
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
