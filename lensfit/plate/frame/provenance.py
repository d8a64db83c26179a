"""How a finished frame was made, in its header, and whether its file is still whole.

The line names the version, the lens with a digest of its preset, the camera state and
the effects. A plate whose header has it has been through a lens already.

The fingerprint is what a later run compares: digests of all inputs. It holds one each
of the plate's bytes, of the preset, and of the settings (camera state, knobs, options
and the pictures and maps they name), and the version of lensfit. A frame whose
fingerprint equals that of a rendering made now has the same pixels, wherever its files
lie; for another one, a note names what differs.

The fingerprint tells what a frame was made of, not whether its pixels are still those
that were written: a disk or a copy may lose some of them, and a header outlives that.
Whoever skips a finished frame reads its bytes, which costs what the digest of its plate
does, and far less than decoding both.

The digest is of all bytes of the file, its own digits taken as zeros.
"""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import BinaryIO, NamedTuple

import msgspec

from lensfit import __version__
from lensfit.atomic import atomic_path
from lensfit.errors import ImageError
from lensfit.io.exr import ExrImage, ExrPart, write_exr
from lensfit.plate.apply_options import ApplyOptions
from lensfit.plate.camera.plate_state import PlateState
from lensfit.preset.knobs import NEUTRAL, active_knobs
from lensfit.preset.scaled_look import UNSCALED
from lensfit.preset.schema import Preset

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


SAID = "lensfit/applied"
"""Header entry that tells what was done to a frame."""
UNDISTORTED = "lensfit/undistorted"
"""Header entry that tells what was taken off a photograph."""
SAID_BEFORE = "lensfit/applied_before"
"""Header entry that tells what had been done to its plate already."""
OVERSCAN = "lens/overscan"
"""Header entry of the CG renderer, percent; none is left in a cropped frame."""


def preset_digest(preset: Preset) -> str:
    """Hexadecimal digits that change with anything but where it was saved."""
    preset = msgspec.structs.replace(preset, saved=None)
    # A preset that travelled to a worker encodes its neutral knobs, which are no longer
    # the defaults themselves.
    plain = msgspec.structs.replace(preset, knobs=NEUTRAL)
    text = msgspec.json.encode((plain, active_knobs(preset.knobs)))
    return hashlib.sha256(text).hexdigest()


def signature(
    lens_name: str, digest: str, state: PlateState, options: ApplyOptions
) -> str:
    """What is done to a plate of this state, for whoever opens the file."""
    focal, f_number, focus = state.lens_key
    at = [
        f"{value:g} {unit}"
        for value, unit in ((focal, "mm"), (focus, "mm focus"))
        if value is not None
    ]
    at += [] if f_number is None else [f"f/{f_number:g}"]
    at += [f"{state.sensor_width_mm:g} mm wide"]
    if (scaled := state.scaled) != UNSCALED:
        at += [f"for {scaled.focal_length_mm:g} mm on {scaled.sensor_width_mm:g} mm"]
    lens = ", ".join([f"{lens_name} ({digest[:8]})", *at])
    done = ", ".join(_effects(options)) or "nothing"
    active = [f"{name} {value}" for name, value in active_knobs(state.knobs).items()]
    active += _filter_digest(state)
    settings = _settings(options) + ([", ".join(active)] if active else [])
    return "; ".join([f"lensfit {__version__}: {lens}", done, *settings])


def _filter_digest(state: PlateState) -> list[str]:
    """What the filter image holds: another picture may come to have its name."""
    path = state.knobs.bokeh.filter_image
    if path is None or not Path(path).is_file():
        return []
    return [f"filter {hashlib.sha256(Path(path).read_bytes()).hexdigest()[:8]}"]


def _settings(options: ApplyOptions) -> list[str]:
    """What else was requested that changes pixels."""
    found = [f"tolerance {options.tolerance:g}", options.filter]
    depth = [
        f"{name} {value}"
        for name, value in asdict(options.depth).items()
        if value is not None
    ]
    if depth:
        found.append(f"depth {', '.join(depth)}")
    if options.layers is not None:
        found.append(f"layers {', '.join(map(repr, options.layers))}")
    if options.keep_overscan:
        found.append("overscan kept")
    return found


def _effects(options: ApplyOptions) -> list[str]:
    switches = options.switches
    if options.output == "undistorted":
        also = [("lateral colour", switches.lateral_colour)]
        also += [("fall-off", switches.falloff)]
        return [f"{name} taken off" for name, on in [("distortion", True), *also] if on]
    if options.output != "result":
        return [options.output]
    effects = [
        name
        for name, on in (
            ("distortion", switches.distortion),
            ("lateral colour", switches.lateral_colour),
            ("fall-off", switches.falloff),
            ("depth of field", switches.defocus),
        )
        if on
    ]
    if options.stmap is not None:
        effects.append(f"map {options.stmap.name}")
    if switches.defocus and options.edge_mask:
        effects.append(f"edges of {', '.join(options.edge_mask)}")
    if switches.defocus and options.edge_matte is not None:
        effects.append(f"edges by channel {options.edge_matte}")
    return effects


