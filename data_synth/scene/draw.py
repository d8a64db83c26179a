"""Seeded random scenes that suit a lens: what stands where, how large, how bright."""

import numpy as np

from data_synth.scene.far_layers import (
    back_wires_layers,
    background_layers,
    columns_layers,
    lattice_layers,
    wall_layers,
)
from data_synth.scene.focus_layers import floor_layers, lamps_layers, subject_layers
from data_synth.scene.layers import Scene
from data_synth.scene.near_layers import (
    leaves_layers,
    sheet_with_holes_layers,
    veil_layers,
    wires_layers,
)
from data_synth.scene.plates import PinholeCamera
from data_synth.scene.stage import Stage

FLOOR_PART = 0.75
"""Of all scenes have a floor."""


def drawn_scene(
    camera: PinholeCamera, focus_mm: float, pupil_diameter_mm: float, seed: int
) -> Scene:
    """A random scene: a sharp subject, things before and behind it, and lamps.

    Parameters
    ----------
    focus_mm : Depth of the focus from the entrance pupil.
    pupil_diameter_mm : Of the entrance pupil.
    """
    height_mm = camera.frame.size_mm[1]
    blur = pupil_diameter_mm * camera.focal_length_mm / height_mm
    rng = np.random.default_rng(seed)
    stage = Stage(camera, focus_mm, blur, rng)
    near = [leaves_layers, wires_layers, veil_layers, sheet_with_holes_layers]
    behind = [columns_layers, back_wires_layers, wall_layers, lattice_layers]
    chosen = [near[k] for k in rng.permutation(4)[: rng.integers(2, 4)]]
    chosen += [behind[k] for k in rng.permutation(4)[: rng.integers(2, 4)]]
    if rng.uniform() < FLOOR_PART:
        chosen.append(floor_layers)
    chosen += [subject_layers, lamps_layers, background_layers]
    layers = [layer for make in chosen for layer in make(stage)]
    return Scene(tuple(sorted(layers, key=lambda layer: layer.plane.origin_mm[2])))
