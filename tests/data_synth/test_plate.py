"""The CG plate: its windows, attributes, depth and straight lines."""

from pathlib import Path

import numpy as np
import pytest

from data_synth import plate
from lensfit.io.exr import read_exr

PLATE = Path(plate.__file__).parent / "demo" / "plate.0001.exr"


@pytest.fixture(scope="module")
def part():
    return read_exr(PLATE).parts[0]


def test_overscan_is_a_data_window_beyond_the_display_window(part):
    assert tuple(part.display_window) == (0, 0, 959, 539)
    assert tuple(part.data_window) == (-48, -27, 1007, 566)
    assert part.attributes["lens/overscan"] == pytest.approx(10.0)
    assert part.attributes["lens/focal"] == pytest.approx(28.0)


def test_depth_is_perpendicular_metres(part):
    """The wall is square to the camera: one depth, though its corners are farther."""
    depth = part.channels["Z"]
    assert depth.dtype == np.float32
    wall = depth[70:120, :]
    ordinary = np.abs(wall - plate.WALL_Z_M) < 1e-3
    assert ordinary.mean() > 0.5
    bottom = depth[-1]
    row = part.data_window.y_max + 0.5 - plate.SIZE_PX[1] / 2
    slope = row * plate.SENSOR_WIDTH_MM / plate.SIZE_PX[0] / plate.FOCAL_MM
    ground = plate.CAMERA_HEIGHT_M / slope
    assert np.median(bottom) == pytest.approx(ground, rel=1e-4)


def test_lamps_are_far_brighter_than_white(part):
    assert part.channels["R"].max() > 100
    assert np.isfinite(part.channels["R"].astype(float)).all()
