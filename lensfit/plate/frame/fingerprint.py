"""The fingerprint of a finished frame, kept in its header: digests of all its inputs.

It holds a digest each of the plate's bytes, of the preset, and of the settings (camera
state, knobs, options and the pictures and maps they name), and the version of lensfit.
A frame whose fingerprint equals that of a rendering made now has the same pixels,
wherever its files lie; for another one, a note names what differs.
"""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import NamedTuple

from lensfit import __version__
from lensfit.errors import ImageError
from lensfit.plate.apply_options import ApplyOptions
from lensfit.plate.camera.plate_state import PlateState
from lensfit.preset.knobs import active_knobs
from lensfit.preset.scaled_look import UNSCALED

FINGERPRINT = "lensfit/fingerprint"
"""Header entry that holds it."""
_DIGITS = 16
_IN_THE_STATE = ("overrides", "camera", "knobs", "pixel_aspect", "scale_to_sensor")
_NO_PIXELS = ("overwrite", "keep", "again")
_BY_CONTENT = ("stmap",)
_SPELT = {
    "version": "by another version of lensfit",
    "plate": "from another plate",
    "preset": "with another preset",
    "settings": "with other settings",
}


class Fingerprint(NamedTuple):
    """What a frame is made of; digests are hexadecimal."""

    version: str
    plate: str
    preset: str
    settings: str

    @property
    def text(self) -> str:
        """As the header holds it."""
        return " ".join(f"{name}={value}" for name, value in self._asdict().items())

    def difference(self, found: str | None) -> str | None:
        """How another frame was made otherwise; None if it was made of the same.

        Parameters
        ----------
        found : The other's text; None if it has none.
        """
        if found is None:
            return "by a version of lensfit that left no fingerprint"
        theirs = dict(word.split("=", 1) for word in found.split() if "=" in word)
        others = [
            _SPELT[name]
            for name, value in self._asdict().items()
            if theirs.get(name) != value
        ]
        return ", ".join(others) or None


def fingerprint(
    plate: Path, preset_digest: str, states: Sequence[PlateState], options: ApplyOptions
) -> Fingerprint:
    """The fingerprint of the frame that would be rendered now.

    Parameters
    ----------
    plate : Its file.
    preset_digest : Of the preset.
    states : Camera state and knobs of each view of the plate.

    Raises
    ------
    ImageError : The plate, or a map or picture of the options, cannot be read.
    """
    settings = repr(([_state(state) for state in states], _options(options)))
    return Fingerprint(
        __version__,
        file_digest(plate),
        preset_digest[:_DIGITS],
        hashlib.sha256(settings.encode("utf-8", "replace")).hexdigest()[:_DIGITS],
    )


def file_digest(path: Path) -> str:
    """Sixteen hexadecimal digits that change with the bytes of a file.

    Raises
    ------
    ImageError : The file cannot be read.
    """
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()[:_DIGITS]
    except (OSError, ValueError) as error:
        raise ImageError(
            f"cannot be read ({error})", where=path, remedy="check its path"
        ) from error


def _state(state: PlateState) -> tuple:
    active: dict[str, object] = dict(active_knobs(state.knobs))
    if (picture := active.get("filter_image")) is not None:
        active["filter_image"] = _content(Path(str(picture)))
    spanned = (state.sensor_width_mm, state.pixel_shape)
    scaled = () if state.scaled == UNSCALED else tuple(state.scaled)
    return (state.lens_key, spanned, sorted(active.items()), *scaled)


def _options(options: ApplyOptions) -> list[tuple[str, object]]:
    """Every option that changes pixels and is not in the camera state already; one that
    is added to `ApplyOptions` counts too."""
    plain: Mapping[str, object] = asdict(options) | {"method": options.filter}
    left_out = (*_IN_THE_STATE, *_NO_PIXELS, *_BY_CONTENT)
    kept = {name: value for name, value in plain.items() if name not in left_out}
    for name in _BY_CONTENT:
        path = getattr(options, name)
        kept[name] = None if path is None else _content(path)
    return sorted((name, _plain(value)) for name, value in kept.items())


def _plain(value: object) -> object:
    """Lists and tuples of the same words are the same."""
    if isinstance(value, (list, tuple)):
        return tuple(value)
    return sorted(value.items()) if isinstance(value, dict) else value


def _content(path: Path) -> str:
    """By its bytes; a name that is no file is refused by whoever reads it."""
    return file_digest(path) if path.is_file() else str(path)
