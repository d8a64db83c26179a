"""Entries that say how well all of their maps are known, and lenses of them."""

import msgspec
import numpy as np
from preset_makers import make_entry, make_preset

from lensfit.lens import Lens
from lensfit.preset.blocks import Covariance, FallOffCovariance, LateralCovariance
from lensfit.preset.entry import Entry
from lensfit.preset.knobs import Knobs

POINTS = np.array([[0.5, -0.3], [6.0, 4.0], [-9.0, 3.0], [11.0, -8.0]])
NAMES = (
    "focal_length[0]",
    "principal_point[0]",
    "principal_point[1]",
    "radial[0]",
    "radial[1]",
    "squeeze[0]",
    "squeeze[1]",
    "decentering[0]",
    "free_field[1]",
    "free_field[6]",
    "pupil_shift[0]",
)
RED = ("shift_mm[0]", "shift_mm[1]", "radial[0]", "radial[1]")
CONTROL = ("r[0]", "r[1]")


def covariance_of(names: tuple[str, ...], size: float, seed: int) -> Covariance:
    """Of numbers that move together."""
    mix = np.random.default_rng(seed).normal(size=(len(names), len(names)))
    mix += 2 * np.eye(len(names))
    return Covariance.from_matrix(names, size**2 * mix @ mix.T)


def known_entry(**changes) -> Entry:
    """The entry of the makers, with the covariance of everything."""
    entry = make_entry()
    colour, lights = entry.lateral_colour, entry.fall_off
    assert colour is not None
    blue = covariance_of(("radial[0]",), 1e-5, 2)
    lateral = LateralCovariance(covariance_of(RED, 1e-5, 1), blue)
    known = FallOffCovariance(
        *(covariance_of((f"{c}[0]", f"{c}[1]"), 1e-3, k) for k, c in enumerate("rgb"))
    )
    entry = msgspec.structs.replace(
        entry,
        covariance=covariance_of(NAMES, 2e-5, 0),
        lateral_colour=msgspec.structs.replace(colour, covariance=lateral),
        fall_off=tuple(
            msgspec.structs.replace(one, covariance=known) for one in lights
        ),
    )
    return msgspec.structs.replace(entry, **changes)


def lens_of(entry: Entry, **knobs) -> Lens:
    turned = Knobs()
    aberration = msgspec.structs.replace(turned.aberration, **knobs)
    turned = msgspec.structs.replace(turned, aberration=aberration)
    return make_preset(entry).at(50.0, 1.4, knobs=turned)
