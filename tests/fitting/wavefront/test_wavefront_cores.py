"""Dots are sharded over cores: each once, and back in their order."""

import numpy as np
import pytest

from lensfit.fitting.cores import cores
from lensfit.fitting.wavefront.stages import shard_dots


@pytest.mark.parametrize("dots", [1, 2, 7, 255, 256])
@pytest.mark.parametrize("shards", [1, 2, 8])
def test_every_dot_is_dealt_once_and_found_again(dots: int, shards: int):
    sharding = shard_dots(dots, 256, shards)
    assert sharding.rows.shape == (256,)
    assert sharding.counts.sum() == dots
    assert np.ptp(sharding.counts) <= 1
    np.testing.assert_array_equal(sharding.rows[sharding.places], np.arange(dots))
    share = 256 // shards
    assert (sharding.places % share < sharding.counts[sharding.places // share]).all()


def test_a_hand_without_dots_has_room_and_nothing_in_use():
    sharding = shard_dots(1, 256, 8)
    assert sharding.counts.tolist() == [1, 0, 0, 0, 0, 0, 0, 0]
    assert set(sharding.rows.tolist()) == {0}


def test_cores_divide_the_room_of_any_pass():
    assert 256 % cores().size == 0
