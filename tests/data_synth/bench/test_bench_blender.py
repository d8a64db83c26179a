"""Blender as a peer: what it is told, and what is said when it does not run."""

import sys

import numpy as np
import pytest

from data_synth.bench.render.blender import blender_defocus, task_of
from data_synth.bench.render.scenes import synthetic_scene
from lensfit.errors import LensfitError
from lensfit.io.exr import read_exr
from lensfit.preset.thin_lens import ThinCamera

CAMERA = ThinCamera(
    focal_length_mm=35.0,
    f_number=1.4,
    focus_distance_m=4.0,
    sensor_width_mm=28.25,
    width_px=96,
    height_px=54,
)


def test_blender_is_given_the_display_window_and_metres(tmp_path):
    scene = synthetic_scene(CAMERA, 96, 54)
    task = task_of(scene, CAMERA, tmp_path)
    assert task["size_px"] == [96, 54]
    colour = read_exr(str(task["colour"])).parts[0].channels
    np.testing.assert_array_equal(colour["G"], scene.undefocused()[..., 1])
    depth = read_exr(str(task["depth_m"])).parts[0].channels["R"]
    known = np.isfinite(scene.depth_mm[scene.inside])
    expected = scene.depth_mm[scene.inside][known] / 1000
    np.testing.assert_allclose(depth[known], expected, rtol=1e-6)
    assert np.all(depth[~known] > 1e5)


def test_a_python_without_blender_is_one_clear_line():
    scene = synthetic_scene(CAMERA, 32, 18)
    with pytest.raises(LensfitError, match="Blender did not run") as caught:
        blender_defocus(scene, CAMERA, sys.executable + "-none", 8.0)
    assert "\n" not in str(caught.value)