def applied_line(parts: Iterable[ExrPart]) -> str | None:
    """What was done to a picture, by its header; None if it carries no lens."""
    return next((str(p.attributes[SAID]) for p in parts if SAID in p.attributes), None)


def is_made_here(part: ExrPart) -> bool:
    """Whether a part is a result of lensfit, of either kind."""
    return SAID in part.attributes or UNDISTORTED in part.attributes


def refuse_second_straightening(parts: Iterable[ExrPart]) -> None:
    """Refuse a plate that was straightened already.

    Raises
    ------
    ImageError : It was.
    """
    lines = (part.attributes.get(UNDISTORTED) for part in parts)
    said = next((str(line) for line in lines if line is not None), None)
    if said is not None:
        raise ImageError(
            f"was straightened already ({said.split(';')[0]})",
            remedy="give the plate as it was photographed, or insist with --again",
        )


def refuse_second_lens(parts: Iterable[ExrPart]) -> None:
    """Refuse a plate that carries a lens already.

    Raises
    ------
    ImageError : It does.
    """
    said = applied_line(parts)
    if said is not None:
        raise ImageError(
            f"carries a lens already ({said.split(';')[0]})",
            remedy="give the plate as it was rendered, or insist with --again",
        )


def part_with_signature(
    part: ExrPart, said: str, lens_attributes: Mapping[str, object], entry: str = SAID
) -> ExrPart:
    """The part with a header that says what was done to it.

    Parameters
    ----------
    lens_attributes : Of the lens that it carries now, in place of the plate's.
    entry : `SAID`, or `UNDISTORTED`: what was done last is what the picture is.
    """
    attributes = {**part.attributes, **lens_attributes}
    attributes.pop(FINGERPRINT, None)
    earlier = [attributes.pop(name, None) for name in (SAID, UNDISTORTED)]
    before = [line for line in (attributes.get(SAID_BEFORE), *earlier) if line]
    if any(earlier):
        attributes[SAID_BEFORE] = " | ".join(str(line) for line in before)
    attributes[entry] = said
    if OVERSCAN in attributes and part.data_window == part.display_window:
        text = isinstance(attributes[OVERSCAN], str)
        attributes[OVERSCAN] = "0" if text else 0.0
    return replace(part, attributes=attributes)


CONTENT = "lensfit/content"
"""Header entry that holds it."""
_BLANK = "0" * _DIGITS
_ENTRY = CONTENT.encode() + b"\0string\0" + _DIGITS.to_bytes(4, "little")
"""As OpenEXR lays out an attribute: name, type, length; its text follows."""
_HEADER_BYTES = 1 << 24
_CHUNK_BYTES = 1 << 20


def write_with_digest(target: Path, image: ExrImage) -> None:
    """Write a finished frame, whole or not at all, with the digest of its file.

    Raises
    ------
    OutputError : As `write_exr`.
    """
    with atomic_path(target) as temporary:
        write_exr(temporary, _with_blank(image))
        with temporary.open("r+b") as file:
            at = _place(file)
            if at is not None:
                digest = _digest(file, at)
                file.seek(at)
                file.write(digest.encode())


def is_whole(frame: Path) -> bool:
    """Whether a finished frame holds the bytes that were written; not where it has no
    digest, or its disk no longer reads all of it."""
    try:
        with frame.open("rb") as file:
            at = _place(file)
            if at is None:
                return False
            file.seek(at)
            return file.read(_DIGITS).decode("latin-1") == _digest(file, at)
    except OSError:
        return False


def _with_blank(image: ExrImage) -> ExrImage:
    """With room for the digest in the first part that was made here, and none of what
    the plate went through before."""
    parts = [
        replace(p, attributes={k: v for k, v in p.attributes.items() if k != CONTENT})
        for p in image.parts
    ]
    made = (index for index, part in enumerate(parts) if is_made_here(part))
    if (first := next(made, None)) is not None:
        attributes = {**parts[first].attributes, CONTENT: _BLANK}
        parts[first] = replace(parts[first], attributes=attributes)
    return ExrImage(tuple(parts))


def _place(file: BinaryIO) -> int | None:
    """Where the digits stand."""
    file.seek(0)
    found = file.read(_HEADER_BYTES).find(_ENTRY)
    return None if found < 0 else found + len(_ENTRY)


def _digest(file: BinaryIO, at: int) -> str:
    digest = hashlib.sha256()
    file.seek(0)
    digest.update(file.read(at) + _BLANK.encode())
    file.seek(at + _DIGITS)
    while chunk := file.read(_CHUNK_BYTES):
        digest.update(chunk)
    return digest.hexdigest()[:_DIGITS]
