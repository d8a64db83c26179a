"""The plate's header as one of the sources of its camera, the last one."""

from collections.abc import Collection, Mapping, Sequence

from lensfit.errors import ImageError
from lensfit.io.metadata import HeaderWord
from lensfit.plate.camera.plate_camera import BadEntry
from lensfit.plate.camera.sourced_value import SourcedValue

HEADER = 1_000_000
"""Its rank; there are fewer files."""
_OPTIONS = {
    "focal_length_mm": "give --focal-length-mm",
    "f_number": "give --f-number",
    "t_number": "give --f-number",
    "focus_distance_mm": "give --focus-distance-mm",
    "sensor_width_mm": "give --sensor-width-mm",
    "sensor_height_mm": "give sensor_height_mm under [camera] of lensfit.toml",
}


def add_header(
    words: dict[str, list[SourcedValue]],
    told: Mapping[str, Sequence[HeaderWord]],
    better: Collection[str],
) -> dict[str, tuple[BadEntry, ...]]:
    """Add what a header tells to `words`, behind those of better sources; what it
    cannot mean is returned.

    Parameters
    ----------
    words : By quantity, the word that counts most first.
    told : By the header.
    better : Quantities that another source tells.
    """
    bad: dict[str, tuple[BadEntry, ...]] = {}
    for name, entries in told.items():
        known = name in better
        for value, key in entries:
            if not isinstance(value, ImageError):
                words.setdefault(name, []).append(SourcedValue(value, key, rank=HEADER))
                known = True
                continue
            remedy = _OPTIONS.get(name, "take it out of the header")
            error = ImageError(value.what, remedy=f"mend it, or {remedy}")
            bad[name] = (*bad.get(name, ()), BadEntry(error, key, not known))
    return bad
