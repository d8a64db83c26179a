"""The presets that come with lensfit: whole, usable, as good as their figures say."""

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import lensfit
from lensfit.coords import Window
from lensfit.preset.schema import Preset

FOLDER = Path(__file__).parents[1] / "presets"
NAMES = sorted(path.parent.name for path in FOLDER.glob("*/preset.json"))
KINDS = ("prime", "wide", "tele", "vintage", "zoom", "anamorphic")
LARGEST_PICTURE_BYTES = 150_000
PLATE_PX = (96, 72)
every_preset = pytest.mark.parametrize("name", NAMES)


def preset_of(name: str) -> Preset:
    return lensfit.load_preset(FOLDER / name / "preset.json")


def figures_of(name: str) -> dict[str, Any]:
    return json.loads((FOLDER / name / "figures.json").read_text(encoding="utf-8"))


def numbers(value: Any) -> Iterator[float]:
    """All numbers in a table, however deep."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list):
        for item in value:
            yield from numbers(item)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield value


def test_every_kind_of_lens_is_there():
    assert {name.split("_")[0] for name in NAMES} >= set(KINDS)


@every_preset
def test_figures_are_finite_and_of_this_preset(name: str):
    preset, figures = preset_of(name), figures_of(name)
    assert all(math.isfinite(value) for value in numbers(figures))
    assert figures["lens"] == preset.lens.name
    assert figures["photographs"]["size_px"] == [
        preset.camera.image_width_px,
        preset.camera.image_height_px,
    ]
    used = sum(entry.quality.points_used for entry in preset.entries)
    assert figures["fit"]["points_used"] == used
    assert 0 < figures["fit"]["rms_px"] <= 1.5 * figures["fit"]["held_out_rms_px"]
    assert all(entry.blur is not None for entry in preset.entries)
    assert "blur" in figures["measured"]


@every_preset
def test_figures_are_better_than_a_thin_lens(name: str):
    """Against the trace, pooled over what was photographed: chief rays and fall-off."""
    against = figures_of(name)["against_the_trace"]
    for key in ("chief_ray_px", "illumination_worst"):
        fitted, thin = (
            [value for table in tables_named(against[of], key) for value in table]
            for of in ("lensfit", "thin_lens")
        )
        assert len(fitted) == len(thin)
        assert np.median(fitted) < np.median(thin)


def tables_named(table: dict[str, Any], key: str) -> Iterator[list[float]]:
    """Numbers under a key, at the top or for each state."""
    if key in table:
        yield list(numbers(table[key]))
    else:
        for state in table.values():
            yield from tables_named(state, key)


@every_preset
def test_picture_is_a_small_jpeg(name: str):
    path = FOLDER / name / "picture.jpg"
    assert path.stat().st_size < LARGEST_PICTURE_BYTES
    with Image.open(path) as picture:
        assert picture.format == "JPEG"
        assert picture.width > picture.height > 300


@every_preset
def test_an_even_plate_comes_out_as_the_fall_off(name: str):
    preset = preset_of(name)
    half_mm = np.array([preset.camera.sensor_width_mm, preset.camera.sensor_height_mm])
    points = np.array([[0.0, 0.0], [0.5, 0.5], [-0.9, 0.6]]) * half_mm / 2
    for entry in preset.entries:
        lens = preset.at(
            focal_length_mm=entry.focal_length_mm,
            focus_distance_mm=entry.focus_distance_mm,
        )
        there = lens.distorted_from_undistorted(points)
        back = lens.undistorted_from_distorted(there)
        np.testing.assert_allclose(back, points, atol=1e-6)
    width, height = PLATE_PX
    window = Window.of_size(width, height)
    overscan = window.grown(width // 2, height // 2)
    grey = np.full((overscan.height, overscan.width, 3), 0.5, np.float32)
    frame = lensfit.render(
        grey, None, lens, data_window=overscan, display_window=window
    )
    assert frame.shape == (height, width, 3)
    assert np.isfinite(frame).all()
    middle, rim = frame[36, 48], frame[12, 84]
    np.testing.assert_allclose(middle, 0.5, rtol=0.01)
    at_rim = (np.array([84.5, 12.5]) / PLATE_PX - 0.5) * 2 * half_mm / 2
    expected = 0.5 * float(lens.relative_illumination(at_rim[None])[0])
    assert rim[1] == pytest.approx(expected, rel=0.01)
