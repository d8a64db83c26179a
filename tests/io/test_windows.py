"""Samples over another window: the same pixel keeps its value wherever it lies."""

import numpy as np
import pytest

from lensfit.coords import Window
from lensfit.io.windows import pixels_over_window

OWN = Window(-2, 3, 5, 8)


def numbered(window):
    """Samples that tell their own place, with a channel axis."""
    y = np.arange(window.y_min, window.y_max + 1)[:, None]
    x = np.arange(window.x_min, window.x_max + 1)
    return np.stack([100 * y + x, 0 * y + x], -1).astype(np.float32)


@pytest.mark.parametrize(
    "wanted",
    [
        OWN,
        Window(0, 4, 3, 6),
        Window(-4, 0, 9, 12),
        Window(2, 6, 9, 12),
        Window(20, 20, 22, 22),
    ],
    ids=["same", "inside", "around", "overlapping", "apart"],
)
def test_every_pixel_keeps_its_value_and_the_others_are_missing(wanted):
    found = pixels_over_window(numbered(OWN), OWN, wanted, np.nan)
    exact = numbered(wanted)
    x, y = exact[..., 1], (exact[..., 0] - exact[..., 1]) / 100
    inside = (x >= OWN.x_min) & (x <= OWN.x_max) & (y >= OWN.y_min) & (y <= OWN.y_max)
    assert found.shape == exact.shape
    assert (found[inside] == exact[inside]).all()
    assert np.isnan(found[~inside]).all()


def test_a_part_is_a_view_and_not_a_second_copy():
    samples = numbered(OWN)
    assert np.shares_memory(
        pixels_over_window(samples, OWN, Window(0, 4, 3, 6)), samples
    )
    assert not pixels_over_window(samples, OWN, Window(6, 9, 7, 9)).any()
