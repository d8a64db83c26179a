"""Entries of picture headers that tell the camera: names, numbers, what is not read.

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

Looked at and left out (`unmapped_entries` lists what a header has of them):

V-Ray         ``cameraTargetDistance``: units of a scene that the header does not tell
Redshift      ``rs/camera/fov``, ``rs/camera/aperture``: "EXR Metadata", Redshift for
              Cinema 4D, help.maxon.net, says radians; scripts in use read degrees, and
              some take the aperture as inches
Arnold, RenderMan, Karma, Mantra
              no page of their manuals was found that documents entries of the lens;
              tell them to write ``lens/focal`` and the others

The number of an entry may be a string. Names with a slash may have any prefix (Nuke
shows ``exr/lens/focal``), others only ``exr/``, so that a renderer's own ``aperture``
is not taken for the standard one. EXIF (whose names begin with a capital) writes 0 for
what it does not know, which counts as missing.

A renderer may state its camera under names of its own. Entries that look like a
camera's and that nothing reads are listed, so that nobody takes a value for read that
was passed over; ``[aliases]`` maps them.
"""

import math
import re
from collections.abc import Mapping, Sequence
from numbers import Real
from typing import NamedTuple

from lensfit.errors import ImageError
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

_EXIF_INFINITY = 2**32 - 1
_MAY_BE_ZERO = ("overscan_percent",)
_MAY_BE_INFINITE = ("focus_distance_mm",)


def is_entry_of_alias(key: str, alias: str) -> bool:
    """Whether a header's `key` is the entry called `alias`."""
    if key == alias:
        return True
    prefix = key.removesuffix(f"/{alias}")
    if prefix == key:
        return False
    return "/" in alias or prefix.split("/")[-1] == "exr"


def is_exif(key: str) -> bool:
    """Whether the entry is one of EXIF's."""
    return key[0].isupper()


def entry_text(value: object) -> str | None:
    """What an entry says in words; None where it says nothing."""
    return str(value).split("\0")[0].strip() or None


def entry_quantity(name: str, key: str, value: object, alias: Alias) -> float | None:
    """An entry as the quantity called `name`, in its unit; None where it is missing.

    Raises
    ------
    ImageError : It holds no number, or one that the quantity cannot have.
    """
    number = number_in(key, value)
    if is_exif(alias.key):
        if number == _EXIF_INFINITY:
            number = math.inf
        elif math.isnan(number) or number == 0:
            return None
    too_small = number < 0 or (number == 0 and name not in _MAY_BE_ZERO)
    if math.isnan(number) or too_small:
        raise impossible_value_error(key, value, "a number above zero")
    if math.isinf(number) and name not in _MAY_BE_INFINITE:
        raise impossible_value_error(key, value, "a finite number")
    # Single-precision headers: 1.4 is stored as 1.39999998.
    return float(f"{number * alias.factor:.7g}")


def number_in(key: str, value: object) -> float:
    """An entry as a plain number; NaN for a fraction of nothing.

    Raises
    ------
    ImageError : It is none.
    """
    try:
        return float(value)  # pyright: ignore[reportArgumentType]
    except ZeroDivisionError:
        return math.nan
    except (TypeError, ValueError, OverflowError):
        raise impossible_value_error(key, value, "a number") from None


def impossible_value_error(key: str, value: object, expected: str) -> ImageError:
    """An entry that holds what it cannot be."""
    shown = " ".join(str(value).split())[:40]
    return ImageError(
        f"header entry {key!r} is {shown!r} and should be {expected}",
        remedy="mend it, or state the value yourself",
    )


_OF_LENSES = re.compile(
    "focal|focus|f-?stop|t-?stop|f-?number|aperture|fov|fieldofview|iris|filmback|"
    "squeeze|depthoffield|dof"
)
_OF_CAMERAS = re.compile("camera|lens|sensor")
"""Of which numbers alone count: names and serial numbers are no state."""
_READ_OTHERWISE = re.compile(
    r"(?:.*/)?(?:lensfit/.*|sensor(?:PhotositePitch|AcquisitionRectangle"
    r"|OverallDimensions|CenterOffset)|entrancePupilOffset"
    r"|camera(?:CCT|Tint)Setting|camera(?:Label|Make|SerialNumber|FirmwareVersion|Uuid)"
    r"|lens(?:Make|FirmwareVersion))"
)
_LONGEST_SHOWN = 80


def unmapped_entries(
    header: Mapping[str, object],
    aliases: Mapping[str, Sequence[Alias]] | None = None,
) -> dict[str, str]:
    """The entries, by name, with what they hold as text.

    Parameters
    ----------
    header : Of a picture; EXIF's own entries are not looked at.
    aliases : More entries that are read, by quantity, as of a project's settings.
    """
    read = [a.key for known in ALIASES.values() for a in known]
    read += [a.key for known in (aliases or {}).values() for a in known]
    return {
        key: _short_value(value)
        for key, value in header.items()
        if _looks_like_a_camera(key, value)
        and not any(is_entry_of_alias(key, alias) for alias in read)
    }


def _looks_like_a_camera(key: str, value: object) -> bool:
    if is_exif(key) or _READ_OTHERWISE.fullmatch(key):
        return False
    if not isinstance(value, str | Real):  # matrices tell where it stands
        return False
    plain = re.sub(r"[\s_]", "", key).lower()
    if _OF_LENSES.search(plain):
        return True
    return bool(_OF_CAMERAS.search(plain)) and _is_number(value)


def _is_number(value: str | Real) -> bool:
    try:
        float(value)
    except ValueError:
        return False
    return True


def _short_value(value: object) -> str:
    shown = f"{value:g}" if isinstance(value, float) else str(value)
    return " ".join(shown.split())[:_LONGEST_SHOWN]
