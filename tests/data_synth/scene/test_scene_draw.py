"""Drawn scenes: they follow from their seed, and stand before the lens."""

import numpy as np
import pytest
from scene_lens import focused

from data_synth.prescription import load_prescription, prescription_names
from data_synth.scene.draw import drawn_scene
from data_synth.scene.folder import drawn_sitting
from data_synth.scene.plates import pinhole_camera
from data_synth.sensor import Frame
from data_synth.trace import vertex_positions_mm
from data_synth.wavefront_cases import frame_for
from lensfit.errors import LensfitError

SPHERICAL = [n for n in prescription_names() if load_prescription(n).squeeze == 1.0]


def scene_drawn(seed: int, size_px=(96, 54)):
    lens = focused("biotar_50", 2.0)
    camera = pinhole_camera(lens, Frame(size_px, (24.0, 13.5)))
    return camera, drawn_scene(camera, 1143.8, 2 * lens.pupil_radius_mm, seed)


@pytest.mark.parametrize("name", SPHERICAL)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_everything_stands_before_the_front_element(name, seed):
    prescription = load_prescription(name)
    frame = frame_for(prescription, (960, 540))
    focal_mm = prescription.states[0].focal_length_mm
    sitting = drawn_sitting(
        prescription, frame, focus_distance_mm=24 * focal_mm, seed=seed
    )
    lens = sitting.lens
    front_mm = lens.pupil_z_mm - vertex_positions_mm(lens.surfaces)[0]
    half = np.array(frame.size_mm) * 0.55 / sitting.camera.focal_length_mm
    for layer in sitting.scene.layers:
        depth = layer.plane.origin_mm[2]
        if not layer.plane.is_square:
            down = np.array([[0.0, half[1]]])
            rays = sitting.camera.rays(frame.px_from_mm(down * 50.0))
            depth = min(depth, float(layer.plane.depth_mm(rays)[0]))
        assert depth > front_mm + focal_mm


def test_a_scene_follows_from_its_seed():
    (_, one), (_, same), (_, other) = scene_drawn(4), scene_drawn(4), scene_drawn(5)
    names = [layer.name for layer in one.layers]
    assert names == [layer.name for layer in same.layers]
    for a, b in zip(one.layers, same.layers, strict=True):
        np.testing.assert_array_equal(a.plane.origin_mm, b.plane.origin_mm)
    depths = [layer.plane.origin_mm[2] for layer in one.layers]
    assert depths == sorted(depths)
    assert depths != [layer.plane.origin_mm[2] for layer in other.layers]


def test_a_scene_does_not_depend_on_how_many_pixels_it_is_shown_with():
    (small, coarse), (large, fine) = scene_drawn(4), scene_drawn(4, (960, 540))
    assert len(coarse.layers) == len(fine.layers)
    for a, b in zip(coarse.layers, fine.layers, strict=True):
        assert a.plane.origin_mm[2] == pytest.approx(b.plane.origin_mm[2], rel=1e-9)
        if a.lamps is not None and b.lamps is not None:
            px = small.px_of_scene(a.plane.scene_mm(a.lamps.centre_mm)) * 10
            at = large.px_of_scene(b.plane.scene_mm(b.lamps.centre_mm))
            np.testing.assert_allclose(px, at, atol=8.0)


def test_every_kind_of_thing_is_drawn():
    names = {layer.name for seed in range(12) for layer in scene_drawn(seed)[1].layers}
    wanted = {"leaves 0", "wires", "veil", "sheet with holes", "floor", "wall", "star"}
    wanted |= {"columns", "lattice", "far wires", "lamps", "far lamps", "near lamps"}
    assert wanted <= names


def test_an_anamorphic_lens_is_refused():
    prescription = load_prescription("schneider_31")
    with pytest.raises(LensfitError, match="schneider_31: is anamorphic"):
        drawn_sitting(
            prescription, frame_for(prescription, (96, 54)), focus_distance_mm=1500.0
        )
