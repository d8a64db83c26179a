"""Dots are dealt among cores: each once, and back in their order."""

import numpy as np
import pytest

from lensfit.fitting.cores import cores
from lensfit.fitting.wavefront.stages import dealt


@pytest.mark.parametrize("dots", [1, 2, 7, 255, 256])
@pytest.mark.parametrize("hands", [1, 2, 8])
def test_every_dot_is_dealt_once_and_found_again(dots: int, hands: int):
    deal = dealt(dots, 256, hands)
    assert deal.rows.shape == (256,)
    assert deal.counts.sum() == dots
    assert np.ptp(deal.counts) <= 1
    np.testing.assert_array_equal(deal.rows[deal.places], np.arange(dots))
    share = 256 // hands
    assert (deal.places % share < deal.counts[deal.places // share]).all()


def test_a_hand_without_dots_has_room_and_nothing_in_use():
    deal = dealt(1, 256, 8)
    assert deal.counts.tolist() == [1, 0, 0, 0, 0, 0, 0, 0]
    assert set(deal.rows.tolist()) == {0}


def test_cores_divide_the_room_of_any_pass():
    assert 256 % cores().size == 0
