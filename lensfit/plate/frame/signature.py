"""The line in the header of a finished frame that describes how it was made.

It names the version, the lens with a digest of its preset, the camera state and the
effects. It is for people; `frame.fingerprint` is what a later run compares. A plate
whose header has that line has been through a lens already.
"""

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import asdict, replace
from pathlib import Path

import msgspec

from lensfit import __version__
from lensfit.errors import ImageError
from lensfit.io.exr import ExrPart
from lensfit.plate.apply_options import ApplyOptions
from lensfit.plate.camera.plate_state import PlateState
from lensfit.plate.frame.fingerprint import FINGERPRINT
from lensfit.preset.knobs import NEUTRAL, active_knobs
from lensfit.preset.scaled_look import UNSCALED
from lensfit.preset.schema import Preset

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
