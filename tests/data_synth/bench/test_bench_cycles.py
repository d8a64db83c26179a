"""Cycles through a lens' shader: what is measured of its pictures, and Blender itself.

Where `LENSFIT_BPY_PYTHON` names a Python that has Blender's `bpy` (or this one has it),
Cycles renders; without it, pictures drawn by the lens itself stand in.
"""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from data_synth.bench.cycles.benchmark import (
    CHART_BAR_PX,
    FALL_OFF_BAR,
    LIGHT_BAR,
    Light,
    chart_error_px,
    fall_off_error,
    frame_row,
    light_error,
    side_by_side,
)
from data_synth.bench.cycles.same_frame import (
    SameFrame,
    SceneScale,
    filled_depth,
    same_frame,
    small_scene,
)
from data_synth.bench.cycles.shaded_lens import Cycles, ShadedLens, shaded_lens
from lensfit.errors import LensfitError
from lensfit.exchange.export_request import WantedState
from lensfit.exchange.samples import ExchangeFrame
from lensfit.preset.store import load_preset

PRIME = Path(__file__).parents[3] / "presets" / "prime_50" / "preset.json"
BPY = os.environ.get("LENSFIT_BPY_PYTHON", sys.executable)
SMALL = ExchangeFrame((400, 300), 24.0)


class Drawn:
    """Pictures by the lens itself, moved and dimmed."""

    def __init__(self, lens, moved_px: float = 0.0, dimmed: float = 0.0):
        self.lens, self.moved_px, self.dimmed = lens, moved_px, dimmed
        self.frame, self.python = SMALL, sys.executable

    def picture(self, *, discs=(), sky: float = 0.0, **_: object) -> np.ndarray:
        width, height = self.frame.size_px
        rows, columns = np.mgrid[0:height, 0:width] + 0.5
        at_mm = self.frame.mm(np.column_stack([columns.ravel(), rows.ravel()]))
        found = np.zeros((height, width, 3))
        for number, channel in enumerate("rgb"):
            light = np.asarray(self.lens.relative_illumination(at_mm, channel))
            found[..., number] = sky * light.reshape(height, width)
            for x, y, z, _ in discs:
                point = [x, y, z + float(self.lens.entrance_pupil_offset_mm)]
                landed = np.asarray(self.lens.project(np.array([point]), channel))
                at = self.frame.px(landed)[0] + [self.moved_px, 0]
                away = np.hypot(columns - at[0], rows - at[1])
                found[..., number] += np.exp(-((away / 2) ** 2))
        return found * (1 - self.dimmed)


def seen_by(cycles: Drawn, stop: float = 8.0) -> ShadedLens:
    preset = load_preset(PRIME)
    return ShadedLens(preset, (50.0, stop, 2000.0), cycles.lens, PRIME, cycles)  # pyright: ignore[reportArgumentType]


@pytest.fixture(scope="module")
def lens():
    return load_preset(PRIME).at(50.0, 8.0, 2000.0)


def test_a_chart_is_measured_from_where_the_lens_puts_it(lens):
    assert chart_error_px(seen_by(Drawn(lens))) < 0.005
    off = chart_error_px(seen_by(Drawn(lens, moved_px=0.2)))
    assert off == pytest.approx(0.2, abs=0.005)


def test_a_fall_off_is_measured_from_that_of_the_lens(lens):
    assert fall_off_error(seen_by(Drawn(lens))) < 1e-6
    off = fall_off_error(seen_by(Drawn(lens, dimmed=0.02)))
    assert off == pytest.approx(0.02, rel=1e-3)


def test_the_scene_scales_with_the_lens():
    near, far = (
        [one for layer in small_scene(SceneScale(*scale)) for one in layer]
        for scale in ((1000.0, 200.0), (2000.0, 400.0))
    )
    for one, other in zip(near, far, strict=True):
        for name in ("at_mm", "size_mm"):
            assert np.allclose(2 * np.array(one[name]), other[name])
    nearest = [
        min(t["at_mm"][2] for t in layer) for layer in small_scene(SceneScale(1, 1))
    ]
    assert nearest[:6] == sorted(nearest[:6])


