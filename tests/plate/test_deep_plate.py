"""Deep plates as layers: nothing is lost, and what blurs alike is one."""

import numpy as np
import pytest

from lensfit.coords import Window
from lensfit.errors import ImageError
from lensfit.io.depth_channel import DepthMeaning
from lensfit.io.exr import ExrPart
from lensfit.io.exr_deep import DeepPart
from lensfit.plate.frame.deep_plate import deep_layers
from lensfit.rendering.layer_stack import flattened_layers

METRES = DepthMeaning(1000.0)


def deep(counts, **samples):
    window = Window.of_size(counts.shape[1], counts.shape[0])
    return DeepPart(ExrPart({}, window, window), counts, samples)


def random_deep(seed=0, most=5):
    rng = np.random.default_rng(seed)
    counts = rng.integers(0, most + 1, (6, 8))
    total = counts.sum()
    alpha = rng.random(total).astype(np.float32)
    colour = {n: (alpha * rng.random(total)).astype(np.float32) for n in "RGB"}
    return deep(counts, A=alpha, Z=(1 + 9 * rng.random(total)).astype("f4"), **colour)


def over(part):
    """Each pixel's samples, nearest last, by the definition of over."""
    picture = np.zeros((*part.counts.shape, 4))
    ends = np.cumsum(part.counts.ravel()).reshape(part.counts.shape)
    for y, x in np.ndindex(*part.counts.shape):
        own = np.arange(ends[y, x] - part.counts[y, x], ends[y, x])
        for k in own[np.argsort(-part.samples["Z"][own])]:
            rgba = np.array([part.samples[n][k] for n in "RGBA"])
            picture[y, x] = rgba + (1 - rgba[3]) * picture[y, x]
    return picture


SLABS = {
    "every sample": None,
    "slabs of 1.5 m": lambda depth_mm: np.floor(depth_mm / 1500),
    "one slab": lambda depth_mm: np.zeros(depth_mm.shape),
}


@pytest.mark.parametrize("slabs", SLABS)
def test_layers_over_one_another_are_the_picture(slabs):
    part = random_deep()
    stack = deep_layers(part, METRES, slab_of=SLABS[slabs])
    assert len(stack.rgba) == (1 if slabs == "one slab" else 5)
    assert np.abs(flattened_layers(stack) - over(part)).max() < 1e-6


def test_no_sample_that_blurs_by_itself_is_lost():
    count = 40
    part = deep(
        np.full((1, 2), count),
        **dict.fromkeys("RGBA", np.full(2 * count, 0.05, np.float32)),
        Z=np.tile(np.linspace(1, 5, count, dtype=np.float32), 2),
    )
    stack = deep_layers(part, METRES, slab_of=lambda mm: np.rint(mm))
    assert len(stack.rgba) == count


def test_layers_run_front_to_back_whatever_the_order_of_the_file():
    stack = deep_layers(random_deep(1), METRES)
    depth = np.where(stack.rgba[..., 3] > 0, stack.depth_mm, np.inf)
    assert (np.diff(np.where(np.isinf(depth), 1e9, depth), axis=0) >= 0).all()
    assert 1000 <= depth.min() < 10_000


def test_samples_of_a_slab_meet_at_their_mean_inverse_distance():
    part = deep(
        np.array([[3]]),
        **{n: np.float32([0.2, 0.2, 0.2]) for n in "RGB"},
        A=np.float32([0.5, 0.5, 0.5]),
        Z=np.float32([1.0, 20.0, 50.0]),
    )
    stack = deep_layers(part, METRES, slab_of=lambda mm: mm > 5000)
    assert stack.depth_mm[0, 0, 0] == pytest.approx(1000)
    # Half of the light is the nearer one's, a quarter the farther one's.
    expected = 0.75 / (0.5 / 20_000 + 0.25 / 50_000)
    assert stack.depth_mm[1, 0, 0] == pytest.approx(expected, rel=1e-4)
    assert stack.rgba[1, 0, 0, 3] == pytest.approx(0.75)


def test_volumes_count_at_their_middle_and_opaque_samples_need_no_alpha():
    part = deep(
        np.array([[1]]), Y=np.float32([0.5]), Z=np.float32([2]), ZBack=np.float32([4])
    )
    stack = deep_layers(part, METRES)
    assert stack.depth_mm.item() == 3000
    assert stack.rgba.ravel().tolist() == [0.5, 0.5, 0.5, 1]


def test_an_empty_plate_is_one_empty_layer():
    none = np.zeros(0, np.float32)
    stack = deep_layers(
        deep(np.zeros((2, 3), int), R=none, G=none, B=none, Z=none), METRES
    )
    assert stack.rgba.shape == (1, 2, 3, 4)
    assert not stack.rgba.any()


@pytest.mark.parametrize("lacking", ["Z", "G"])
def test_what_lacks_is_named(lacking):
    part = random_deep()
    samples = {k: v for k, v in part.samples.items() if k != lacking}
    with pytest.raises(ImageError, match="without"):
        deep_layers(DeepPart(part.flat, part.counts, samples), METRES)
