"""Header entries that look like a camera's and that nothing reads.

A renderer may state its camera under names of its own. They are listed, so that
nobody takes a value for read that was passed over; ``[aliases]`` maps them.
"""

import re
from collections.abc import Mapping, Sequence
from numbers import Real

from lensfit.io.camera.aliases import ALIASES, Alias
from lensfit.io.header_entry import is_entry_of_alias, is_exif

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
_LONGEST = 80


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
        key: _text(value)
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


def _text(value: object) -> str:
    shown = f"{value:g}" if isinstance(value, float) else str(value)
    return " ".join(shown.split())[:_LONGEST]
