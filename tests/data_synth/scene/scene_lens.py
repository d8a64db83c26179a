"""Lenses and small frames for tests of scenes."""

import numpy as np

from data_synth.lens import SetLens, set_lens
from data_synth.prescription import load_prescription
from data_synth.scene.layers import Lamps, Layer, Scene, square_plane
from data_synth.scene.paints import Plain
from data_synth.scene.shapes import Union
from data_synth.sensor import Band, Frame

GREEN = Band("g", (525.0, 540.0, 555.0), (1 / 6, 2 / 3, 1 / 6))
BLACK = Plain((0.0, 0.0, 0.0))
WHITE = Plain((1.0, 1.0, 1.0))
FINE = Frame((96, 54), (2.4, 1.35))
"""The middle of a sensor, in pixels of 25 um."""


def focused(name: str, f_number: float, focus_mm: float = 1200.0, **more) -> SetLens:
    return set_lens(
        load_prescription(name), f_number=f_number, focus_distance_mm=focus_mm, **more
    )


def lamp_layer(depth_mm: float, centre_mm, radius_mm: float, radiance=1.0) -> Layer:
    """One lamp on nothing."""
    lamps = Lamps(
        np.array([centre_mm], float), np.array([radius_mm]), np.full((1, 3), radiance)
    )
    return Layer("lamp", square_plane(depth_mm), Union(), BLACK, lamps=lamps)


def scene_of(*layers: Layer) -> Scene:
    return Scene(layers)
