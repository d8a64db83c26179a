"""Notes on knobs of an effect of the lens that is switched off."""

from collections.abc import Iterator, Mapping

from lensfit.rendering.render_stages import Switches

_KNOBS = {
    "distortion": ("--no-distortion", ("distortion",)),
    "lateral_colour": ("--no-lateral-colour", ("lateral_red", "lateral_blue")),
    "falloff": (
        "--no-falloff",
        ("natural_vignetting", "optical_vignetting", "mechanical_vignetting"),
    ),
}
"""By switch, the option that leaves the effect out and what its knobs begin with."""


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
