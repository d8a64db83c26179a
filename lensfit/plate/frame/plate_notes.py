"""Notes on a rendered plate that are not obvious from the picture.

Borders that stay black because a plate has too little overscan, pixels that are not
numbers and spread to their neighbours, and knobs of an effect of the lens that is
switched off.
"""

from collections.abc import Iterable, Iterator, Mapping

import numpy as np
from jaxtyping import Float32

from lensfit.coords import Window
from lensfit.io.depth_channel import FoundDepth, is_depth_name
from lensfit.io.exr import ExrPart
from lensfit.io.exr_views import EYES
from lensfit.plate.notes import FrameNote
from lensfit.plate.plate_file import ColourLayer
from lensfit.rendering.render_stages import Stages, Switches

_SEEN_PART = 1e-4
"""Of the pixels; less is a rounding of the border."""
_WHOLE = 1.05
"""Alpha up to here is said nothing of: filters of renderers leave it along edges."""
_KNOBS = {
    "distortion": ("--no-distortion", ("distortion",)),
    "lateral_colour": ("--no-lateral-colour", ("lateral_red", "lateral_blue")),
    "falloff": (
        "--no-falloff",
        ("natural_vignetting", "optical_vignetting", "mechanical_vignetting"),
    ),
}
"""By switch, the option that leaves the effect out and what its knobs begin with."""


def border_note(stages: Stages, window: Window, source: Window) -> str | None:
    """Whether the lens looks beyond the pixels that the plate has.

    Parameters
    ----------
    stages : Maps, over the rendered window or more.
    window : Pixels that are written.
    source : Data window of the plate.
    """
    x, y = np.moveaxis(stages.maps[1].cropped(window).positions_px(), -1, 0)
    outside = (x < source.x_min) | (x > source.x_max + 1)
    outside |= (y < source.y_min) | (y > source.y_max + 1)
    part = float(np.mean(outside))
    if part < _SEEN_PART:
        return None
    return (
        f"{100 * part:.3g} % of the frame lies outside the plate and is black: render "
        "the CG with more overscan (`lensfit overscan` says how much)"
    )


def number_note(
    pixels: Float32[np.ndarray, "height width channels"],
    name: str,
    *,
    blurred: bool = True,
) -> FrameNote | None:
    """Whether the plate of that name holds NaN or infinity.

    Parameters
    ----------
    blurred : Whether depth of field may be put on it.
    """
    if np.isfinite(pixels).all():
        return None
    black = ", and turn black where depth of field is put on" if blurred else ""
    return FrameNote(
        f"{name} holds NaN or infinite pixels, which spread to their neighbours{black}"
        ": mend them in the plate, and look at the others",
        "numbers",
    )


def alpha_note(
    alpha: Float32[np.ndarray, "height width"], name: str
) -> FrameNote | None:
    """Whether the plate of that name covers pixels more than wholly."""
    largest = float(np.max(alpha, initial=0.0, where=np.isfinite(alpha)))
    if largest <= _WHOLE:
        return None
    return FrameNote(
        f"{name} has alpha up to {largest:.3g}, which counts as 1 where depth of field "
        "is put on: colours are taken as they are",
        "alpha",
    )


def layer_depth_notes(
    part: ExrPart, layers: Iterable[ColourLayer], used: FoundDepth, name: str
) -> Iterator[FrameNote]:
    """Layers that are blurred by a depth which may not be theirs.

    Parameters
    ----------
    part : With the layers.
    used : The depth of all of them.
    name : Of the plate.
    """
    for layer in (one.layer for one in layers if one.layer):
        own = [
            channel
            for channel in part.channel_names
            if channel.rpartition(".")[0] == layer and is_depth_name(channel)
        ]
        if own and used.name not in own:
            yield FrameNote(
                f"{name}: layer {layer!r} has a depth of its own ({own[0]}), and is "
                f"rendered with {used.name} (--layer and --depth-channel choose)",
                f"depth of layer {layer}",
            )
        elif not own and layer.lower() in EYES:
            yield FrameNote(
                f"{name}: layer {layer!r} is rendered with {used.name} and with the "
                "plate's camera; if it is an eye, give it a depth of its own and state "
                "its view (multiView)",
                f"depth of layer {layer}",
            )


def left_out_knobs(switches: Switches, knobs: Mapping[str, object]) -> Iterator[str]:
    """One sentence for each knob of an effect that is switched off.

    Parameters
    ----------
    knobs : Those that the user set, by name; a knob set to no effect agrees with the
        switch.
    """
    for switch, (option, aberrations) in _KNOBS.items():
        if getattr(switches, switch):
            continue
        for name, value in knobs.items():
            if name.startswith(aberrations) and value not in (None, 0):
                knob = f"--{name.replace('_', '-')}"
                yield f"{knob} has no effect: {option} leaves its effect out"
