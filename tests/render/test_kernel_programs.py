"""Kernels of any size come from few programs: an animated focus compiles nothing."""

import jax
import numpy as np
import pytest

from lensfit.render.convolve import kernel_transforms
from lensfit.render.kernel_bank import _filling


def test_transforms_are_those_of_the_kernel_at_the_origin():
    rng = np.random.default_rng(0)
    for half in (1, 3, 7):
        kernels = rng.random((2, 3, 2 * half + 1, 2 * half + 1), np.float32)
        tiles = np.zeros((2, 3, 24, 24))
        for y in range(-half, half + 1):
            for x in range(-half, half + 1):
                tiles[..., y, x] = kernels[..., half + y, half + x]
        found = np.asarray(kernel_transforms(kernels, room=24))
        assert np.abs(found - np.fft.rfft2(tiles)).max() < 1e-4


def test_kernels_of_all_sizes_share_a_program():
    heard = []
    listen = lambda name, seconds, **facts: heard.append(name)  # noqa: E731
    kernel_transforms(np.ones((1, 1, 3, 3), np.float32), room=40)
    jax.monitoring.register_event_duration_secs_listener(listen)
    try:
        for size in range(5, 33, 2):
            kernel_transforms(np.ones((1, 1, size, size), np.float32), room=40)
    finally:
        jax.monitoring.unregister_event_duration_listener(listen)
    assert not any("compile" in name for name in heard)


@pytest.mark.parametrize("half", [1, 2, 3, 10, 11, 12, 100, 599, 600])
def test_few_sizes_are_asked_for_and_none_is_too_small(half):
    size = 2 * _filling(half) + 1
    assert 2 * half + 1 <= size <= max(2 * half + 2, 1.6 * (2 * half + 2))
    room = size + 1
    assert room & (room - 1) == 0 or (
        room % 3 == 0 and (room // 3) & (room // 3 - 1) == 0
    )


def test_all_blurs_ask_for_a_score_of_sizes():
    assert len({_filling(half) for half in range(3, 601)}) <= 20
