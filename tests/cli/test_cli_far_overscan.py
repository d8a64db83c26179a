"""Plates far larger than their frame, or beside it, through a fitted lens with blur.

Beyond the frame a lens was not photographed, and what was fitted leads light anywhere.
None of it may change the frame.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from command_line import run

from lensfit.coords import Window
from lensfit.io.exr import ExrImage, ExrPart, read_exr, write_exr

PRIME = Path(__file__).parents[2] / "presets" / "prime_50" / "preset.json"
FRAME = Window.of_size(240, 135)
HEADER = {"lens/focal": 50.0, "lens/fstop": 2.0, "lens/focus": 2.0}
HEADER |= {"lens/aperture": 24.0}
TOLERANCE = 0.003


def rendered(folder: Path, window: Window, frame: Window = FRAME, *options: str):
    x, y = np.moveaxis(window.pixel_centres(), -1, 0)
    square = np.where((x // 12 + y // 12) % 2, 0.8, 0.2)
    shades = {"R": 1.0, "G": 0.8, "B": 0.6}
    channels = {n: (square * c).astype(np.float32) for n, c in shades.items()}
    channels["A"] = np.ones_like(channels["R"])
    channels["Z"] = np.full_like(channels["R"], 2.3)
    plate = folder / "plate.exr"
    write_exr(plate, ExrImage((ExrPart(channels, window, frame, HEADER),)))
    words = ["apply", str(PRIME), str(plate), "--out", str(folder / "out")]
    done = run(*words, "--overwrite", "--json", *options)
    assert done.exit_code == 0, done.stderr
    return read_exr(json.loads(done.stdout)["written"][0]).parts[0]


def colours(part: ExrPart) -> np.ndarray:
    return np.stack([part.channels[n] for n in "RGB"], -1)


@pytest.mark.slow
def test_overscan_of_any_size_shows_the_same_frame(tmp_path):
    cut = rendered(tmp_path, FRAME.grown(24, 24))
    for percent in (90, 100, 300):
        beside = FRAME.width * percent // 200, FRAME.height * percent // 200
        whole = rendered(tmp_path, FRAME.grown(*beside))
        assert whole.data_window == FRAME
        error = colours(whole) - colours(cut)
        assert np.sqrt((error**2).mean()) < TOLERANCE / 10
        assert np.abs(error).max() < TOLERANCE


@pytest.mark.slow
@pytest.mark.parametrize("left", [300, 450, 2000])
def test_an_element_that_has_left_the_frame_is_empty(tmp_path, left):
    made = rendered(tmp_path, Window(left, 100, left + 30, 130))
    assert made.data_window == Window(0, 0, 0, 0)
    assert (colours(made) == 0).all()


@pytest.mark.parametrize(
    ("size", "width_mm"), [((1, 1), 24), ((2, 1), 24), ((1, 3), 6)]
)
def test_a_frame_of_a_single_pixel_or_row_is_rendered(tmp_path, size, width_mm):
    """Stopped down: its pixels are as wide as the sensor, the outer ones far off. A
    column as wide as the sensor would be taller than what was photographed."""
    window, options = Window.of_size(*size), ("--sensor-width-mm", str(width_mm))
    made = rendered(tmp_path, window, window, "--f-number", "8", *options)
    assert (colours(made) > 0.05).all()
