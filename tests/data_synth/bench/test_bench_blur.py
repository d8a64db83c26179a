"""Real dots that no fit saw, predicted: better than by Gaussians fitted to others."""

from types import SimpleNamespace

import numpy as np
import pytest

from data_synth.bench import blur
from data_synth.bench.blur import bench_blur
from lensfit.errors import LensfitError
from lensfit.fitting.wavefront.effort import Effort


@pytest.fixture
def dots():
    """Three dots of one channel, and their images before brightness and background."""
    rng = np.random.default_rng(2)
    image = rng.random((3, 24, 24))
    light = np.array([2.0, 0.1, 40.0])[:, None, None] * image + 0.3
    valid = np.ones((3, 3, 24, 24), bool)
    valid[:, :, :5] = False
    seen = SimpleNamespace(
        light=np.repeat(light[:, None], 3, 1), valid=valid, clipped=~valid
    )
    return seen, image


def test_brightness_and_background_are_found_for_each(dots):
    seen, image = dots
    error = blur._left_of(seen, image) / blur._over_background(seen, image)
    np.testing.assert_allclose(error, 0.0, atol=1e-9)


def test_errors_are_relative_to_the_light_of_the_dot(dots):
    """A tenth of the light that no image has, on the cells that count."""
    seen, image = dots
    rng = np.random.default_rng(3)
    grain = rng.normal(0, 1, image.shape)
    size = np.linalg.norm(grain[:, 5:], axis=(1, 2))
    signal = np.linalg.norm((seen.light[:, 1] - 0.3)[:, 5:], axis=(1, 2))
    grain *= (0.1 * signal / size)[:, None, None]
    grain[:, :5] = 1e6
    noisy = SimpleNamespace(**{**vars(seen), "light": seen.light + grain[:, None]})
    over = blur._over_background(noisy, image)
    np.testing.assert_allclose(over, signal, rtol=0.02)
    np.testing.assert_allclose(blur._left_of(noisy, image) / over, 0.1, rtol=0.03)
    np.testing.assert_allclose(blur._grain_of(noisy, image) / over, 0.1, rtol=0.1)


def test_a_dot_that_the_lens_lets_no_light_through_for_is_all_error(dots):
    seen, image = dots
    dark = image.copy()
    dark[1] = np.nan
    errors = blur._errors_of_lens(seen, dark, blur._over_background(seen, image))
    np.testing.assert_allclose(errors, [0.0, 1.0, 0.0], atol=1e-9)


def test_a_set_of_lines_says_that_it_has_no_dots(monkeypatch):
    monkeypatch.setattr(blur, "shoot_of", lambda *_: None)
    monkeypatch.setattr(blur, "observe_shoot", lambda *_: [])
    nothing = SimpleNamespace(wavefronts={}, unmeasured_blur={})
    monkeypatch.setattr(blur, "fit", lambda *_, **__: nothing)
    found = bench_blur("nowhere", only="line_pattern_01")
    assert found["errors"] == [
        "line_pattern_01: no blur was measured: its chart has no dots"
    ]
    assert not found["rows"]


def test_there_is_no_such_set():
    with pytest.raises(LensfitError, match="no set is called"):
        bench_blur("nowhere", only="dot_pattern_99")


def test_blur_of_a_real_photograph_beats_gaussians(data_dir):
    found = bench_blur(data_dir, only="dot_pattern_05", effort=Effort.FASTEST)
    assert not found["errors"]
    median, worst = found["rows"]
    assert median["value"] < 0.9 * min(
        median["peers"][name]
        for name in ("one Gaussian", "a Gaussian over the field", "no blur")
    )
    assert worst["passed"]