def test_depth_beside_an_outline_is_that_of_the_thing():
    depth = np.full((4, 5), 1e10, np.float32)
    depth[:, 2:] = 700
    assert (filled_depth(depth) == 700).all()
    assert (filled_depth(np.full((2, 2), 1e10, np.float32)) >= 1e7).all()


def test_a_frame_is_compared_clipped_and_shown_beside_its_plate():
    draw = np.random.default_rng(1)
    truth = draw.uniform(0, 0.9, (27, 48, 3)).astype(np.float32)
    truth[3, 3] = 40.0
    noise = 0.01 * np.sign(draw.normal(size=truth.shape)).astype(np.float32)
    found = SameFrame(
        (truth + noise, truth - noise), truth + 0.02, truth, 0 * truth, truth
    )
    row = frame_row(found)
    # 20 log10 of .02; nothing of what is clipped
    assert row.value == pytest.approx(34, abs=0.1)
    assert row.peers["a frame without fault"] == pytest.approx(40, abs=0.1)
    assert row.peers["no defocus"] < 10
    shown = cv2.imdecode(np.frombuffer(side_by_side(found), np.uint8), 1)
    assert shown.shape == (54, 96, 3)


def test_a_python_without_blender_is_one_clear_line():
    with pytest.raises(LensfitError, match="Blender did not run") as caught:
        Cycles(sys.executable + "-none", SMALL).picture(samples=1)
    assert "\n" not in str(caught.value)
    assert "--blender" in str(caught.value)


@pytest.fixture(scope="module")
def python() -> str:
    found = subprocess.run([BPY, "-c", "import bpy"], capture_output=True, check=False)
    if found.returncode != 0:
        pytest.skip(
            "Blender's bpy is not installed; LENSFIT_BPY_PYTHON names its Python"
        )
    return BPY


def rendered(python: str, stop: float, frame: ExchangeFrame) -> Iterator[ShadedLens]:
    state = WantedState(50.0, stop, 2000.0)
    with shaded_lens(load_preset(PRIME), state, Cycles(python, frame)) as seen:
        yield seen


@pytest.fixture(scope="module")
def stopped_down(python: str) -> Iterator[ShadedLens]:
    yield from rendered(python, 8.0, SMALL)


@pytest.fixture(scope="module")
def wide_open(python: str) -> Iterator[ShadedLens]:
    yield from rendered(python, 2.0, SMALL)


@pytest.mark.slow
def test_cycles_shows_a_chart_where_the_lens_does(stopped_down: ShadedLens):
    assert chart_error_px(stopped_down) < CHART_BAR_PX


@pytest.mark.slow
def test_cycles_shows_the_fall_off(wide_open: ShadedLens):
    assert fall_off_error(wide_open) < FALL_OFF_BAR


@pytest.mark.slow
@pytest.mark.parametrize(
    "light", [Light((0.6, 0.5), 2600.0), Light((0.5, -0.6), 1700.0)]
)
def test_cycles_blurs_a_light_as_the_lens_does(wide_open: ShadedLens, light: Light):
    assert light_error(wide_open, light) < LIGHT_BAR


@pytest.mark.slow
def test_cycles_blurs_a_light_in_focus_as_the_lens_does(wide_open: ShadedLens):
    light = Light((0.5, 0.6), 2000.0)
    assert light_error(wide_open.on_finer_pixels(8), light) < LIGHT_BAR


@pytest.mark.slow
def test_lensfit_makes_the_frame_that_cycles_makes(python: str):
    frame = ExchangeFrame((240, 135), 24.0)
    for seen in rendered(python, 2.0, frame):
        row = frame_row(same_frame(seen, samples=128))
        assert row.value > 33
        assert row.value > row.peers["no defocus"] + 4
        assert row.peers["its layers"] > 33
