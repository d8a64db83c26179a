"""Line grids that lie exactly on the pixels, and print beside them."""

import numpy as np
import pytest
from chart_scene import a4, photographed
from drawn_grids import View, draw, line_grid, photograph

from lensfit.detect.lines import find_lines


@pytest.mark.parametrize("offset_px", [0.0, 0.5])
def test_lines_that_all_lie_alike_on_the_pixels(offset_px: float):
    view = View(
        pitch_px=32.0, rotation_rad=0.0, radial=0.0, perspective=(0.0, 0.0),
        offset_px=(offset_px, offset_px),
    )  # fmt: skip
    found = find_lines(photograph(draw(view, line_grid(0.1), blur_px=0.6, noise=0.002)))
    miss = (view.lattice(found.points_px) * 32.0) % 32
    across = np.where(found.family == 0, miss[:, 0], miss[:, 1])
    assert np.abs((across + 16) % 32 - 16).max() < 0.05
    assert len(found) > 200


def test_code_and_ruler_are_no_lines():
    layout = a4("line-grid")
    picture, _ = photographed(layout)
    found = find_lines(picture)
    for axis, count in enumerate(layout.pattern.lattice_size):
        numbers = np.unique(found.lattice[found.family == axis, axis])
        np.testing.assert_array_equal(numbers, np.arange(count))
